"""How far ArduPlane is from the plans that it flies, in still air, in wind and in turbulence.

    python -m benchmarks.ardupilot.margin [--encounters 20] [--only NAME,NAME] [--method NAME]

Encounters of :mod:`benchmarks.ardupilot.encounters` are flown by ours in each air: ``still``;
``wind``, 5 m/s from any direction; ``turbulence``, the same wind with SIM_WIND_TURB 2. Of each
flight the largest distances across its plans, along them and from their altitudes are taken, from
samples every tenth of a second while it is steered. Of each air the line says the median and the
largest of them, and the share of flights that stay below the largest, at 95 % confidence. The last
line is one JSON object.
"""

import argparse
import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.ardupilot.encounters import encounter, ground_speed
from benchmarks.ardupilot.run import fly_encounter
from benchmarks.measure import parse_names, report
from commands.command import Parser, whole
from ros_bridge.mavlink.flight import Encounter, Result
from ros_bridge.mavlink.sitl import folder

_DOUBT = 0.05  # one less the confidence
_INSTANCE, _SPEEDUP = 16, 8.0


class Air(NamedTuple):
    """The air of a flight, m/s."""

    wind: float
    turbulence: float


AIRS = {"still": Air(0.0, 0.0), "wind": Air(5.0, 0.0), "turbulence": Air(5.0, 2.0)}


def in_air(encounter: Encounter, air: Air) -> Encounter:
    """Return an encounter in another air, in which its aircraft still meet."""
    cruise = ground_speed(air.wind, encounter.wind_from)
    return encounter._replace(wind=air.wind, turbulence=air.turbulence, cruise=cruise)


class Distances(NamedTuple):
    """The largest distances of a flight from its plans, m."""

    across: float
    along: float
    above: float  # or below; nan: all of its plans were in the plane


def largest(flight: Result) -> Distances | None:
    """Return the largest distances from the plan; None: none was flown."""
    if not flight.steered:
        return None
    off = np.abs([(row.cross_track, row.along_track, row.above) for row in flight.steered])
    return Distances(*(float(np.fmax.reduce(column)) for column in off.T))


def row_of(name: str, distances: Sequence[Distances]) -> dict[str, Any]:
    """Return the line of an air; one flight at least."""
    table = np.array(distances)
    figures = {
        f"{direction}_m_{word}": round(float(summary(table[:, column])), 2)
        for column, direction in enumerate(Distances._fields)
        for word, summary in (("median", np.nanmedian), ("max", np.nanmax))
    }
    return {
        "air": name,
        "flights": len(table),
        **figures,
        "share_below_max": round(_DOUBT ** (1.0 / len(table)), 3),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, and print."""
    parser = Parser(prog="python -m benchmarks.ardupilot.margin", description=__doc__)
    add = parser.add_argument
    add("--encounters", type=whole(1), default=20, help="encounters flown in each air (default 20)")
    add("--seed", type=whole(0), default=2, help="seed of the encounters (default 2)")
    of = "ours: plans may climb, or ours_horizontal: they keep the height (default ours)"
    add("--method", choices=("ours", "ours_horizontal"), default="ours", help=of)
    names = ",".join(AIRS)
    add("--only", default=names, help=f"names with commas (default {names})")
    options = parser.parse_args(arguments)
    folder()
    rows = []
    for name in parse_names(options.only, AIRS):
        distances = _fly(AIRS[name], options)
        if distances:
            rows.append(row_of(name, distances))
            print(json.dumps(rows[-1]), flush=True)
    report({"benchmark": "ardupilot.margin", "rows": rows}, ("pymavlink",))
    return 0


def _fly(air: Air, options: argparse.Namespace) -> list[Distances]:
    """Return the largest distances of each flight in which a plan was flown."""
    distances: list[Distances] = []
    for number in range(options.encounters):
        drawn = in_air(encounter(options.seed, number), air)
        off = largest(fly_encounter(drawn, options.method, instance=_INSTANCE, speedup=_SPEEDUP))
        if off is not None:
            distances.append(off)
    return distances


if __name__ == "__main__":
    from commands.command import run_cli

    run_cli("benchmarks.ardupilot.margin:main")
