"""The simulator node: ``python -m ros_bridge.simulator``."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("ros_bridge.nodes.series:main")
