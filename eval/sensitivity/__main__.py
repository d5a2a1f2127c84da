"""``python -m eval.sensitivity``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.sensitivity.run:main")
