"""Parameters of the nodes: name, default, range, unit and meaning.

Numbers that follow from the aircraft are in its units: D is its separation, V its greatest speed, T
its time step. A default that is a word is what the aircraft has of that name.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from commands.command import Parser, run_cli
from envs.aircraft import Aircraft
from envs.scenarios import expected
from ros_bridge.core.freshness import USUAL_FRESHNESS, Freshness
from ros_bridge.core.reports import UNKNOWN_WIND_STD, USUAL, WIND_STD

NODES = ("runner", "monitor", "simulator", "translator", "pilot")
"""Names of the nodes; the node of each is called ``rlcas_`` and the name."""

_UNITS = {"D": "m", "V": "m/s", "T": "s"}


class Parameter(NamedTuple):
    """One parameter of some nodes."""

    nodes: str  # names with blanks
    name: str
    default: Any
    """A number or a switch in the unit, or a text; a text beside a range is the aircraft's field of
    that name, or for how long such a thing counts (:mod:`ros_bridge.core.freshness`).
    """
    meaning: str
    low: float | None = None  # None: it is no number
    high: float | None = None
    unit: str = ""
    fixed: bool = False  # whether it is read once, when the node starts

    @property
    def help(self) -> str:
        """The meaning, and whether it can be changed while the node runs."""
        return f"{self.meaning}; read at the start" if self.fixed else self.meaning

    def in_si(self, aircraft: Aircraft | None, aircraft_values: dict[str, float]) -> "Parameter":
        """Return the parameter in SI units; ``aircraft_values`` are by name."""
        if self.low is None or self.high is None:
            return self
        default = aircraft_values[self.default] if isinstance(self.default, str) else self.default
        if self.unit not in _UNITS or aircraft is None:
            return self._replace(default=default)
        size = {"D": aircraft.separation, "V": aircraft.limits.speed_max, "T": aircraft.dt}[
            self.unit
        ]
        default *= 1.0 if isinstance(self.default, str) else size
        return self._replace(
            default=default, low=self.low * size, high=self.high * size, unit=_UNITS[self.unit]
        )


_ALL, _BOTH = "runner monitor simulator pilot", "runner monitor"

PARAMETERS = (
    Parameter(
        _ALL,
        "aircraft",
        "",
        "file of the aircraft, or a name that ships (uas); empty: the policy's",
        fixed=True,
    ),
    Parameter(_ALL, "policy_file", "", "policy file; empty: the one that ships", fixed=True),
    Parameter(
        _ALL,
        "extensions",
        "",
        "inputs of your own that the policy needs, module:name with commas; empty: none",
        fixed=True,
    ),
    Parameter(
        "runner",
        "policy_sha256",
        "",
        "digest that the policy must have, 64 digits; empty: any",
        fixed=True,
    ),
    Parameter(
        "runner",
        "outside_domain",
        "refuse",
        "an aircraft that the policy was not trained for: refuse or allow",
        fixed=True,
    ),
    Parameter(
        _ALL,
        "speed_min",
        "speed_min",
        "lowest airspeed that the vehicle itself can fly",
        0.0,
        400.0,
        "m/s",
    ),
    Parameter(_ALL, "speed_max", "speed_max", "highest airspeed of the vehicle", 1.0, 400.0, "m/s"),
    Parameter(
        _ALL,
        "acceleration_min",
        "acceleration_min",
        "strongest deceleration of the vehicle",
        -40.0,
        -1e-4,
        "m/s^2",
    ),
    Parameter(
        _ALL,
        "acceleration_max",
        "acceleration_max",
        "acceleration that the vehicle has at every speed",
        1e-4,
        40.0,
        "m/s^2",
    ),
    Parameter(
        _ALL,
        "yaw_rate_max",
        "yaw_rate_max",
        "turn rate that the vehicle has at every speed",
        0.01,
        114.0,
        "deg/s",
    ),
    Parameter(_ALL, "separation", "separation", "least distance to every intruder", 1.0, 1e6, "m"),
    Parameter(
        _BOTH,
        "goal_radius",
        "goal_radius",
        "distance from a point of the route at which the route is rejoined",
        0.1,
        1e6,
        "m",
    ),
    Parameter(
        _BOTH,
        "margin",
        0.21,
        "added to the separation for the autopilot's distance from the plan (C208B)",
        0.0,
        5.0,
        "D",
    ),
    Parameter(
        _BOTH,
        "sigmas",
        2.0,
        "standard deviations of the intruders' positions added to the separation",
        0.0,
        10.0,
    ),
    Parameter(
        _BOTH,
        "waypoints",
        20,
        "waypoints of a plan, the last of them a point of the route",
        4,
        400,
        fixed=True,
    ),
    Parameter(
        _BOTH,
        "spacing",
        20,
        "time from waypoint to waypoint, a multiple of 5",
        5,
        400,
        "steps",
        fixed=True,
    ),
    Parameter(
        "runner",
        "rejoin_by",
        0.0,
        "latest time at which the route is rejoined; 0: the plan's",
        0.0,
        4e4,
        "T",
    ),
    Parameter(
        "runner",
        "deadline",
        0.05,
        "computation after which the best plan so far is taken",
        0.001,
        60.0,
        "s",
    ),
    Parameter(
        _BOTH,
        "vertical_filter",
        600.0,
        "height above or below the ownship beyond which intruders are left out",
        300.0,
        5e4,
        "m",
    ),
    Parameter(
        _BOTH,
        "maneuvers",
        "horizontal",
        "what plans may do: horizontal (turns, speeds), vertical (climbs and descents along the "
        "route) or both; the last two need an aircraft whose file says how it climbs",
    ),
    *(
        Parameter(
            _BOTH,
            f"{name}_m",
            math.nan,
            f"{bound} altitude of plans that may climb, above own_altitude_reference; nan: any",
            unit="m",
        )
        for name, bound in (("floor", "least"), ("ceiling", "greatest"))
    ),
    Parameter(
        _BOTH,
        "vertical_margin_m",
        "vertical_margin",
        "added to the vertical separation of plans that may climb for the autopilot's distance "
        "from their altitude",
        0.0,
        5e3,
        "m",
    ),
    Parameter(
        _BOTH,
        "category_separations",
        "",
        "separations from aircraft of emitter categories, m, such as A5:2000,B6:300; empty: the "
        "same from all",
    ),
    Parameter(
        _BOTH,
        "category_vertical_separations",
        "",
        "vertical separations by category, m, such as B6:150; empty: vertical_filter",
    ),
    Parameter(
        _BOTH,
        "areas_file",
        "",
        "areas that do not move, besides those of the input: GeoJSON, ED-269, ED-318, .plan or "
        "ICAROUS YAML; empty: none",
        fixed=True,
    ),
    Parameter(
        _BOTH,
        "unknown_climb",
        10.0,
        "largest climb or descent of an aircraft that reports none",
        0.0,
        100.0,
        "m/s",
    ),
    Parameter(
        _BOTH,
        "unknown_position_std",
        USUAL.position_std,
        "standard deviation that is taken for positions without one (NACp 5)",
        0.0,
        1e4,
        "m",
    ),
    Parameter(
        _BOTH,
        "unknown_velocity_std",
        USUAL.velocity_std,
        "standard deviation that is taken for velocities without one (NACv 2)",
        0.0,
        100.0,
        "m/s",
    ),
    Parameter(
        _BOTH,
        "unknown_wind_std",
        UNKNOWN_WIND_STD,
        "standard deviation, about calm, that is taken for a wind that the ownship does not report",
        0.0,
        0.5,
        "V",
    ),
    Parameter(
        _BOTH,
        "wind_std",
        WIND_STD,
        "standard deviation of the wind that the ownship reports, per axis",
        0.0,
        0.2,
        "V",
    ),
    Parameter(
        f"{_BOTH} pilot",
        "ownship_max_age",
        USUAL_FRESHNESS.own,
        "oldest state of the ownship that is used",
        0.05,
        60.0,
        "s",
    ),
    Parameter(
        _BOTH,
        "intruder_max_age",
        "intruder",
        "oldest state of an intruder that is planned with; usually "
        f"{USUAL_FRESHNESS.intruder:g} s, or {USUAL_FRESHNESS.intruder:g} T where T is longer",
        0.1,
        600.0,
        "s",
    ),
    Parameter(
        "runner",
        "alert_max_age",
        "alert",
        f"time for which an alert counts; usually {USUAL_FRESHNESS.alert:g} s, or "
        f"{USUAL_FRESHNESS.alert:g} T where T is longer",
        1.0,
        3_600.0,
        "s",
    ),
    Parameter(
        "runner pilot",
        "monitor_silence",
        USUAL_FRESHNESS.monitor,
        "silence of the monitor after which the pilot commands nothing and the runner reports it",
        0.2,
        60.0,
        "s",
    ),
    Parameter(
        "runner",
        "request_max_age",
        USUAL_FRESHNESS.request,
        "oldest request that is answered",
        0.05,
        60.0,
        "s",
    ),
    Parameter(
        _BOTH,
        "future_tolerance",
        USUAL_FRESHNESS.future,
        "by how much a stamp may lie ahead of the clock",
        0.0,
        USUAL_FRESHNESS.future,
        "s",
    ),
    Parameter(
        _BOTH,
        "forget_after",
        "silence",
        "time without any message after which an intruder is forgotten; usually "
        f"{USUAL_FRESHNESS.silence:g} s, and never less than intruder_max_age",
        5.0,
        3_600.0,
        "s",
    ),
    Parameter(
        _BOTH,
        "jump_distance",
        500.0,
        "largest distance of a report from its expected place",
        10.0,
        1e4,
        "m",
    ),
    Parameter(
        _BOTH,
        "jump_speed",
        50.0,
        "growth of jump_distance with the time between reports",
        0.0,
        400.0,
        "m/s",
    ),
    Parameter(
        "runner", "extend_route", False, "whether a route that ends before the plan may be extended"
    ),
    Parameter(
        "runner",
        "exhaustive",
        True,
        "whether slow searches go on before giving up; not for the monitor",
    ),
    Parameter(
        "runner",
        "certificate",
        True,
        "whether SAFE plans carry what `python -m agents.check` proves; 3 ms",
    ),
    Parameter(
        "runner",
        "route_durability",
        "transient_local",
        "durability of the route input: transient_local or volatile",
        fixed=True,
    ),
    Parameter("monitor", "period", 0.05, "time between two checks", 0.02, 0.09, "s", fixed=True),
    Parameter(
        "monitor", "answer_time", 3.0, "time in which the runner must answer", 0.1, 10.0, "s"
    ),
    Parameter("monitor", "replan_interval", 2.0, "least time between two requests", 0.5, 60.0, "T"),
    Parameter(
        "monitor",
        "cross_track",
        0.025,
        "largest distance from the path; the margin where that is more",
        1e-3,
        1.0,
        "D",
    ),
    Parameter(
        "monitor",
        "along_track",
        0.05,
        "largest distance ahead of or behind the plan; the margin where that is more",
        1e-3,
        1.0,
        "D",
    ),
    Parameter(
        "monitor",
        "time_error",
        1.0,
        "largest delay or lead; the margin at the least speed where that is more",
        0.1,
        60.0,
        "T",
    ),
    Parameter(
        "monitor",
        "intruder_position",
        0.05,
        "largest error of an intruder's position, besides 3 sigmas",
        1e-3,
        1.0,
        "D",
    ),
    Parameter(
        "monitor",
        "intruder_velocity",
        0.05,
        "largest error of an intruder's velocity, besides 3 sigmas",
        1e-3,
        1.0,
        "V",
    ),
    Parameter(
        "monitor",
        "runner_silence",
        USUAL_FRESHNESS.node,
        "silence of the runner that is reported as a fault",
        1.5,
        60.0,
        "s",
    ),
    Parameter(
        f"{_BOTH} translator",
        "diagnostics_period",
        1.0,
        "time between two messages of diagnostics",
        0.1,
        60.0,
        "s",
        fixed=True,
    ),
    Parameter(
        f"{_BOTH} simulator",
        "map_frame",
        "map",
        "frame that headers name, x east, y north of the geo-reference",
        fixed=True,
    ),
    Parameter(
        "simulator",
        "scenario",
        "crossing_left",
        f"scenario: {expected()}",
        fixed=True,
    ),
    Parameter("simulator", "seed", 0, "seed of the encounters", fixed=True),
    Parameter("simulator", "encounter", 0, "number of the first encounter", fixed=True),
    Parameter("simulator", "encounters", 1, "how many are flown, one after the other", fixed=True),
    Parameter(
        "simulator", "vehicle", "kinematic", "kinematic, point_mass or c208 (JSBSim)", fixed=True
    ),
    Parameter(
        "simulator",
        "flightgear",
        "",
        "HOST:PORT of a FlightGear that shows the c208 in real time; empty: none",
        fixed=True,
    ),
    Parameter(
        "simulator pilot",
        "monitor",
        True,
        "fly what the monitor selects, else the newest plan",
        fixed=True,
    ),
    Parameter(
        "simulator",
        "rate",
        20.0,
        "speed in times real time, at most, while no plan is sought",
        0.1,
        1_000.0,
    ),
    Parameter(
        "simulator",
        "deciding_rate",
        1.0,
        "speed in times real time while a plan is sought",
        0.1,
        1_000.0,
    ),
    Parameter(
        "simulator", "longest", 300.0, "time after which an encounter ends", 10.0, 900.0, "T"
    ),
    *(
        Parameter(
            "simulator",
            f"wind_{towards}",
            0.0,
            f"wind towards the {towards}, which carries all aircraft and which the ownship reports",
            -100.0,
            100.0,
            "m/s",
        )
        for towards in ("east", "north")
    ),
    Parameter(
        "simulator", "origin_latitude", 47.0, "latitude of the geo-reference", -89.0, 89.0, "deg"
    ),
    Parameter(
        "simulator", "origin_longitude", 8.0, "longitude of the geo-reference", -180.0, 180.0, "deg"
    ),
    Parameter(
        "simulator",
        "alert_distance",
        2.0,
        "an alert is given where aircraft would pass closer",
        0.0,
        50.0,
        "D",
    ),
    Parameter(
        "simulator",
        "ask_again",
        5.0,
        "time between requests while there is an alert and no plan",
        1.0,
        60.0,
        "s",
    ),
    *(
        Parameter(
            "simulator",
            f"{kind}_{name}",
            default,
            f"{meaning} of {reports}",
            span[0],
            span[1],
            unit,
        )
        for kind, reports, numbers in (
            (
                "own",
                "the ownship's reports",
                ((10.0, 0.5, 10.0), (0.05, 0.0, 2.0), (0.0, 0.0, 1.0)),
            ),
            (
                "traffic",
                "each intruder's reports",
                ((1.0, 0.1, 10.0), (0.4, 0.0, 5.0), (0.05, 0.0, 1.0)),
            ),
        )
        for name, (default, *span), unit, meaning in (
            ("rate", numbers[0], "Hz", "rate"),
            ("latency", numbers[1], "s", "latency"),
            ("dropout", numbers[2], "", "share that is lost"),
            ("position_std", (0.0, 0.0, 500.0), "m", "noise of the position, one sigma per axis,"),
            ("velocity_std", (0.0, 0.0, 50.0), "m/s", "noise of the velocity, one sigma per axis,"),
        )
    ),
    Parameter(
        "translator",
        "velocity_apart",
        0.2,
        "largest time between a fix and its velocity",
        0.0,
        2.0,
        "s",
    ),
    Parameter(
        "translator", "own_source", "none", "none, nav_sat_fix, inspva or inspvax", fixed=True
    ),
    Parameter(
        "translator",
        "own_id",
        "",
        "the ownship's name, such as its 24-bit address in hexadecimal",
        fixed=True,
    ),
    Parameter(
        f"{_BOTH} translator",
        "own_altitude_reference",
        "wgs84",
        "what altitudes are above: of the translator's fixes, of floor_m and ceiling_m: wgs84, "
        "msl, pressure",
        fixed=True,
    ),
    Parameter("translator", "traffic_source", "none", "none, adsb or nav_sat_fix", fixed=True),
    Parameter(
        "translator",
        "adsb",
        "",
        "live receivers with commas between them: tcp://HOST:30003, the URL of an aircraft.json, "
        "gdl90://0.0.0.0:4000 or flarm://HOST:2000; empty: none",
        fixed=True,
    ),
    Parameter(
        "translator", "traffic_id", "", "the intruder's name, where its source is a fix", fixed=True
    ),
    *(
        Parameter(
            "translator",
            f"adsb_{kind}_reference",
            "",
            f"what {kind} ADS-B altitudes are above; empty: unknown",
            fixed=True,
        )
        for kind in ("barometric", "geometric")
    ),
)


def of(node: str) -> Iterator[Parameter]:
    """Yield the parameters of a node."""
    return (parameter for parameter in PARAMETERS if node in parameter.nodes.split())


def help_text(node: str) -> str:
    """Return a node's parameters for ``--help``; D, V and T are explained where they are used."""
    lines = [
        f"  {parameter.name:20} {_format_default(parameter)} {parameter.unit}"
        f"{_range(parameter)}: {parameter.help}"
        for parameter in of(node)
    ]
    if any(parameter.unit in _UNITS for parameter in of(node)):
        lines.append("D, V, T: separation, greatest speed and time step of the aircraft")
    return "\n".join(lines)


def reference() -> str:
    """Return all parameters as tables in Markdown, each once, as they stand in
    docs/reference/ros-parameters.md.
    """
    parts: list[str] = []
    listed: set[Parameter] = set()
    for node in NODES:
        again = [f"`{parameter.name}`" for parameter in of(node) if parameter in listed]
        parts += [f"**{node}**", *([f"As above: {', '.join(again)}."] if again else [])]
        rows = ["| parameter | default | range | unit | meaning |", "|---|---|---|---|---|"]
        for parameter in of(node):
            if parameter not in listed:
                cells = (
                    f"`{parameter.name}`",
                    _format_default(parameter),
                    _range(parameter)[2:-1],
                    parameter.unit,
                    parameter.help,
                )
                rows.append(f"| {' | '.join(cells)} |")
        listed.update(of(node))
        parts += ["\n".join(rows)] if len(rows) > 2 else []
    return "\n\n".join(parts) + "\n"


def _range(parameter: Parameter) -> str:
    return "" if parameter.low is None else f" ({parameter.low:g} to {parameter.high:g})"


def _format_default(parameter: Parameter) -> str:
    if parameter.default in Freshness._fields:
        return f"{getattr(USUAL_FRESHNESS, parameter.default):g}"
    if isinstance(parameter.default, str):
        text = parameter.default or '""'
        return f"`{text}`" if parameter.low is None else "the aircraft's"
    return (
        str(parameter.default).lower()
        if isinstance(parameter.default, bool)
        else f"{parameter.default:g}"
    )


def main() -> None:
    """Print the tables."""
    Parser(prog="python -m ros_bridge.transport.parameters", description=__doc__).parse_args()
    print(reference(), end="")


if __name__ == "__main__":
    run_cli(main)
