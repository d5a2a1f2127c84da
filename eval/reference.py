"""Writes the tables of every key of an evaluation: ``python -m eval.reference docs/reference``."""

from envs.edge.command import run_cli


def tables() -> dict[str, list[str]]:
    """Return the tables by the name of their page."""
    from agents.config.keys import markdown
    from eval.config import MonteCarloConfig, TrafficConfig
    from eval.hifi.config import HifiConfig
    from eval.rare.config import RareConfig

    flown = markdown(MonteCarloConfig, but=("aircraft.", "planner.vehicle."))
    hifi = markdown(HifiConfig, beside=MonteCarloConfig)
    rare = markdown(RareConfig, beside=MonteCarloConfig)
    return {"configuration-evaluation.md": [flown, hifi, rare, markdown(TrafficConfig)]}


def main() -> None:
    """Write the tables into the page of the directory that the command line names; raises a
    ConfigError.
    """
    from agents.config.pages import write_tables

    write_tables("python -m eval.reference", __doc__, tables())


if __name__ == "__main__":
    run_cli("eval.reference:main")
