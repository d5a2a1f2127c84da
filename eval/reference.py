"""Writes the tables of every key of an evaluation: ``python -m eval.reference docs/reference``."""

from commands.command import run_cli


def tables() -> dict[str, list[str]]:
    """Return the tables by the name of their page."""
    from agents.config.keys import markdown
    from eval.areas.config import AreasConfig
    from eval.boundary.config import BoundaryConfig
    from eval.compare.config import CompareConfig
    from eval.config import MonteCarloConfig, TrafficConfig
    from eval.failures.config import FailuresConfig
    from eval.family.config import FamilyConfig
    from eval.hifi.config import HifiConfig
    from eval.policy_map.config import LocalConfig, PolicyMapConfig
    from eval.rare.config import RareConfig
    from eval.sensitivity.config import SensitivityConfig

    flown = markdown(MonteCarloConfig, but=("aircraft.", "planner.vehicle."))
    hifi = markdown(HifiConfig, beside=MonteCarloConfig)
    rare = markdown(RareConfig, beside=MonteCarloConfig)
    compared = markdown(CompareConfig, beside=MonteCarloConfig)
    boundary = markdown(BoundaryConfig, but=("aircraft.",))
    others = (FamilyConfig, SensitivityConfig, FailuresConfig, PolicyMapConfig, LocalConfig)
    tables = [flown, hifi, rare, compared, boundary, *map(markdown, others), markdown(AreasConfig)]
    return {"configuration-evaluation.md": [*tables, markdown(TrafficConfig)]}


def main() -> None:
    """Write the tables into the page of the directory that the command line names; raises a
    ConfigError.
    """
    from agents.config.pages import write_tables

    write_tables("python -m eval.reference", __doc__, tables())


if __name__ == "__main__":
    run_cli("eval.reference:main")
