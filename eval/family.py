"""``python -m eval.family``: see :mod:`eval.sensitivity.family`."""

from envs.edge.command import run_cli

if __name__ == "__main__":
    run_cli("eval.sensitivity.family:main")
