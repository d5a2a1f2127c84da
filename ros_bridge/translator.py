"""The translator node: ``python -m ros_bridge.translator``."""

import sys

from ros_bridge.nodes.translator import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
