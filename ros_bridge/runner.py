"""The runner node: ``python -m ros_bridge.runner``."""

import gc

from envs.edge.command import run_cli

if __name__ == "__main__":
    # Whatever is imported stays; looking for what does not takes an eighth of the time.
    gc.disable()
    run_cli("ros_bridge.nodes.runner:main")
