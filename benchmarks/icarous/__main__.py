"""``python -m benchmarks.icarous``."""

from envs.edge.command import run_cli

run_cli("benchmarks.icarous.run:main")
