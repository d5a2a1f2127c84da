"""``python -m eval.failures``."""

from agents.config.load import run_cli
from eval.failures.run import main
from eval.runner.command import refusing

if __name__ == "__main__":
    run_cli(refusing(main))
