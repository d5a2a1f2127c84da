"""``python -m benchmarks.safety``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("benchmarks.safety.run:main")
