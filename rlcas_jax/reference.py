"""Writes the tables of the documentation that come from the code: ``python -m rlcas_jax.reference
docs/reference``.
"""

from commands.command import run_cli
from rlcas_jax.metrics import METRICS


def tables() -> dict[str, list[str]]:
    """Return the tables by the name of their page."""
    from agents.config.keys import markdown
    from rlcas_jax.config import TrainConfig

    rows = "".join(f"| `{name}` | {text} |\n" for name, text in METRICS.items())
    return {
        "configuration.md": [markdown(TrainConfig)],
        "metrics.md": ["| metric | meaning |\n|---|---|\n" + rows],
    }


def main() -> None:
    """Write the tables into the pages of the directory that the command line names; raises a
    ConfigError.
    """
    from agents.config.pages import write_tables

    write_tables("python -m rlcas_jax.reference", __doc__, tables())


if __name__ == "__main__":
    run_cli("rlcas_jax.reference:main")
