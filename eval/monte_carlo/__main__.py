"""``python -m eval.monte_carlo``."""

from agents.config.load import run_cli
from eval.monte_carlo.run import cli

if __name__ == "__main__":
    run_cli(cli)
