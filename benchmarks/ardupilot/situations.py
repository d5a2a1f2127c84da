"""Situations of a detect-and-avoid script for planes, flown by us, one by one.

    python -m benchmarks.ardupilot.situations [--only NAME,NAME] [--out DIR]

ArduPilot's pull request 33955 (a script that avoids fences and traffic) tests fence avoidance,
escape from a breach, a drone and a light aircraft by ADS-B, and that a converging contact is
avoided and a diverging one not. These are our own situations of that kind, and one in which the
monitor's backup must climb. Each is told in a line of JSON, with a picture in the folder, and all
of them in ``situations.png``; ``share_kept`` is the least share of a separation that was kept, of
the horizontal one or the vertical one, whichever was more at a time. Exit status 1: one was not as
expected.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from benchmarks.ardupilot.run import fly_seen
from benchmarks.measure import parse_names, report
from commands.command import Parser, require
from commands.figures import AREA_COLOUR, INTRUDER_COLOUR, OWN_COLOUR
from eval.plots.style import legend, sample
from ros_bridge.mavlink.flight import (
    SEPARATION,
    VERTICAL,
    Encounter,
    Intruder,
    Result,
    Row,
    apart,
    place_of,
)
from ros_bridge.mavlink.flight_picture import draw
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.sitl import Sitl

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SPEEDUP = 10.0  # times real time
_INSTANCE = 12  # of the simulation
_ACROSS = 4  # pictures beside each other
_LEFT, _BACK = 0.5 * math.pi, math.pi
_DRONE, _LIGHT = 18.0, 55.0  # m/s
_BESIDE = (1_600.0, 150.0), (2_900.0, 150.0), (2_900.0, 800.0), (1_600.0, 800.0)
_ACROSS_IT = (2_200.0, -250.0), (2_700.0, -250.0), (2_700.0, 150.0), (2_200.0, 150.0)
_CORRIDOR = (-600.0, -80.0), (9_500.0, -80.0), (9_500.0, 80.0), (-600.0, 80.0)
_AROUND = (700.0, -150.0), (1_900.0, -150.0), (1_900.0, 150.0), (700.0, 150.0)


class Situation(NamedTuple):
    """What is flown, and what is expected of it."""

    intruders: tuple[Intruder, ...]
    acts: bool  # whether it must take over
    fence: tuple[tuple[float, float], ...] = ()
    inside: bool = False  # whether the fence comes while the aircraft is inside of it
    keep_in: bool = False  # whether the fence is to be stayed in, or kept out of
    climbs: bool = False  # whether plans may climb, and a backup must
    until: float = 170.0  # s

    def encounter(self) -> Encounter:
        """Return what is flown."""
        return Encounter(0, self.intruders, 0.0, 300.0, fence=self.fence, keep_in=self.keep_in)


SITUATIONS = {
    "drone_head_on": Situation((Intruder(_BACK, _DRONE, 60.0, 0.0),), acts=True),
    "drone_crossing": Situation((Intruder(_LEFT, _DRONE, 60.0, 0.0),), acts=True),
    "drone_overtaken": Situation((Intruder(0.0, 10.0, 70.0, 0.0),), acts=True),
    "light_head_on": Situation((Intruder(_BACK, _LIGHT, 60.0, 0.0),), acts=True),
    "light_crossing": Situation((Intruder(-_LEFT, _LIGHT, 60.0, 0.0),), acts=True),
    "light_from_behind": Situation((Intruder(0.2, _LIGHT, 60.0, 0.0),), acts=True),
    "converging": Situation((Intruder(2.4, 25.0, 60.0, 100.0),), acts=True),
    "diverging": Situation((Intruder(_LEFT, 25.0, -20.0, 0.0),), acts=False),
    "passes_aside": Situation((Intruder(_BACK, 25.0, 60.0, 700.0),), acts=False),
    "turns_in": Situation((Intruder(_BACK, 25.0, 60.0, 500.0, 30.0, -0.6),), acts=True),
    "two_at_once": Situation(
        (Intruder(_LEFT, 25.0, 60.0, 0.0), Intruder(_BACK, _DRONE, 65.0, 50.0)), acts=True
    ),
    "three_at_once": Situation(
        tuple(Intruder(course, 25.0, 60.0, 0.0) for course in (_LEFT, -_LEFT, _BACK)), acts=True
    ),
    "fence_beside": Situation((Intruder(-_LEFT, 25.0, 60.0, 0.0),), acts=True, fence=_BESIDE),
    "fence_across": Situation((), acts=True, fence=_ACROSS_IT),
    "out_of_a_breach": Situation(
        (Intruder(-_LEFT, 25.0, 60.0, 0.0),), acts=True, fence=_AROUND, inside=True
    ),
    # The first, which is passed above, is not reported when the second turns in: nothing can be
    # planned, and there is no room beside it.
    "climbing_backup": Situation(
        (
            Intruder(_BACK, 25.0, 48.0, 0.0, level=-45.0, silence=(28.0, 62.0)),
            Intruder(_BACK, 25.0, 58.0, -330.0, 39.0, 0.7, level=-14.0),
        ),
        acts=True,
        fence=_CORRIDOR,
        keep_in=True,
        climbs=True,
        until=130.0,
    ),
}


def fly_situation(situation: Situation, instance: int = _INSTANCE) -> Result:
    """Fly a situation in a simulation of a number."""

    def upload(sitl: Sitl, seconds: float, row: Row) -> None:
        if seconds == 0.0:
            with sitl.awake():
                sitl.upload_fence(situation.fence, keep_in=situation.keep_in)

    encounter = situation.encounter()
    return fly_seen(
        encounter._replace(fence=()) if situation.inside else encounter,
        "ours" if situation.climbs else "ours_horizontal",
        instance=instance,
        speedup=_SPEEDUP,
        until=situation.until,
        watch=upload if situation.inside else None,
    )


def row_of(name: str, situation: Situation, flight: Result) -> dict[str, Any]:
    """Return the line of a situation."""
    acted = flight.taken_over > 0
    good = acted == situation.acts and not flight.lost and (situation.inside or not flight.breached)
    if situation.climbs:
        good &= any(text.startswith("RLCAS: backup, climbing") for text in flight.texts)
    return {
        "situation": name,
        "as_expected": good,
        "acted": acted,
        "separation_m": round(flight.separation, 1) if situation.intruders else None,
        "share_kept": _share_kept(situation, flight),
        "off_height_m": _off_height(flight),
        "lost": flight.lost,
        "breached": flight.breached,
        "back_in_auto": flight.rows[-1].mode == 10,
        "texts": [text for text in flight.texts if text.startswith("RLCAS")],
    }


def _share_kept(situation: Situation, flight: Result) -> float | None:
    """Return the least share of a separation that was kept, of the greater of both at a time; None
    without an intruder.
    """
    cruise = situation.encounter().cruise
    shares = (
        max(
            apart(row, other, cruise) / SEPARATION,
            abs(row.above - other.above(row.time)) / VERTICAL,
        )
        for row in flight.rows
        for other in situation.intruders
    )
    least = min(shares, default=math.inf)
    return None if math.isinf(least) else round(least, 2)


def _off_height(flight: Result) -> float | None:
    """Return how far it was above or below what it flew at most, m; None: it kept its height."""
    off = [abs(period.above) for period in flight.steered if not math.isnan(period.above)]
    return round(max(off), 1) if off else None


def overview(flights: Mapping[str, Result], file: Path) -> None:
    """Draw all flights from above, with dots where all were when the nearest was nearest."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    down = -(-len(flights) // _ACROSS)
    figure, axes = plt.subplots(
        down, _ACROSS, figsize=(9.0, 1.5 * down), layout="constrained", squeeze=False
    )
    for axis in axes.flat[len(flights) :]:
        axis.axis("off")
    for axis, (name, flight) in zip(axes.flat, flights.items(), strict=False):
        _draw(axis, SITUATIONS[name], flight)
        least = f", {flight.separation:.0f} m" if SITUATIONS[name].intruders else ""
        axis.set_title(f"{name}{least}", fontsize=8)
    handles = [
        sample("mission (AUTO)", color="0.5", linewidth=2.0),
        sample("steered (GUIDED)", color=OWN_COLOUR, linewidth=2.0),
        sample("traffic", color=INTRUDER_COLOUR, linewidth=0.8, linestyle="--"),
        sample("when nearest", color="black", marker="o", markersize=3, linestyle=""),
        sample("geofence", color=AREA_COLOUR, alpha=0.35, marker="s", markersize=8, linestyle=""),
    ]
    title = "east and north, m; beside each name the smallest distance from traffic"
    legend(figure, handles, len(handles), 8, title=title, title_fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _draw(axis: "Axes", situation: Situation, flight: Result) -> None:
    cruise = Encounter(0, (), 0.0, 0.0).cruise
    for mode, colour in ((Mode.AUTO, "0.5"), (Mode.GUIDED, OWN_COLOUR)):
        rows = [row for row in flight.rows if row.mode == mode]
        axis.plot([row.x for row in rows], [row.y for row in rows], ".", ms=1.5, color=colour)
    nearest = min(flight.rows, key=lambda row: _separation(row, situation, cruise))
    axis.plot(nearest.x, nearest.y, "o", ms=3, color=OWN_COLOUR)
    for other in situation.intruders:
        places = [place_of(other, row.time, cruise) for row in flight.rows[::10]]
        axis.plot(
            [p[0] for p in places], [p[1] for p in places], "--", lw=0.8, color=INTRUDER_COLOUR
        )
        axis.plot(*place_of(other, nearest.time, cruise)[:2], "o", ms=3, color=INTRUDER_COLOUR)
    if situation.fence:
        axis.fill(
            *zip(*situation.fence, strict=True),
            color=AREA_COLOUR,
            alpha=0.35,
            fill=not situation.keep_in,
        )
    axis.set(xlim=(600.0, 4_000.0), ylim=(-900.0, 900.0), aspect="equal")
    axis.tick_params(labelsize=6)


def _separation(row: Row, situation: Situation, cruise: float) -> float:
    """Return the distance to the nearest intruder at a row of a flight, m; inf without any."""
    return min((apart(row, other, cruise) for other in situation.intruders), default=math.inf)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly them, and print."""
    parser = Parser(prog="python -m benchmarks.ardupilot.situations", description=__doc__)
    names = ",".join(SITUATIONS)
    parser.add_argument("--only", default=names, help=f"names with commas (default {names})")
    parser.add_argument("--out", type=Path, help="folder of the pictures (default: none)")
    options = parser.parse_args(arguments)
    if options.out is not None:
        require("--out", "matplotlib")
    rows: list[dict[str, Any]] = []
    flights: dict[str, Result] = {}
    for name in parse_names(options.only, SITUATIONS):
        situation = SITUATIONS[name]
        flight = fly_situation(situation)
        flights[name] = flight
        rows.append(row_of(name, situation, flight))
        print(json.dumps(rows[-1]), flush=True)
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            draw(situation.encounter(), flight, options.out / f"{name}.png")
    if options.out is not None:
        overview(flights, options.out / "situations.png")
    report({"benchmark": "ardupilot.situations", "rows": rows}, ("pymavlink",))
    return 0 if all(row["as_expected"] for row in rows) else 1


if __name__ == "__main__":
    from commands.command import run_cli

    run_cli("benchmarks.ardupilot.situations:main")
