"""``python -m eval.c208_figures``: see :mod:`eval.hifi.c208_figures`."""

import sys

from eval.hifi.c208_figures import main

if __name__ == "__main__":
    sys.exit(main())
