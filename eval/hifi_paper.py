"""``python -m eval.hifi_paper``: see :mod:`eval.hifi.paper`."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("eval.hifi.paper:main")
