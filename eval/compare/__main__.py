"""``python -m eval.compare``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.compare.run:main")
