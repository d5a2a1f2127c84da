"""The simulator node: ``python -m ros_bridge.simulator``."""

import sys

from ros_bridge.nodes.simulator import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
