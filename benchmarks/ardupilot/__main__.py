"""``python -m benchmarks.ardupilot``."""

from envs.edge.command import run_cli

run_cli("benchmarks.ardupilot.run:main")
