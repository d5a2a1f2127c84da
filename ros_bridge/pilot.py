"""The pilot node: ``python -m ros_bridge.pilot``."""

import sys

from ros_bridge.nodes.pilot import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
