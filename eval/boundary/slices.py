"""Slices of the state space: the boundary of what can be avoided, by two methods, and their
comparison.

The frame is the ownship's at the start, x ahead and y to the left.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.resolvability.classify import Verdict, classify
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.arrays import Array
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import Limits, VehicleState, advance
from envs.perception import Sensor
from eval.boundary.grid import Solution, value_at

# Lengths in separations.
# the goal straight ahead: far beyond the conflict, near enough to be reached after any escape
_GOAL_AHEAD = 12.0
# values within this of the separation are near the boundary: there the errors are measured
_NEAR = 0.1
_CLOSE = 0.02  # values within this of it are asked for on the finer raster
_MAP = 0.025  # distance of the points of the map
_FINER = 5  # how many times finer that raster is
_TURN = math.radians(1.5)  # in a time step at full rate
_COURSES = np.radians(np.arange(-220.0, 220.1, 2.0))
_SWITCHES = (0, 2, 4, 8, 12, 16, 22, 28, 36, 48, math.inf)  # time steps of deceleration
_BLOCK = 8
# points near the boundary at which extremal flights are flown, in addition to all undecided ones
_FLOWN = 400


class Slice(NamedTuple):
    """Both aircraft's velocities; what varies is where the intruder starts."""

    name: str
    own_speed: float  # m/s
    intruder_speed: float  # m/s
    course_difference: float  # intruder's course minus own course, rad clockwise

    @property
    def heading(self) -> float:
        """Intruder's heading in the ownship's frame, rad counter-clockwise in [-pi, pi)."""
        return float(wrap(np.float64(-self.course_difference), np))


class Answers(NamedTuple):
    """Both answers on a slice; points ``[M]``, the map ``[A, B]``."""

    slice: Slice
    x: Array  # where the intruder starts, m; first the raster, then the finer one near the boundary
    y: Array
    on_raster: Array  # whether a point is of the first raster, bool
    value: Array  # separation that can be kept by the fine grid, m
    rough: Array  # the same by the coarse grid, m
    verdict: Array  # of agents.resolvability.classify
    flown: Array  # separation of the best extremal flight, m; nan where none was flown
    map_x: Array  # [A], m
    map_y: Array  # [B], m
    map_value: Array  # by the fine grid, m, [A, B]


def values_at(solution: Solution, cut: Slice, x: Array, y: Array) -> Array:
    """Return the value where the intruder starts at (x, y), m, ``[...]``."""
    cosine, sine = math.cos(cut.heading), math.sin(cut.heading)
    relative = float(wrap(np.float64(-cut.heading), np))
    return value_at(
        solution, -cosine * x - sine * y, sine * x - cosine * y, relative, cut.own_speed
    )


def encounters_at(cut: Slice, x: Array, y: Array, aircraft: Aircraft) -> Encounter:
    """Return encounters ``[M]`` with the ownship at the origin and one straight intruder at (x, y)
    each.
    """
    zero, column = np.zeros(np.size(x)), np.zeros((np.size(x), 1))
    return Encounter(
        VehicleState(zero, zero, zero, zero + cut.own_speed),
        zero + _GOAL_AHEAD * aircraft.separation,
        zero,
        VehicleState(
            np.reshape(x, (-1, 1)),
            np.reshape(y, (-1, 1)),
            column + cut.heading,
            column + cut.intruder_speed,
        ),
        column == 0.0,
        Intent(column, column, column + aircraft.limits.yaw_rate_max),
        Sensor(column, column, column),
    )


def judge(
    cut: Slice, fine: Solution, coarse: Solution, spacing: float, aircraft: Aircraft
) -> Answers:
    """Ask a fine and a coarse solution for the intruder's speed, and the verdicts, on a raster of
    such a spacing, m.
    """
    limits, separation = aircraft.limits, aircraft.separation
    map_x, map_y = _surroundings(cut, coarse, separation)
    wide = _raster(map_x, map_y, spacing)
    dense = _raster(map_x, map_y, spacing / _FINER)
    close = np.abs(values_at(fine, cut, *dense) - separation) < _CLOSE * separation
    x, y = (np.concatenate([a, b[close]]) for a, b in zip(wide, dense, strict=True))
    value = values_at(fine, cut, x, y)
    verdict = classify(encounters_at(cut, x, y, aircraft), aircraft.rules(), limits).verdict
    return Answers(
        slice=cut,
        x=x,
        y=y,
        on_raster=np.arange(x.size) < wide[0].size,
        value=value,
        rough=values_at(coarse, cut, x, y),
        verdict=verdict,
        flown=_fly_some(cut, x, y, value, verdict, aircraft),
        map_x=map_x,
        map_y=map_y,
        map_value=values_at(fine, cut, *np.meshgrid(map_x, map_y, indexing="ij")),
    )


def _fly_some(
    cut: Slice, x: Array, y: Array, value: Array, verdict: Array, aircraft: Aircraft
) -> Array:
    """Return the separation of the best extremal flight, m, at some points near the boundary and at
    all undecided ones there, nan elsewhere, ``[M]``.
    """
    limits, separation = aircraft.limits, aircraft.separation
    near = _near(x, y, value, separation)
    chosen = np.flatnonzero(near)[:: max(math.ceil(np.sum(near) / _FLOWN), 1)]
    chosen = np.union1d(chosen, np.flatnonzero(near & (verdict == Verdict.UNDECIDED)))
    # By then the closest approach of any escape is over.
    horizon = math.pi / limits.yaw_rate_max * 0.5 + separation / limits.speed_min
    separations = np.full(x.size, np.nan)
    separations[chosen] = best_separation(
        cut.own_speed, cut.heading, cut.intruder_speed, x[chosen], y[chosen], limits, horizon
    )
    return separations


def compare(answers: Answers, separation: float, spacing: float) -> dict[str, Any]:
    """Return the figures of a slice, m and km^2; ``disagreements`` are to be 0, an excess is value
    less separation.

    The grid's error is the most that halving it changes near the boundary, or by which the value
    differs there from the best flight that was flown, if that is more: either alone can be small by
    chance.
    """
    excess, error = answers.value - separation, _grid_error(answers, separation)
    won = answers.verdict == Verdict.RESOLVABLE
    lost = answers.verdict == Verdict.UNRESOLVABLE
    undecided = answers.verdict == Verdict.UNDECIDED
    cell = (spacing / 1_000.0) ** 2
    map_cell = (float(answers.map_x[1] - answers.map_x[0]) / 1_000.0) ** 2
    return {
        "name": answers.slice.name,
        "own_speed_mps": answers.slice.own_speed,
        "intruder_speed_mps": answers.slice.intruder_speed,
        "course_difference_deg": math.degrees(answers.slice.course_difference),
        "points": int(excess.size),
        "resolvable": int(won.sum()),
        "unresolvable": int(lost.sum()),
        "undecided": int(undecided.sum()),
        "grid_error_m": error,
        "disagreements": {
            "avoidable_but_proven_unresolvable": int(np.sum((excess > error) & lost)),
            "unavoidable_but_witnessed": int(np.sum((excess < -error) & won)),
        },
        "least_resolvable_excess_m": _end(np.min, excess[won]),
        "greatest_unresolvable_excess_m": _end(np.max, excess[lost]),
        "undecided_excess_m": [_end(np.min, excess[undecided]), _end(np.max, excess[undecided])],
        "undecided_but_avoidable": int(np.sum(undecided & (excess > error))),
        "unavoidable_area_km2": float(np.sum(answers.map_value < separation) * map_cell),
        "unresolvable_area_km2": float(np.sum(answers.on_raster & lost) * cell),
    }


def _grid_error(answers: Answers, separation: float) -> float:
    """Return the grid's error near the boundary, m."""
    near = _near(answers.x, answers.y, answers.value, separation)
    halving = float(np.max(np.abs(answers.rough - answers.value), where=near, initial=0.0))
    off = (answers.value - answers.flown)[np.isfinite(answers.flown)]
    return max(halving, float(np.max(np.abs(off), initial=0.0)))


def _end(end: Callable[[Array], Array], values: Array) -> float | None:
    """Return the least or the greatest of some values, None where there are none."""
    return float(end(values)) if values.size else None


def _near(x: Array, y: Array, value: Array, separation: float) -> Array:
    """Return which points are near the boundary and do not start in violation, bool ``[M]``."""
    return (np.abs(value - separation) < _NEAR * separation) & (np.hypot(x, y) >= separation)


def _surroundings(cut: Slice, solution: Solution, separation: float) -> tuple[Array, Array]:
    """Return axes about all that is lost on a slice, with room around it, m."""
    reach, cell, room = float(np.max(np.abs(solution.grid.x))), _MAP * separation, 0.4 * separation
    axis = np.arange(-reach, reach, 2.0 * cell)
    lost = values_at(solution, cut, axis[:, None], axis[None, :]) < separation
    ends = [(axis[np.flatnonzero(lost.any(axis=k))[[0, -1]]]) for k in (1, 0)]
    return tuple(
        cell * np.arange(math.floor((a - room) / cell), math.ceil((b + room) / cell) + 1)
        for a, b in ends
    )


def _raster(map_x: Array, map_y: Array, spacing: float) -> tuple[Array, Array]:
    """Return the points of a raster through the origin within the map, m, ``[M]`` each."""
    axes = (
        spacing * np.arange(math.ceil(a[0] / spacing), math.floor(a[-1] / spacing) + 1)
        for a in (map_x, map_y)
    )
    x, y = np.meshgrid(*axes, indexing="ij")
    return x.ravel(), y.ravel()


def best_separation(
    own_speed: float,
    intruder_heading: float,
    intruder_speed: float,
    x: Array,
    y: Array,
    limits: Limits,
    horizon: float,
) -> Array:
    """Return the largest smallest distance of any flight of a fan within a horizon (s), m, ``[M]``:
    a lower bound.

    By Pontryagin's principle the best flight turns at full rate onto one course and holds it, at
    the strongest deceleration first (perhaps for no time) and then the strongest acceleration. The
    ownship starts at the origin, heading along x; the intruder flies straight from (x, y), m,
    ``[M]``. m/s, rad.
    """
    step = _TURN / limits.yaw_rate_max
    own_x, own_y = _fan(own_speed, limits, step, math.ceil(horizon / step))
    time = step * np.arange(own_x.shape[1])
    vx = intruder_speed * math.cos(intruder_heading)
    vy = intruder_speed * math.sin(intruder_heading)
    from_west, from_south = (
        (own_x - vx * time).astype(np.float32),
        (own_y - vy * time).astype(np.float32),
    )
    chord_x, chord_y = np.diff(from_west), np.diff(from_south)
    length = np.maximum(chord_x * chord_x + chord_y * chord_y, np.float32(1e-6))
    best = np.empty(np.shape(x))
    for first in range(0, best.size, _BLOCK):
        part = slice(first, first + _BLOCK)
        # Relative position at the beginning of each chord, [M', F, T].
        from_x = from_west[:, :-1] - np.asarray(x, np.float32)[part, None, None]
        from_y = from_south[:, :-1] - np.asarray(y, np.float32)[part, None, None]
        along = np.clip(-(from_x * chord_x + from_y * chord_y) / length, 0.0, 1.0)
        from_x += along * chord_x
        from_y += along * chord_y
        best[part] = np.sqrt(np.max(np.min(from_x * from_x + from_y * from_y, axis=2), axis=1))
    return best


def _fan(speed: float, limits: Limits, step: float, count: int) -> tuple[Array, Array]:
    """Return the positions of all flights at times 0, step, 2 step, ..., m, ``[F, T + 1]``."""
    course, switch = (grid.ravel() for grid in np.meshgrid(_COURSES, _SWITCHES))
    zero = np.zeros(course.size)
    own = VehicleState(zero, zero, zero, zero + speed)
    left_to_turn, x, y = course.copy(), [own.x], [own.y]
    for index in range(count):
        turn = np.clip(left_to_turn, -_TURN, _TURN)
        thrust = np.where(index >= switch, limits.acceleration_max, limits.acceleration_min)
        own = advance(own, thrust, turn / step, step, limits, np)
        left_to_turn = left_to_turn - turn
        x.append(own.x)
        y.append(own.y)
    return np.stack(x, axis=1), np.stack(y, axis=1)
