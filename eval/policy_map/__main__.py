"""``python -m eval.policy_map``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.policy_map.run:main")
