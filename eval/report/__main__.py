"""``python -m eval.report``."""

from agents.config.load import run_cli
from eval.report.run import main
from eval.runner.command import refusing

if __name__ == "__main__":
    run_cli(refusing(main))
