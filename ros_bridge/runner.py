"""The runner node: ``python -m ros_bridge.runner`` or ``rlcas-runner``."""

from functools import partial

from ros_bridge.transport.starting import run_node

main = partial(run_node, "runner")

if __name__ == "__main__":
    main()
