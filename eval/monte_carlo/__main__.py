"""``python -m eval.monte_carlo``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.monte_carlo.run:main")
