"""``python -m rlcas_jax.sweep``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("rlcas_jax.sweep.run:main")
