"""``python -m benchmarks.learning``."""

from agents.config.load import run_cli
from benchmarks.learning.run import main

if __name__ == "__main__":
    run_cli(main)
