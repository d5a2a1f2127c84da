"""``python -m benchmarks.icarous``."""

from commands.command import run_cli

run_cli("benchmarks.icarous.run:main")
