"""The translator node: ``python -m ros_bridge.translator``."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("ros_bridge.nodes.translator:main")
