"""The certificate of a SAFE plan: what an independent checker needs to prove it anew (``python -m
agents.check FILE``).

A certificate is one JSON object: the ownship, the published waypoints, the controls of the legs
between them through the air, the intruders as reported, the requirement, the limits and the wind,
and a bound of the distance to each intruder. States are over the ground. Lengths are in m, angles
in rad, times in s after the request (docs/explanation/safe-theorem.md lists the fields).
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.kernel.levels import Altitude, Heights, Line, apart, lines, steady, vertical_gap, worst
from agents.kernel.traffic import advance_reports
from agents.kernel.trajectory import FINE
from agents.planner.answer import UNKNOWN_FLIGHT, Apart, Excluded, Flight
from agents.planner.judge.validator import validate
from agents.planner.request.climbs import with_levels_of
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.reports import Intruder, arrays_of_reports, level_columns, report_in_air
from agents.planner.request.request import in_wind
from envs import waypoints
from envs.areas import Area, Circle
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.profile import Profile, profile_of
from envs.trees import map_leaves
from envs.waypoints import Waypoint
from envs.wind import NO_WIND, Wind

FORMAT = "RLCAS plan certificate 4"

_BEYOND = 1.0  # s by which the times in which an intruder is apart go on after a plan
_STEP = 1e-5  # to whose multiples the bounds of distances are rounded down, m


@dataclass(frozen=True, slots=True)
class Evidence:
    """A plan and the request that it was made for."""

    own: VehicleState[Ground]  # at the request, in floats
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]]  # as they were reported
    published: Sequence[Waypoint]
    excluded: Sequence[Excluded]
    own_altitude: Altitude | None
    options: Options
    wind: Wind | None = None
    areas: Sequence[Area] = ()

    def certificate(self, flight: Flight = UNKNOWN_FLIGHT) -> bytes:
        """Return the certificate.

        Intruders that stay above or below stand there by their altitudes, as do the times in which
        others do; those that are out of reach are proven like all others. From a plan that climbs
        an intruder stays above or below on each line of its profile for itself.
        """
        options, altitude = self.options, self.own_altitude
        profile = self._profile()
        altitudes = self._altitudes(profile)
        passed = {
            report.number
            for report in self.excluded
            if report.apart is Apart.VERTICALLY and profile is None
        }
        reports = [
            report if isinstance(report, Intruder) else Intruder(report)
            for report in self.intruders
        ]
        counted = [report for number, report in enumerate(reports) if number not in passed]
        plan_states = waypoints.plan_states(self.own, self.published, wind=self.wind)
        curves, end = waypoints.legs(plan_states), self.published[-1].time + _BEYOND
        data = {
            "format": FORMAT,
            "request": flight._asdict(),
            "own": list(self.own),
            "waypoints": [
                [point.x, point.y, point.heading, point.speed, point.time]
                for point in self.published
            ],
            "controls": np.concatenate([curves.yaw_rate, curves.acceleration], axis=-1).tolist(),
            "intruders": [_report(report, options.requirement.separation) for report in counted],
            "excluded": [_heights(altitude, reports[number], options) for number in sorted(passed)],
            "apart": [
                row
                for number, report in enumerate(counted)
                for row in _apart(number, altitudes, report, end, options)
            ],
            "requirement": options.requirement._asdict(),
            "limits": {name: float(limit) for name, limit in options.limits._asdict().items()},
            "wind": {
                name: float(value) for name, value in (self.wind or NO_WIND)._asdict().items()
            },
            "areas": [_area(area, altitude) for area in self.areas],
            "levels": _levels(altitude, options.unknown_climb),
            "profile": None if altitude is None or profile is None else self._climbs(altitude),
            "parts": FINE,
            "bounds": _bounds(
                plan_states,
                curves,
                [report_in_air(report, self.wind) for report in counted],
                altitudes,
                in_wind(options, self.wind),
            ),
        }
        return json.dumps(data, separators=(",", ":"), allow_nan=False, default=float).encode()

    def _profile(self) -> Profile | None:
        """Return the profile of the waypoints; None: the plan is one in the plane."""
        own, options = self.own_altitude, self.options
        if own is None or not options.climbs:
            return None
        acceleration = options.vertical.acceleration
        return profile_of(own.value, own.climb(0.0)[0], self.published, acceleration)

    def _altitudes(self, profile: Profile | None) -> tuple[Line, ...]:
        """Return how the ownship's altitude changes."""
        if profile is None or self.own_altitude is None:
            return steady(self.own_altitude)
        return lines(profile, self.own_altitude, self.options.vertical_margin)

    def _climbs(self, own: Altitude) -> dict[str, Any]:
        """Return what a plan that climbs is flown with: its altitudes, m, the climb at the request,
        m/s, and what bounds them, with floors and ceilings of areas that must not be left.
        """
        options = with_levels_of(self.areas, own.reference, self.options)
        return {
            "altitudes": [point.altitude for point in self.published],
            "climb": own.climb(0.0)[0],
            "climb_max": options.vertical.climb_max,
            "descent_max": options.vertical.descent_max,
            "acceleration": options.vertical.acceleration,
            "margin": options.vertical_margin,
            "floor": None if options.floor is None else options.floor.value,
            "ceiling": None if options.ceiling is None else options.ceiling.value,
        }


def _report(report: Intruder[Ground], usual: float) -> list[float]:
    """Return a report with the separation that is to be kept from it, ``usual`` or its own, m."""
    errors = report.position_std, report.velocity_std
    separation = usual if report.separation is None else report.separation
    fields = (*report.state, report.age, report.turn_rate, report.turn_time, *errors, separation)
    return [float(field) for field in fields]


def _area(area: Area, own: Altitude | None) -> dict[str, Any]:
    """Return an area, with those of its heights that the ownship's can be compared with."""
    disc = area.shape if isinstance(area.shape, Circle) else None
    return {
        "keep": area.keep.value,
        "circle": [] if disc is None else [disc.x, disc.y, disc.radius],
        "rings": []
        if isinstance(area.shape, Circle)
        else [list(ring) for ring in area.shape.rings],
        "velocity": list(area.velocity),
        "growth": area.growth,
        "clearance": area.clearance,
        "valid": [
            float(time) if math.isfinite(time) else None
            for time in (area.valid_from, area.valid_until)
        ],
        "heights": [
            level.value
            if level is not None and own is not None and level.reference == own.reference
            else None
            for level in (area.floor, area.ceiling)
        ],
    }


def _levels(own: Altitude | None, unknown_climb: float) -> list[float] | None:
    """Return between which altitudes the ownship is at the request, m, and how they change, m/s."""
    if own is None:
        return None
    climb, spread = own.climb(unknown_climb)
    return [own.value - own.error, climb - spread, own.value + own.error, climb + spread]


def _heights(own: Altitude | None, report: Intruder[Ground], options: Options) -> list[float]:
    """Return both altitudes at their worst, m and m/s, the report's age, s, and the vertical
    separation, m.
    """
    other = report.altitude
    assert own is not None and other is not None  # nobody is excluded otherwise
    age, unknown = report.age, options.unknown_climb
    above = vertical_gap(own, other, age, 0.0, unknown) > 0.0
    return _row(worst(own, other, age, above, unknown), report.vertical(options))


def _apart(
    number: int, flight: Sequence[Line], report: Intruder[Ground], end: float, options: Options
) -> Iterator[list[float]]:
    """Yield the times in which an intruder stays above or below until a plan's end, with the
    altitudes that say so.
    """
    other, vertical = report.altitude, report.vertical(options)
    if not flight or other is None or flight[0].altitude.reference != other.reference:
        return
    for time in apart(flight, other, report.age, vertical, options.unknown_climb, end):
        yield [number, float(time.begin), float(time.end), *_row(time.heights, vertical)]


def _row(heights: Heights, vertical: float) -> list[float]:
    """Return altitudes at their worst, and the vertical separation, as the file has them."""
    return [*(float(value) for value in heights), float(vertical)]


def _bounds(
    plan_states: waypoints.PlanStates[Air],
    curves: waypoints.Legs[Air],
    reports: Sequence[Intruder[Air]],
    flight: Sequence[Line],
    options: Options[Narrowed],
) -> list[float]:
    """Return a lower bound of the distance from each intruder while it counts, m; 0: never."""
    if not reports:
        return []
    traffic = advance_reports(*arrays_of_reports(reports))
    # A row for each time in which one counts.
    numbers, window = level_columns(reports, flight, options)
    traffic = map_leaves(lambda field: field[:, numbers], traffic)._replace(window=window)
    traffic = map_leaves(lambda field: np.asarray(field).T, traffic)
    plans = map_leaves(lambda field: np.repeat(field[None], len(numbers), axis=0), plan_states)
    flown = waypoints.repeat(curves, len(numbers))
    findings = validate(plans, traffic, options.requirement, options.limits, curves=flown)
    least = np.full(len(reports), np.inf)
    np.minimum.at(least, np.array(numbers, dtype=int), findings.min_separation)
    return [
        math.floor(distance / _STEP - 1.0) * _STEP if math.isfinite(distance) else 0.0
        for distance in least.tolist()
    ]
