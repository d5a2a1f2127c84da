"""``python -m eval.sensitivity``."""

from agents.config.load import run_cli
from eval.sensitivity.run import cli

if __name__ == "__main__":
    run_cli(cli)
