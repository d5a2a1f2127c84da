"""``python -m eval.failures``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.failures.run:main")
