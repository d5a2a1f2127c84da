"""``python -m eval.report``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.report.run:main")
