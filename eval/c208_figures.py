"""``python -m eval.c208_figures``: see :mod:`eval.hifi.c208_figures`."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("eval.hifi.c208_figures:main")
