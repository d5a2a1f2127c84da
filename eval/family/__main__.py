"""``python -m eval.family``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.family.run:main")
