# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Parameters of the nodes: name, default, range, unit and meaning."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from envs.edge.command import Parser, run_cli
from envs.kinematics import C208_PUBLISHED

__all__ = [
    "MARGIN",
    "MONITOR_NUMBERS",
    "MONITOR_OTHERS",
    "NODES",
    "NUMBERS",
    "OTHERS",
    "PILOT_NUMBERS",
    "PILOT_OTHERS",
    "SIMULATOR_NUMBERS",
    "SIMULATOR_OTHERS",
    "TRANSLATOR_NUMBERS",
    "TRANSLATOR_OTHERS",
    "Number",
    "help_text",
    "reference",
]


@dataclass(frozen=True, slots=True)
class Number:
    """A parameter that is a number."""

    name: str
    default: float
    low: float
    high: float
    unit: str
    meaning: str


MARGIN = 145.0
"""Default margin, m: 99 % of the flights of a Cessna 208B in moderate turbulence stay so close to their plans, at 95 %
confidence (docs/howto/hifi.md)."""

_YAW_RATE = round(math.degrees(C208_PUBLISHED.yaw_rate_max), 9)

_MARGIN_MEANING = (
    "added to it for what the autopilot leaves of the plan; the default is the Cessna 208B's in turbulence"
)
NUMBERS = (
    Number("ownship_max_age", 1.5, 0.05, 10.0, "s", "oldest state of the ownship that is planned with"),
    Number("intruder_max_age", 5.0, 0.1, 60.0, "s", "oldest state of an intruder that is planned with"),
    Number("alert_max_age", 10.0, 1.0, 600.0, "s", "for how long an alert holds"),
    Number("request_max_age", 1.0, 0.05, 60.0, "s", "oldest request that is answered"),
    Number("future_tolerance", 0.5, 0.0, 0.5, "s", "by how much a stamp may lie ahead of the clock"),
    Number("forget_after", 30.0, 5.0, 600.0, "s", "silence after which an intruder is forgotten"),
    Number("jump_distance", 500.0, 10.0, 10_000.0, "m", "largest distance of a report from where it is expected ..."),
    Number("jump_speed", 50.0, 0.0, 400.0, "m/s", "... which grows so fast with the time between reports"),
    Number("wind_max", 20.0, 0.0, 20.0, "m/s", "strongest wind that is planned in"),
    Number("separation", 1000.0, 1000.0, 20_000.0, "m", "least distance to every intruder"),
    Number("margin", MARGIN, 0.0, 5_000.0, "m", _MARGIN_MEANING),
    Number("sigmas", 2.0, 0.0, 10.0, "", "standard deviations of the intruders' positions added to it"),
    Number("speed_min", C208_PUBLISHED.speed_min, 10.0, 190.0, "m/s", "lowest air speed of the aircraft"),
    Number("speed_max", C208_PUBLISHED.speed_max, 20.0, 200.0, "m/s", "highest; wind narrows both"),
    Number("acceleration_min", C208_PUBLISHED.acceleration_min, -5.0, -0.05, "m/s^2", "hardest braking"),
    Number("acceleration_max", C208_PUBLISHED.acceleration_max, 0.05, 5.0, "m/s^2", "that is there at every speed"),
    Number("yaw_rate_max", _YAW_RATE, 0.5, 30.0, "deg/s", "fastest turn that is there at every speed"),
    Number("vertical_filter", 600.0, 300.0, 50_000.0, "m", "vertical separation beyond which an intruder is left out"),
    Number("rejoin_by", 300.0, 20.0, 340.0, "s", "latest time at which the route is rejoined"),
    Number("diagnostics_period", 1.0, 0.1, 60.0, "s", "between two states of health; read at the start"),
)
OTHERS: tuple[tuple[str, Any, str], ...] = (
    ("extend_route", False, "whether a route that ends before the plan may be extended in its last direction"),
    (
        "exhaustive",
        True,
        "whether the slow stages of the search are tried before giving up, but for the monitor's requests",
    ),
    ("certificate", True, "whether SAFE plans carry what `python -m agents.check` proves them from; 3 ms an answer"),
    ("policy_file", "", "policy file; empty: the one that ships; read at the configuration"),
    ("policy_sha256", "", "digest that the policy must have, 64 digits; empty: any; read at the configuration"),
    ("map_frame", "map", "frame of path and markers: x east, y north of the geo-reference; read at the configuration"),
    (
        "route_durability",
        "transient_local",
        "of the route input: transient_local or volatile; read at the configuration",
    ),
)


_SHARED = (
    "ownship_max_age",
    "intruder_max_age",
    "future_tolerance",
    "forget_after",
    "jump_distance",
    "jump_speed",
    "separation",
    "margin",
    "sigmas",
    "speed_min",
    "speed_max",
    "acceleration_min",
    "acceleration_max",
    "yaw_rate_max",
    "vertical_filter",
    "diagnostics_period",
)
MONITOR_NUMBERS = (
    *(one for one in NUMBERS if one.name in _SHARED),
    Number("period", 0.05, 0.02, 0.09, "s", "between two checks; read at the configuration"),
    Number("answer_time", 3.0, 0.1, 10.0, "s", "in which the runner must answer"),
    Number("replan_interval", 2.0, 0.5, 60.0, "s", "least time between two requests"),
    Number("cross_track", 25.0, 1.0, 1_000.0, "m", "largest distance from the path"),
    Number("along_track", 50.0, 1.0, 1_000.0, "m", "largest distance ahead of or behind the plan"),
    Number("time_error", 1.0, 0.1, 60.0, "s", "largest delay or lead"),
    Number(
        "intruder_position",
        50.0,
        1.0,
        1_000.0,
        "m",
        "largest deviation of an intruder, besides 3 sigmas",
    ),
    Number("intruder_velocity", 5.0, 0.1, 100.0, "m/s", "largest deviation of its velocity, likewise"),
    Number("runner_silence", 3.0, 1.5, 60.0, "s", "silence of the runner that is reported as a fault"),
)
MONITOR_OTHERS: tuple[tuple[str, Any, str], ...] = (
    ("map_frame", "map", "frame that headers name; read at the configuration"),
)
SIMULATOR_NUMBERS = (
    Number("rate", 20.0, 0.1, 1_000.0, "", "times real time, at most, while no plan is sought"),
    Number("deciding_rate", 1.0, 0.1, 1_000.0, "", "times real time while a plan is sought"),
    Number("longest", 300.0, 10.0, 900.0, "s", "after which an encounter ends"),
    Number("origin_latitude", 47.0, -89.0, 89.0, "deg", "of the geo-reference"),
    Number("origin_longitude", 8.0, -180.0, 180.0, "deg", "of the geo-reference"),
    Number("alert_distance", 2_000.0, 0.0, 50_000.0, "m", "an alert is given where aircraft would pass closer"),
    Number("ask_again", 5.0, 1.0, 60.0, "s", "between requests while there is an alert and no plan"),
    Number("own_rate", 10.0, 0.5, 10.0, "Hz", "of the ownship's reports"),
    Number("own_latency", 0.05, 0.0, 2.0, "s", "of the ownship's reports"),
    Number("own_dropout", 0.0, 0.0, 1.0, "", "share of the ownship's reports that are lost"),
    Number("own_position_std", 0.0, 0.0, 100.0, "m", "noise of the ownship's position, one sigma per axis"),
    Number("own_velocity_std", 0.0, 0.0, 10.0, "m/s", "noise of the ownship's velocity, one sigma per axis"),
    Number("traffic_rate", 1.0, 0.1, 10.0, "Hz", "of each intruder's reports"),
    Number("traffic_latency", 0.4, 0.0, 5.0, "s", "of the intruders' reports"),
    Number("traffic_dropout", 0.05, 0.0, 1.0, "", "share of the intruders' reports that are lost"),
    Number("traffic_position_std", 0.0, 0.0, 500.0, "m", "noise of the intruders' positions, one sigma per axis"),
    Number("traffic_velocity_std", 0.0, 0.0, 50.0, "m/s", "noise of the intruders' velocities, one sigma per axis"),
)
SIMULATOR_OTHERS: tuple[tuple[str, Any, str], ...] = (
    ("scenario", "crossing_left", "family of encounters: a name in envs.encounters; read at the start"),
    ("seed", 0, "of the encounters; read at the start"),
    ("encounter", 0, "number of the first; read at the start"),
    ("encounters", 1, "how many are flown, one after the other; read at the start"),
    ("vehicle", "kinematic", "kinematic, point_mass or c208 (JSBSim); read at the start"),
    ("monitor", True, "whether to fly what the monitor selects; else the newest plan; read at the start"),
    ("map_frame", "map", "frame that headers name; read at the start"),
)
TRANSLATOR_NUMBERS = (
    Number("velocity_apart", 0.2, 0.0, 2.0, "s", "largest time between a fix and the velocity that belongs to it"),
    next(one for one in NUMBERS if one.name == "diagnostics_period"),
)
TRANSLATOR_OTHERS: tuple[tuple[str, Any, str], ...] = (
    ("own_source", "none", "none, nav_sat_fix, inspva or inspvax; read at the start"),
    ("own_id", "", "the ownship's name, such as its 24-bit address in hexadecimal; read at the start"),
    (
        "own_altitude_reference",
        "wgs84",
        "what altitudes of fixes are above: wgs84, msl or pressure; read at the start",
    ),
    ("traffic_source", "none", "none, adsb or nav_sat_fix; read at the start"),
    ("traffic_id", "", "the intruder's name, where its source is a fix; read at the start"),
    ("adsb_barometric_reference", "", "what ADS-B's barometric altitudes are above; empty: unknown; read at the start"),
    ("adsb_geometric_reference", "", "what ADS-B's geometric altitudes are above; empty: unknown; read at the start"),
)
PILOT_NUMBERS = (next(one for one in NUMBERS if one.name == "ownship_max_age"),)
PILOT_OTHERS: tuple[tuple[str, Any, str], ...] = (
    ("monitor", True, "whether to fly what the monitor selects; else the newest plan; read at the start"),
)
NODES = (
    ("runner", NUMBERS, OTHERS),
    ("monitor", MONITOR_NUMBERS, MONITOR_OTHERS),
    ("simulator", SIMULATOR_NUMBERS, SIMULATOR_OTHERS),
    ("translator", TRANSLATOR_NUMBERS, TRANSLATOR_OTHERS),
    ("pilot", PILOT_NUMBERS, PILOT_OTHERS),
)
"""Names of the nodes with their parameters."""


def help_text(numbers: Sequence[Number] = NUMBERS, others: Sequence[tuple[str, Any, str]] = OTHERS) -> str:
    """Return parameters for ``--help``."""
    lines = [f"  {n.name:20} {n.default:g} {n.unit} ({n.low:g} to {n.high:g}): {n.meaning}" for n in numbers]
    lines += [f"  {name:20} {default!r}: {meaning}" for name, default, meaning in others]
    return "\n".join(lines)


def reference() -> str:
    """Return all parameters as tables in Markdown, each once, as they stand in docs/reference/ros-parameters.md."""
    parts: list[str] = []
    known: set[Any] = set()
    for node, numbers, others in NODES:
        again = [f"`{one.name}`" for one in numbers if one in known]
        again += [f"`{one[0]}`" for one in others if one in known]
        rows = [f"**{node}**", ""]
        rows += [f"As above: {', '.join(again)}.", ""] if again else []
        rows += ["| parameter | default | range | unit | meaning |", "|---|---|---|---|---|"]
        rows += [
            f"| `{n.name}` | {n.default:g} | {n.low:g} to {n.high:g} | {n.unit} | {n.meaning} |"
            for n in numbers
            if n not in known
        ]
        rows += [f"| `{one[0]}` | `{_shown(one[1])}` | | | {one[2]} |" for one in others if one not in known]
        known |= {*numbers, *others}
        parts.append("\n".join(rows))
    return "\n\n".join(parts) + "\n"


def _shown(default: Any) -> str:
    return str(default).lower() if isinstance(default, bool) else str(default) or '""'


def main() -> None:
    """Print the tables."""
    Parser(prog="python -m ros_bridge.transport.parameters", description=__doc__).parse_args()
    print(reference(), end="")


if __name__ == "__main__":
    run_cli(main)
