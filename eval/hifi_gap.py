"""``python -m eval.hifi_gap``: see :mod:`eval.hifi.gap`."""

from agents.config.load import run_cli
from eval.hifi.gap import main

if __name__ == "__main__":
    run_cli(main)
