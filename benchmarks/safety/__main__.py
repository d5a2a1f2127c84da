"""``python -m benchmarks.safety``."""

import sys

from benchmarks.safety.run import main

if __name__ == "__main__":
    sys.exit(main())
