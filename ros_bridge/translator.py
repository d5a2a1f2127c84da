"""The translator node: ``python -m ros_bridge.translator`` or ``rlcas-translator``."""

from functools import partial

from ros_bridge.transport.starting import run_node

main = partial(run_node, "translator")

if __name__ == "__main__":
    main()
