"""Altitudes of the attack: of plans that climb and descend, and what a SAFE one must keep of them.

The altitude of a plan is what its waypoints say, a line from each to the next, taken at their word.
That an aircraft can fly it is judged by flying it: from the climb at the request on, each change of
climb at the vertical acceleration, half before its corner and half after it, integrated over time.
Nothing of :mod:`envs.profile` or :mod:`agents.kernel.levels` is used.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from agents.planner.request.options import Maneuvers, default_vertical_margin
from agents.planner.request.request import Altitude, Intruder, Options
from benchmarks.safety.resimulation import Flown
from envs.aircraft import GREATEST_VERTICAL, LEAST_VERTICAL, Aircraft, Vertical
from envs.areas import Area, Keep, Level
from envs.arrays import Array
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint, Waypoint

__all__ = [
    "Band",
    "Corners",
    "band",
    "climbing",
    "corners",
    "draw_levels",
    "draw_options",
    "draw_own",
    "draw_reports",
    "draw_route",
    "faults",
    "flown_height",
    "move",
    "own_band",
    "random_vertical",
]

_EXACT = 1e-5  # of altitudes and climbs: m, m/s
_STEADY = 1e-6  # a change of climb that is none, m/s
_HALVINGS = 80  # of the first change of climb
_DEADLINE = 1.0  # s of computation
_REFERENCE = "msl"
_HIGHEST_SEPARATION, _LEVEL = 1_000.0, 15_000.0  # m


class Band(NamedTuple):
    """Between which altitudes an aircraft is at some times; fields ``[T]``."""

    low: Array
    """m."""
    high: Array
    """m."""


class Corners(NamedTuple):
    """What the waypoints of a plan say of its altitude; fields ``[C]``."""

    time: Array
    """s after the request, the request and the last waypoint included."""
    altitude: Array
    """m."""

    @property
    def climbs(self) -> Array:
        """Of the lines between them, m/s, ``[C - 1]``."""
        return np.diff(self.altitude) / np.diff(self.time)


def random_vertical(aircraft: Aircraft, rng: np.random.Generator) -> Vertical:
    """Return what an aircraft may do up and down: climbs at 4 to 30 % of its greatest speed, which
    it begins within 0.5 to 10 s, and a vertical separation of 2 to 40 % of the horizontal one, 1000
    m at most.
    """
    climb = aircraft.limits.speed_max * float(0.04 * 7.5 ** rng.uniform())
    descent = climb * float(rng.uniform(0.5, 2.0))
    acceleration = max(climb, descent) / float(0.5 * 20.0 ** rng.uniform())
    separation = min(aircraft.separation * float(0.02 * 20.0 ** rng.uniform()), _HIGHEST_SEPARATION)
    drawn = Vertical(climb, descent, acceleration, separation)
    return Vertical(
        *np.clip(np.array(drawn), np.array(LEAST_VERTICAL), np.array(GREATEST_VERTICAL)).tolist()
    )


def climbing(options: Options, rng: np.random.Generator) -> Options:
    """Return options of plans in the plane as those of plans that climb and descend, two of three
    with turns, which are given the time to be found beside climbs.
    """
    vertical = options.vertical
    margin = default_vertical_margin(vertical) * float(rng.choice([1.0, 1.0, 1.5, 4.0]))
    return replace(
        options,
        maneuvers=Maneuvers.BOTH if rng.random() < 2.0 / 3.0 else Maneuvers.VERTICAL,
        vertical_margin=min(margin, 5_000.0),
        altitude_weight=float(rng.choice([0.0, 0.1, 1.0, 1.0, 10.0])),
        deadline_s=_DEADLINE,
    )


def draw_options(options: Options, own: Altitude, rng: np.random.Generator) -> Options:
    """Return options with a floor, a ceiling or both for two of five requests."""
    vertical = options.vertical.separation
    floor, ceiling = options.floor, options.ceiling
    if rng.random() < 0.25:
        floor = Level(own.value - vertical * float(rng.uniform(0.0, 4.0)), own.reference)
    if rng.random() < 0.25:
        ceiling = Level(own.value + vertical * float(rng.uniform(0.01, 4.0)), own.reference)
    return replace(options, floor=floor, ceiling=ceiling)


def draw_own(options: Options, rng: np.random.Generator) -> Altitude:
    """Return the altitude of an ownship, which climbs or descends already in half of all cases."""
    vertical, climb = options.vertical, 0.0
    if rng.random() < 0.5:
        climb = float(rng.uniform(-1.1 * vertical.descent_max, 1.1 * vertical.climb_max))
    error = float(rng.uniform(0.0, 0.1)) * vertical.separation if rng.random() < 0.5 else 0.0
    return Altitude(_LEVEL, _REFERENCE, climb, error)


def draw_reports(
    intruders: Sequence[Intruder[Ground]],
    own: VehicleState[Ground],
    level: Altitude,
    options: Options,
    rng: np.random.Generator,
) -> list[Intruder[Ground]]:
    """Return reports with altitudes near that of the ownship when both would be closest if they
    flew straight on; of one in ten none is known.
    """
    vertical, reports = options.vertical, list[Intruder[Ground]]()
    for report in intruders:
        climb = 0.0
        if rng.random() < 0.5:
            climb = float(rng.uniform(-1.5, 1.5)) * max(vertical.climb_max, vertical.descent_max)
        when = _closest(own, report.state, 12.0 * options.interval)
        goes_on = (level.vertical_speed or 0.0) * when if rng.random() < 0.5 else 0.0
        apart = vertical.separation * float(rng.normal(0.0, 0.8))
        value = level.value + goes_on + apart - climb * (when + report.age)
        error = float(rng.uniform(0.0, 0.3)) * vertical.separation if rng.random() < 0.5 else 0.0
        known = rng.random() < 0.9
        altitude = Altitude(
            value,
            _REFERENCE if rng.random() < 0.95 else "wgs84",
            climb if known else None,
            error,
            0.05 * vertical.climb_max * float(rng.random() < 0.5) if known else 0.0,
        )
        own_least = vertical.separation * float(rng.choice([0.5, 2.0]))
        reports.append(
            replace(
                report,
                altitude=altitude if rng.random() < 0.9 else None,
                vertical_separation=own_least if rng.random() < 0.2 else None,
            )
        )
    return reports


def _closest(own: VehicleState[Ground], other: VehicleState[Ground], latest: float) -> float:
    """Return when two that fly straight on are closest, s from now, at ``latest`` at most."""
    velocity = other.speed * np.exp(1j * other.heading) - own.speed * np.exp(1j * own.heading)
    away = complex(other.x - own.x, other.y - own.y)
    when = -(away * np.conj(velocity)).real / max(abs(velocity) ** 2, 1e-9)
    return float(np.clip(when, 0.0, latest))


def draw_route(
    route: Sequence[RoutePoint], own: Altitude, options: Options, rng: np.random.Generator
) -> list[RoutePoint]:
    """Return a route whose points have an altitude to be kept, near the ownship's, in one of three
    cases.
    """
    if rng.random() >= 1.0 / 3.0:
        return list(route)
    level = own.value + options.vertical.separation * float(rng.normal(0.0, 1.5))
    return [replace(point, altitude=level) for point in route]


def draw_levels(
    areas: Sequence[Area], own: Altitude, options: Options, rng: np.random.Generator
) -> tuple[Area, ...]:
    """Return areas with a floor, a ceiling or both near the ownship's altitude, most of them; what
    must not be left holds it.
    """
    vertical, drawn = options.vertical.separation, []
    for area in areas:
        middle = own.value + vertical * float(rng.normal(0.0, 2.0))
        if area.keep is Keep.IN:
            middle = own.value
        half = vertical * float(rng.uniform(0.2, 3.0))
        floor = Level(middle - half, _REFERENCE) if rng.random() < 0.7 else None
        ceiling = Level(middle + half, _REFERENCE) if rng.random() < 0.7 else None
        drawn.append(replace(area, floor=floor, ceiling=ceiling))
    return tuple(drawn)


def band(altitude: Altitude, since: Array, options: Options) -> Band:
    """Return where an aircraft is that goes on climbing as reported, so long after its report, s,
    ``[T]``.
    """
    climb, off = altitude.vertical_speed, altitude.climb_error
    if climb is None:
        climb, off = 0.0, options.unknown_climb
    middle, width = altitude.value + climb * since, altitude.error + off * np.abs(since)
    return Band(middle - width, middle + width)


def own_band(
    altitude: Altitude | None, waypoints: Sequence[Waypoint], time: Array, options: Options
) -> Band | None:
    """Return where the ownship of a plan is at times after the request, s, ``[T]``, from its
    altitude at the request; None: that is unknown.
    """
    if altitude is None:
        return None
    if not options.climbs:
        return band(altitude, time, options)
    middle = np.interp(time, *corners(altitude, waypoints, options))
    spread = altitude.error + options.vertical_margin
    return Band(middle - spread, middle + spread)


def corners(altitude: Altitude, waypoints: Sequence[Waypoint], options: Options) -> Corners:
    """Return the corners of a plan: its waypoints, and before the first the one to which the climb
    at the request is kept.
    """
    times, altitudes = [0.0], [altitude.value]
    first, climb = waypoints[0], altitude.vertical_speed
    assert first.altitude is not None and climb is not None
    change = _first_change(first.altitude - altitude.value, climb, first.time, options)
    if abs(change) > _STEADY:
        corner = abs(change) / (2.0 * options.vertical.acceleration)
        times.append(corner)
        altitudes.append(altitude.value + climb * corner)
    for point in waypoints:
        assert point.altitude is not None
        times.append(point.time)
        altitudes.append(point.altitude)
    return Corners(np.array(times), np.array(altitudes))


def _first_change(rise: float, climb: float, time: float, options: Options) -> float:
    """Return the change of climb at once after the request, m/s, that makes an aircraft rise by so
    much in a time, s: by halving. The greatest where none suffices.
    """
    acceleration = options.vertical.acceleration
    missing = rise - climb * time
    low, high = 0.0, acceleration * time
    for _ in range(_HALVINGS):
        change = 0.5 * (low + high)
        begun = change / acceleration
        risen = 0.5 * acceleration * begun * begun + change * (time - begun)
        low, high = (change, high) if risen < abs(missing) else (low, change)
    return math.copysign(high, missing)


def faults(
    altitude: Altitude,
    waypoints: Sequence[Waypoint],
    flown: Flown,
    areas: Sequence[Area],
    options: Options,
) -> list[str]:
    """Return what is wrong with a plan's altitudes, but for what it meets.

    Args:
        altitude: at the request.
        waypoints: of the plan, all of which have altitudes.
        flown: the plan in the air mass, sampled, fields ``[S]``.
        areas: of which those to be kept in hold the plan between their floors and ceilings.
        options: how it was made.
    """
    vertical, own_climb = options.vertical, altitude.vertical_speed
    assert own_climb is not None
    profile = corners(altitude, waypoints, options)
    climbs, at = profile.climbs, profile.time[1:-1]
    half = np.abs(np.diff(climbs)) / (2.0 * vertical.acceleration)
    # The climb at the request is what it is, and kept for no longer than its change takes.
    begun = climbs[1:] if at.size and at[0] <= half[0] + _EXACT else climbs
    line = np.searchsorted(profile.time, flown.time, side="right") - 1
    along = np.hypot(flown.speed, climbs[np.clip(line, 0, climbs.size - 1)])
    fastest = max(options.limits.speed_max, math.hypot(float(flown.speed[0]), own_climb))
    planned = np.interp(flown.time, *profile)
    rounded = flown_height(profile, own_climb, vertical, flown.time)
    checks = {
        "climb": (begun > vertical.climb_max + _EXACT) | (begun < -vertical.descent_max - _EXACT),
        "climb of a waypoint": _stated_climbs(waypoints, climbs) > _EXACT,
        "changes of climb": np.append(0.0, (at + half)[:-1]) > at - half + _EXACT,
        "off the profile": np.abs(rounded - planned) > options.vertical_margin + _EXACT,
        "speed in a climb": along > fastest + _EXACT,
    }
    spread = altitude.error + options.vertical_margin
    for name, side, level, counts in _levels(areas, altitude, flown.time, options):
        over = side * (planned - level.value)
        # One that begins nearer to it than its errors may stay as near.
        checks[name] = counts & (over > max(-spread, float(over[0])) + _EXACT)
    return [name for name, bad in checks.items() if bad.any()]


def _stated_climbs(waypoints: Sequence[Waypoint], climbs: Array) -> Array:
    """Return by how much the climbs of waypoints differ from those of the lines that begin there,
    m/s, ``[W - 1]``.
    """
    stated = [math.nan if point.climb is None else point.climb for point in waypoints[:-1]]
    differ = np.abs(np.array(stated) - climbs[climbs.size - len(stated) :])
    return np.where(np.isnan(differ), np.inf, differ)


def _levels(
    areas: Sequence[Area], altitude: Altitude, time: Array, options: Options
) -> Iterator[tuple[str, float, Level, Array]]:
    """Yield the floors and ceilings of a flight: name, side (1: a ceiling), level, and at which of
    some times, s, ``[S]``, it counts.
    """
    sides = (("floor", -1.0), ("ceiling", 1.0))
    for name, side in sides:
        level = getattr(options, name)
        if level is not None:
            yield name, side, level, np.ones(time.size, dtype=bool)
    for area in areas:
        for name, side in sides:
            level = getattr(area, name)
            if level is None or level.reference != altitude.reference:
                continue
            if area.keep is Keep.IN:
                counts = (time >= area.valid_from) & (time <= area.valid_until)
                yield f"{name} of an area", side, level, counts


def flown_height(profile: Corners, climb: float, vertical: Vertical, time: Array) -> Array:
    """Return the altitude of an aircraft that flies round corners at times, s, ``[S]``: m.

    Its climb changes at the vertical acceleration, half before each corner and half after it.
    """
    changes, at = np.diff(profile.climbs), profile.time[1:-1]
    half = np.abs(changes) / (2.0 * vertical.acceleration)
    kept = half > 0.0
    changes, at, half = changes[kept], at[kept], half[kept]
    # Between those times the climb changes evenly, so that the trapezoidal rule is exact.
    every = np.unique(np.concatenate([[0.0], time, at - half, at + half]))
    every = every[every >= 0.0]
    share = np.clip((every[:, None] - at + half) / (2.0 * half), 0.0, 1.0)
    climbs = climb + share @ changes
    risen = np.cumsum(0.5 * (climbs[1:] + climbs[:-1]) * np.diff(every))
    return np.interp(time, every, profile.altitude[0] + np.append(0.0, risen))


def move(waypoints: Sequence[Waypoint], rng: np.random.Generator) -> tuple[Waypoint, ...]:
    """Return the waypoints of a plan with the altitude of one of them moved by 1 mm to 100 m."""
    size = float(10.0 ** rng.uniform(-3.0, 2.0) * rng.choice([-1.0, 1.0]))
    number = int(rng.integers(len(waypoints)))
    moved = list(waypoints)
    altitude = moved[number].altitude
    assert altitude is not None
    moved[number] = replace(moved[number], altitude=altitude + size)
    for place, (point, following) in enumerate(pairwise(moved)):
        assert point.altitude is not None and following.altitude is not None
        climb = (following.altitude - point.altitude) / (following.time - point.time)
        moved[place] = replace(point, climb=climb)
    return tuple(moved)
