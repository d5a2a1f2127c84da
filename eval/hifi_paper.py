"""The paper's four scenarios on the true aircraft: ``python -m eval.hifi_paper --out DIR``.

One plan each is flown once; the figure shows tracks against waypoints and every error over time.
"""

from collections.abc import Sequence
from pathlib import Path

from agents.config.load import Parser, load
from envs.edge.command import run_cli

__all__ = ["main"]

_SCENARIOS = ("crossing_left", "crossing_right", "head_on", "same_course")


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, draw, and return the exit status; bad input raises ``InputError``."""
    parser = Parser(prog="python -m eval.hifi_paper", description=__doc__)
    add = parser.add_argument
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="change a key of eval.hifi's configuration")
    add("--out", type=Path, default=Path("runs/hifi_paper"), metavar="DIR", help="folder (default: runs/hifi_paper)")
    options = parser.parse_args(arguments)
    from threadpoolctl import threadpool_limits

    from agents.config.figures import save_figure
    from agents.policy.inference import Policy
    from eval.hifi.config import HifiConfig
    from eval.hifi.figures import sheet
    from eval.hifi.flights import flown, prepared
    from eval.hifi.rows import row_of
    from eval.hifi.run import campaign_of
    from eval.plots import save

    campaigns = [
        campaign_of(load(HifiConfig, None, ["mode=plan", *options.set, f"scenario={name}"]))[0] for name in _SCENARIOS
    ]
    save.create(options.out)
    flights = []
    with threadpool_limits(1):
        for name, campaign in zip(_SCENARIOS, campaigns, strict=True):
            one = flown(*prepared(campaign, Policy.load(campaign.policy)), 0)
            row = row_of(campaign, 0, one)
            flights.append((f"{name}: {row['outcome']}", one))
            print(
                f"{name:15} {row['outcome']:9} {row['reason']} smallest separation {row['min_separation_m']:.0f} m, "
                f"cross-track {row['cross_track_max_m']:.2f} m, along-track {row['along_track_max_m']:.2f} m, "
                f"arrival {row['late_max_s']:.3f} s, accumulated {row['accumulated_m_s']:.0f} m s"
            )
    for path in save_figure(sheet(flights, campaigns[0].aircraft.rules()), options.out / "paper", 130):
        print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    run_cli("eval.hifi_paper:main")
