"""``python -m eval.compare``."""

from agents.config.load import run_cli
from eval.compare.run import cli

if __name__ == "__main__":
    run_cli(cli)
