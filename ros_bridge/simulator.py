"""The simulator node: ``python -m ros_bridge.simulator`` or ``rlcas-simulator``."""

from functools import partial

from ros_bridge.transport.starting import run_node

main = partial(run_node, "series")

if __name__ == "__main__":
    main()
