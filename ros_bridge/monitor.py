"""The monitor node: ``python -m ros_bridge.monitor`` or ``rlcas-monitor``."""

from functools import partial

from ros_bridge.transport.starting import run_node

main = partial(run_node, "monitor")

if __name__ == "__main__":
    main()
