"""The paper's four scenarios on the true aircraft: ``python -m eval.hifi_paper --out DIR``.

One plan each is flown once; the figure shows tracks against waypoints and every error over time.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from agents.config.figures import save_figure
from agents.config.load import ConfigError, Parser, load

__all__ = ["main"]

_SCENARIOS = ("crossing_left", "crossing_right", "head_on", "same_course")


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, draw, and return the exit status.

    Raises:
        ConfigError: bad input.
    """
    parser = Parser(prog="python -m eval.hifi_paper", description=__doc__)
    add = parser.add_argument
    add("--flight", type=int, default=0, metavar="N", help="number of the flight in each scenario (default: 0)")
    add("--seed", type=int, default=0, metavar="N", help="of the encounters (default: 0)")
    add("--condition", default="calm", metavar="NAME", help="what the aircraft meets (default: calm)")
    add("--vehicle", default="c208_ex", metavar="NAME", help="what flies (default: c208_ex)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="change a key of eval.hifi's configuration")
    add("--out", type=Path, default=Path("runs/hifi_paper"), metavar="DIR", help="folder (default: runs/hifi_paper)")
    return _draw(parser.parse_args(arguments))


def _draw(options: argparse.Namespace) -> int:
    from threadpoolctl import threadpool_limits

    from eval.hifi.config import HifiConfig
    from eval.hifi.flights import LoadedCampaign, flown
    from eval.hifi.rows import row_of
    from eval.hifi.run import campaign_of
    from eval.hifi.sheet import sheet
    from eval.runner.options import named_policy

    if options.flight < 0:
        raise ConfigError(f"--flight is {options.flight}; expected a whole number of at least 0")
    keys = {"vehicle": options.vehicle, "condition.name": options.condition, "seed": options.seed, "mode": "plan"}
    named = [f"{key}={value}" for key, value in keys.items()]
    first = load(HifiConfig, None, [*named, *options.set])
    if options.out.exists() and not options.out.is_dir():
        raise ConfigError(f"--out {options.out}: is a file, expected a folder")
    rules = first.flown_aircraft(named_policy(first)).rules()
    flights = []
    with threadpool_limits(1):
        for name in _SCENARIOS:
            campaign, _ = campaign_of(load(HifiConfig, None, [*named, *options.set, f"scenario={name}"]))
            one = flown(LoadedCampaign(campaign), options.flight)
            row = row_of(campaign, options.flight, one)
            flights.append((f"{name}: {row['outcome']}", one))
            print(
                f"{name:15} {row['outcome']:9} {row['reason']} smallest separation {row['min_separation_m']:.0f} m, "
                f"cross-track rms {row['cross_track_rms_m']:.2f}, largest {row['cross_track_max_m']:.2f} m, "
                f"along-track {row['along_track_max_m']:.2f} m, arrival {row['late_max_s']:.3f} s, "
                f"path definition {_shown(row['path_definition_max_m'])}, total {_shown(row['total_error_max_m'])}, "
                f"accumulated {row['accumulated_m_s']:.0f} m s"
            )
    picture = sheet(flights, rules)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        for path in save_figure(picture, options.out / f"paper_{options.condition}", 130):
            print(f"wrote {path}")
    except OSError as problem:
        raise ConfigError(f"--out {options.out}: cannot be written: {problem.strerror}") from None
    return 0


def _shown(metres: float) -> str:
    return "-" if math.isnan(metres) else f"{metres:.1f} m"
