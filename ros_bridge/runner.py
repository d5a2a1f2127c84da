"""The runner node: ``python -m ros_bridge.runner``."""

import gc

from envs.edge.command import run_cli
from ros_bridge.transport.stopping import end_in_order_from_now_on

if __name__ == "__main__":
    end_in_order_from_now_on()
    # Whatever is imported stays; looking for what does not takes an eighth of the time.
    gc.disable()
    run_cli("ros_bridge.nodes.runner:main")
