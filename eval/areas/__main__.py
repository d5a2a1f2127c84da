"""``python -m eval.areas``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("eval.areas.run:main")
