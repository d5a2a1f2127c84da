"""``python -m benchmarks.learning``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("benchmarks.learning.run:main")
