"""``python -m eval.areas``."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("eval.areas.run:main")
