"""The monitor node: ``python -m ros_bridge.monitor``."""

import sys

from ros_bridge.nodes.monitor import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
