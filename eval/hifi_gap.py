"""``python -m eval.hifi_gap``: see :mod:`eval.hifi.gap`."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("eval.hifi.gap:main")
