"""``python -m benchmarks.daidalus``."""

from commands.command import run_cli

run_cli("benchmarks.daidalus.run:main")
