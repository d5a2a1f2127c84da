"""``python -m benchmarks.ardupilot``."""

from commands.command import run_cli

run_cli("benchmarks.ardupilot.run:main")
