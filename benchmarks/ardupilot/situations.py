"""Situations of a detect-and-avoid script for planes, flown by us, one by one.

    python -m benchmarks.ardupilot.situations [--only NAME,NAME] [--out DIR]

ArduPilot's pull request 33955 (a script that avoids fences and traffic) tests fence avoidance,
escape from a breach, a drone and a light aircraft by ADS-B, and that a converging contact is
avoided and a diverging one not. These are our own situations of that kind. Each is told in a line
of JSON, with a picture in the folder. Exit status 1: one was not as expected.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.ardupilot.encounters import GOAL
from benchmarks.measure import chosen, report
from envs.edge.command import Parser
from ros_bridge.mavlink.demo import draw
from ros_bridge.mavlink.flight import Encounter, Intruder, Result, fly

_UNTIL = 170.0  # s
_LEFT, _BACK = 0.5 * math.pi, math.pi
_DRONE, _LIGHT = 18.0, 55.0  # m/s
_BESIDE = (1_600.0, 150.0), (2_900.0, 150.0), (2_900.0, 800.0), (1_600.0, 800.0)
_AROUND = (700.0, -150.0), (1_400.0, -150.0), (1_400.0, 150.0), (700.0, 150.0)


class Situation(NamedTuple):
    """What is flown, and what is expected of it."""

    intruders: tuple[Intruder, ...]
    acts: bool  # whether it must take over
    fence: tuple[tuple[float, float], ...] = ()
    inside: bool = False  # whether it begins inside the fence


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
    "out_of_a_breach": Situation(
        (Intruder(-_LEFT, 25.0, 60.0, 0.0),), acts=True, fence=_AROUND, inside=True
    ),
}


def row_of(name: str, one: Situation, flight: Result) -> dict[str, Any]:
    """Return the line of a situation."""
    acted = flight.taken_over > 0
    good = acted == one.acts and not flight.lost and (one.inside or not flight.breached)
    return {
        "situation": name,
        "as_expected": good,
        "acted": acted,
        "separation_m": round(flight.separation, 1),
        "lost": flight.lost,
        "breached": flight.breached,
        "back_in_auto": flight.rows[-1].mode == 10,
        "texts": [text for text in flight.texts if text.startswith("RLCAS")],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly them, and print."""
    parser = Parser(prog="python -m benchmarks.ardupilot.situations", description=__doc__)
    names = ",".join(SITUATIONS)
    parser.add_argument("--only", default=names, help=f"names with commas (default {names})")
    parser.add_argument("--out", type=Path, help="folder of the pictures (default: none)")
    options = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    for name in chosen(options.only, SITUATIONS):
        one = SITUATIONS[name]
        encounter = Encounter(0, one.intruders, 0.0, 300.0, fence=one.fence, goal=GOAL)
        flight = fly(encounter, "ours", instance=12, speedup=40.0, until=_UNTIL)
        rows.append(row_of(name, one, flight))
        print(json.dumps(rows[-1]), flush=True)
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            draw(encounter, flight, options.out / f"{name}.png")
    report({"benchmark": "ardupilot.situations", "rows": rows}, ("pymavlink",))
    return 0 if all(row["as_expected"] for row in rows) else 1


if __name__ == "__main__":
    from envs.edge.command import run_cli

    run_cli("benchmarks.ardupilot.situations:main")
