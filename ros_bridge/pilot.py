"""The pilot node: ``python -m ros_bridge.pilot`` or ``rlcas-pilot``."""

from functools import partial

from ros_bridge.transport.starting import run_node

main = partial(run_node, "pilot")

if __name__ == "__main__":
    main()
