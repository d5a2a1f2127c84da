"""``python -m eval.rare``."""

from agents.config.load import run_cli
from eval.rare.run import cli

if __name__ == "__main__":
    run_cli(cli)
