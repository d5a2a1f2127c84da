"""``python -m eval.hifi``."""

from agents.config.load import run_cli
from eval.hifi.run import main
from eval.runner.command import refusing

if __name__ == "__main__":
    run_cli(refusing(main))
