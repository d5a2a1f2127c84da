"""``python -m eval.rare``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.rare.run:main")
