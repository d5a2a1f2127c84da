"""``python -m benchmarks.safety``."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("benchmarks.safety.run:main")
