"""``python -m benchmarks.daidalus``."""

from envs.edge.command import run_cli

run_cli("benchmarks.daidalus.run:main")
