"""``python -m benchmarks.learning``."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("benchmarks.learning.run:main")
