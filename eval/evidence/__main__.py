"""``python -m eval.evidence``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.evidence.run:main")
