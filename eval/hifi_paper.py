"""``python -m eval.hifi_paper``: see :mod:`eval.hifi.paper`."""

from agents.config.load import run_cli
from eval.hifi.paper import main

if __name__ == "__main__":
    run_cli(main)
