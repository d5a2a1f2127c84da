"""The translator node: ``python -m ros_bridge.translator``."""

from envs.edge.command import run_cli
from ros_bridge.transport.stopping import end_in_order_from_now_on

if __name__ == "__main__":
    end_in_order_from_now_on()
    run_cli("ros_bridge.nodes.translator:main")
