"""``python -m eval.hifi``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.hifi.run:main")
