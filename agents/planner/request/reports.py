"""Intruders as they were reported: checked, in the air mass, and as arrays.

Messages of what is refused name the field, the value and what was expected.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, cast

import numpy as np

from agents.kernel.levels import ALWAYS, Altitude, Line, level_times, window
from agents.kernel.traffic import Traffic, Window, turn_error
from agents.planner.answer import Field, RequestError, Subject
from agents.planner.request.fields import part_value, quote
from agents.planner.request.options import HIGHEST, LOWEST, L, Options
from envs.arrays import Array, Float
from envs.frames import Air, F, Ground
from envs.kinematics import FASTEST, VehicleState
from envs.wind import NO_WIND, Wind, through_air, turned_error

FARTHEST = 1e6
"""Coordinates beyond this, m, belong to no local frame, whatever the aircraft."""

AHEAD = 0.5
"""By how much a report may seem to come from the future, s."""

_LEAST = 1.0  # m of a separation
# rad of a declared turn: so far the rounding of positions is bounded (proofs/Rounding.g)
_MOST_TURN = 32.0


@dataclass(frozen=True, slots=True)
class Intruder(Generic[F]):
    """An intruder as it was reported.

    What stands here is believed: a standard deviation of 0 is an exact state. Where the accuracy is
    unknown, give the worst that is plausible.
    """

    state: VehicleState[F]
    """At the time of the report."""
    age: float = 0.0
    """Of the report at the request, s; the planner advances the state over it, along the turn while
    that lasts.
    """
    turn_rate: float = 0.0
    """With which it is expected to go on turning, rad/s, positive to the left."""
    turn_time: float = 0.0
    """For how long after the report (not after the request) it turns, s; straight ahead after that.
    """
    position_std: float = 0.0
    """One sigma per axis at the time of the report, m (of ADS-B: NACp's 95 % radius over 2.45)."""
    velocity_std: float = 0.0
    """One sigma per axis, m/s (from NACv likewise)."""
    altitude: Altitude | None = None
    """None: unknown, which counts as the same level."""
    separation: float | None = None
    """To be kept from it horizontally, m; None: ``Options.requirement``'s."""
    vertical_separation: float | None = None
    """Predicted vertical separation beyond which it does not count, m; None:
    ``Options.vertical_filter``, or the aircraft's where plans may climb.
    """
    turn_std: float = 0.0
    """One sigma of the turn rate, rad/s."""

    def vertical(self, options: Options[L]) -> float:
        """Return the vertical separation beyond which it does not count, m."""
        own = self.vertical_separation
        return options.vertical_separation if own is None else own


def check_state(name: Field, state: Any) -> VehicleState[Ground]:
    """Return a state of plain floats, heading wrapped."""
    if not isinstance(state, VehicleState):
        raise RequestError(name, f"is {type(state).__name__}, expected a VehicleState")
    x = part_value(name, "x", state.x, -FARTHEST, FARTHEST, "m")
    y = part_value(name, "y", state.y, -FARTHEST, FARTHEST, "m")
    heading = part_value(name, "heading", state.heading, -2.0 * math.pi, 2.0 * math.pi, "rad")
    speed = part_value(name, "speed", state.speed, 0.0, FASTEST.speed_max, "m/s")
    return VehicleState(x, y, math.remainder(heading, 2.0 * math.pi), speed)


def check_altitude(name: Field, altitude: Any) -> None:
    """Refuse what is neither an altitude nor None."""
    if altitude is None:
        return
    if not isinstance(altitude, Altitude):
        raise RequestError(name, f"is {type(altitude).__name__}, expected an Altitude or None")
    part_value(name, "value", altitude.value, LOWEST, HIGHEST, "m")
    if altitude.vertical_speed is not None:
        part_value(name, "vertical_speed", altitude.vertical_speed, -100.0, 100.0, "m/s")
    part_value(name, "error", altitude.error, 0.0, HIGHEST, "m")
    part_value(name, "climb_error", altitude.climb_error, 0.0, 100.0, "m/s")
    if not isinstance(altitude.reference, str) or not altitude.reference:
        problem = f"is {quote(altitude.reference)}, expected a name"
        raise RequestError(name.part("reference"), problem)


def check_report(name: Field, report: Intruder[Ground], options: Options[L]) -> Intruder[Ground]:
    """Return a report of plain floats."""
    state = check_state(name, report.state)
    if report.altitude is not None:
        check_altitude(name.part("altitude"), report.altitude)
    age = part_value(name, "age", report.age, -AHEAD, math.inf, "s")
    if age > options.max_age:
        raise RequestError(
            name.part("age"),
            f"is {age:g} s: the report is stale, expected {options.max_age:g} s at most",
        )
    rate = part_value(name, "turn_rate", report.turn_rate, -0.5, 0.5, "rad/s")
    lasts = part_value(name, "turn_time", report.turn_time, 0.0, 1_000.0, "s")
    if abs(rate) * lasts > _MOST_TURN:
        problem = (
            f"is {lasts:g} s: a turn of {abs(rate) * lasts:.0f} rad, expected {_MOST_TURN:g} "
            "rad at most"
        )
        raise RequestError(name.part("turn_time"), problem)
    vertical = report.vertical_separation
    return Intruder(
        state=state,
        age=age,
        turn_rate=rate,
        turn_time=lasts,
        turn_std=part_value(name, "turn_std", report.turn_std, 0.0, 0.5, "rad/s"),
        position_std=part_value(name, "position_std", report.position_std, 0.0, 10_000.0, "m"),
        velocity_std=part_value(name, "velocity_std", report.velocity_std, 0.0, 100.0, "m/s"),
        altitude=report.altitude,
        separation=_check_separation(name, "separation", report.separation),
        vertical_separation=_check_separation(name, "vertical_separation", vertical),
    )


def _check_separation(name: Field, kind: str, separation: Any) -> float | None:
    """Return a separation of an intruder's own, m; None: it has none."""
    if separation is None:
        return None
    return part_value(name, kind, separation, _LEAST, FARTHEST, "m")


def is_usable(report: Intruder[Any]) -> bool:
    """Return whether what a report says of altitudes, separations and the time of its turn is in
    range, as in :func:`check_report`.
    """
    name = Field(Subject.INTRUDERS)
    try:
        check_altitude(name, report.altitude)
        _check_separation(name, "separation", report.separation)
        _check_separation(name, "vertical_separation", report.vertical_separation)
    except RequestError:
        return False
    return report.turn_time >= 0.0


def usable_altitude(altitude: Altitude | None) -> Altitude | None:
    """Return an altitude, or None, unknown, where it is not finite or out of range."""
    try:
        check_altitude(Field(Subject.OWN_ALTITUDE), altitude)
    except RequestError:
        return None
    return altitude


def report_in_air(report: Intruder[Ground], wind: Wind | None) -> Intruder[Air]:
    """Return a report as the air mass sees it, which lies over the ground at the request.

    A turn is one through the air: its rate and its time stay.
    """
    if wind is None:  # in still air both are the same
        state = cast("VehicleState[Air]", report.state)
        velocity_std = velocity_std_in(report, state, NO_WIND)
        if velocity_std == report.velocity_std:
            return cast("Intruder[Air]", report)
        return with_state(report, state, velocity_std)
    state = through_air(report.state, wind, -report.age)
    return with_state(report, state, velocity_std_in(report, state, wind))


def with_state(report: Intruder[Any], state: VehicleState[F], velocity_std: float) -> Intruder[F]:
    """Return a report with another state, maybe in another frame, and one sigma of its velocity,
    m/s.
    """
    return replace(report, state=state, velocity_std=velocity_std)


def velocity_std_in(report: Intruder[Ground], state: VehicleState[Air], wind: Wind) -> float:
    """Return one sigma of the velocity, m/s, of an intruder with a state in the air mass of a wind:
    with what the errors of its turn rate and of the wind make of it.

    What the ground velocity becomes by a turn depends on the wind, whose error e moves it by up to
    ``2 e sin(turn / 2)``; the velocity's error of an intruder that turns grows by that at least.
    """
    turn = report.turn_rate * report.turn_time
    turned = turn_error(float(state.speed), report.turn_std, report.turn_time)
    return math.hypot(report.velocity_std, turned) + float(turned_error(turn, float(wind.std)))


def reports_in_air(
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]], wind: Wind | None
) -> list[Intruder[Air]]:
    """Return checked intruders as reports in the air mass."""
    return [
        report_in_air(intruder if isinstance(intruder, Intruder) else Intruder(intruder), wind)
        for intruder in intruders
    ]


class _Report(NamedTuple):
    """Numbers of a report; floats, or arrays ``[1, K]``."""

    x: Array  # m
    y: Array
    heading: Array  # rad
    speed: Array  # m/s
    turn_rate: Array  # these and the others as of :class:`Intruder`
    turn_time: Array
    position_std: Array
    velocity_std: Array
    age: Array


def arrays_of_reports(reports: Sequence[Intruder[Air]]) -> tuple[Traffic, Float[Array, "1 K"]]:
    """Return checked reports as arrays as of their own times, and their ages, s."""
    rows = [
        _Report(
            *report.state,
            report.turn_rate,
            report.turn_time,
            report.position_std,
            report.velocity_std,
            report.age,
        )
        for report in reports
    ]
    table = np.array(rows, dtype=float).reshape(len(rows), len(_Report._fields))
    columns = _Report(*table.T[:, None, :])
    own = [math.nan if report.separation is None else report.separation for report in reports]
    traffic = Traffic(
        state=VehicleState(columns.x, columns.y, columns.heading, columns.speed),
        mask=np.ones((1, len(rows)), dtype=bool),
        turn_rate=columns.turn_rate,
        turn_time=columns.turn_time,
        position_std=columns.position_std,
        velocity_std=columns.velocity_std,
        age=0.0 * columns.age,
        separation=None if all(map(math.isnan, own)) else np.array([own], dtype=float),
    )
    return traffic, columns.age


def level_columns(
    reports: Sequence[Intruder[F]], flight: Sequence[Line], options: Options[L]
) -> tuple[list[int], Window | None]:
    """Return the numbers of checked reports, each once for every time in which it counts, and these
    times, ``[1, C]``; None: all of them always.

    Args:
        reports: of the intruders.
        flight: altitude of the ownship; none: unknown, which counts as level.
        options: of the flight.
    """
    times = [
        (number, *time)
        for number, report in enumerate(reports)
        for time in times_of(report, flight, options)
    ]
    begin, end = (np.array([[time[part] for time in times]], dtype=float) for part in (1, 2))
    always = bool((begin <= 0.0).all() and (end == math.inf).all())
    return [number for number, _, _ in times], None if always else Window(begin, end)


def times_of(
    report: Intruder[F], flight: Sequence[Line], options: Options[L]
) -> list[tuple[float, float]]:
    """Return the times in which an intruder counts on a flight, s."""
    altitude, age, unknown = report.altitude, report.age, options.unknown_climb
    return level_times(flight, altitude, age, report.vertical(options), unknown)


def windows(
    reports: Sequence[Intruder[F]], own_altitude: Altitude | None, options: Options[L]
) -> Window | None:
    """Return when checked reports count, ``[1, K]``; None: all of them always."""
    if own_altitude is None:
        return None
    intervals = [
        window(
            own_altitude,
            report.altitude,
            report.age,
            report.vertical(options),
            options.unknown_climb,
        )
        for report in reports
    ]
    # What is known to never count was left out; where rounding says otherwise it counts.
    intervals = [interval if interval[0] <= interval[1] else ALWAYS for interval in intervals]
    if all(begin <= 0.0 and end == math.inf for begin, end in intervals):
        return None
    begin, end = np.array(intervals, dtype=float).T[:, None, :]
    return Window(begin, end)
