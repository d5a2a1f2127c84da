"""``python -m eval.boundary``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.boundary.run:main")
