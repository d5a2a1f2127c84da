"""``python -m eval.policy_map``."""

from agents.config.load import run_cli
from eval.policy_map.run import cli

if __name__ == "__main__":
    run_cli(cli)
