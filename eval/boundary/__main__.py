"""``python -m eval.boundary``."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("eval.boundary.run:main")
