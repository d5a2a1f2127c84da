"""``python -m rlcas_jax.sweep``."""

from agents.config.load import run_cli
from rlcas_jax.sweep.run import main

if __name__ == "__main__":
    run_cli(main)
