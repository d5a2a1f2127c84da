"""``python -m eval.boundary``."""

from agents.config.load import run_cli
from eval.boundary.run import main

if __name__ == "__main__":
    run_cli(main)
