"""Slices of the state space on which the boundary of what can be avoided is asked twice, and how the answers compare.

A slice fixes both speeds and the courses; what varies is where the intruder starts. The frame is the ownship's at the
start, x ahead and y to the left.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.resolvability.classify import Verdict, classify
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from eval.boundary.extremal import best_separation
from eval.boundary.grid import Solution, value_at

__all__ = ["Answers", "Slice", "compare", "encounters_at", "judge", "values_at"]

# Lengths in separations.
_GOAL_AHEAD = 12.0  # the goal straight ahead: far beyond the conflict, near enough to be reached after any escape
_NEAR = 0.1  # values within this of the separation are near the boundary: there the errors are measured
_CLOSE = 0.02  # values within this of it are asked for on the finer raster
_MAP = 0.025  # distance of the points of the map

_FINER = 5  # how many times finer that raster is
_FLOWN = 400  # points near the boundary at which extremal flights are flown, besides all that are undecided


class Slice(NamedTuple):
    """Both aircraft's velocities."""

    name: str
    own_speed: float  # m/s
    intruder_speed: float  # m/s
    course_difference: float  # intruder's course less own course, rad clockwise

    @property
    def heading(self) -> float:
        """Intruder's heading in the ownship's frame, rad counter-clockwise in [-pi, pi)."""
        return float(wrap(np.float64(-self.course_difference), np))


class Answers(NamedTuple):
    """Both answers on a slice; points ``[M]``, the map ``[A, B]``."""

    slice: Slice
    x: Any  # where the intruder starts, m; first the raster, then the finer one near the boundary
    y: Any
    on_raster: Any  # whether a point is of the first raster, bool
    value: Any  # separation that can be kept by the fine grid, m
    rough: Any  # the same by the coarse grid, m
    verdict: Any  # of agents.resolvability.classify
    witnessed: Any  # separation of the witness, m; nan without one
    flown: Any  # separation of the best extremal flight, m; nan where none was flown
    map_x: Any  # [A], m
    map_y: Any  # [B], m
    map_value: Any  # by the fine grid, m, [A, B]


def values_at(solution: Solution, cut: Slice, x: Any, y: Any) -> Any:
    """Return the value where the intruder starts at (x, y), m, ``[...]``."""
    cosine, sine = math.cos(cut.heading), math.sin(cut.heading)
    relative = float(wrap(np.float64(-cut.heading), np))
    return value_at(solution, -cosine * x - sine * y, sine * x - cosine * y, relative, cut.own_speed)


def encounters_at(cut: Slice, x: Any, y: Any, aircraft: Aircraft) -> Encounter:
    """Return encounters ``[M]`` with the ownship at the origin and one straight intruder at (x, y) each."""
    zero, column = np.zeros(np.size(x)), np.zeros((np.size(x), 1))
    return Encounter(
        VehicleState(zero, zero, zero, zero + cut.own_speed),
        zero + _GOAL_AHEAD * aircraft.separation,
        zero,
        VehicleState(np.reshape(x, (-1, 1)), np.reshape(y, (-1, 1)), column + cut.heading, column + cut.intruder_speed),
        column == 0.0,
        Intent(column, column, column + aircraft.limits.yaw_rate_max),
        Sensor(column, column, column),
    )


def judge(cut: Slice, fine: Solution, coarse: Solution, spacing: float, aircraft: Aircraft) -> Answers:
    """Ask a fine and a coarse solution for the intruder's speed, and the verdicts, on a raster of such a spacing, m."""
    limits, separation = aircraft.limits, aircraft.separation
    map_x, map_y = _surroundings(cut, coarse, separation)
    map_value = values_at(fine, cut, *np.meshgrid(map_x, map_y, indexing="ij"))
    wide = _raster(map_x, map_y, spacing)
    dense = _raster(map_x, map_y, spacing / _FINER)
    close = np.abs(values_at(fine, cut, *dense) - separation) < _CLOSE * separation
    x, y = (np.concatenate([a, b[close]]) for a, b in zip(wide, dense, strict=True))
    value, rough = values_at(fine, cut, x, y), values_at(coarse, cut, x, y)
    judged = classify(encounters_at(cut, x, y, aircraft), aircraft.rules(), limits)
    near = _near(x, y, value, separation)
    few = np.flatnonzero(near)[:: max(math.ceil(np.sum(near) / _FLOWN), 1)]
    few = np.union1d(few, np.flatnonzero(near & (judged.verdict == Verdict.UNDECIDED)))
    # By then the closest approach of any escape is over.
    horizon = math.pi / limits.yaw_rate_max * 0.5 + separation / limits.speed_min
    flown = np.full(x.size, np.nan)
    flown[few] = best_separation(cut.own_speed, cut.heading, cut.intruder_speed, x[few], y[few], limits, horizon)
    raster = np.arange(x.size) < wide[0].size
    return Answers(cut, x, y, raster, value, rough, judged.verdict, judged.separation, flown, map_x, map_y, map_value)


def compare(answers: Answers, separation: float, spacing: float) -> dict[str, Any]:
    """Return the figures of a slice, m and km^2; ``disagreements`` are to be 0.

    An excess is the value less the separation: what the grid says can be kept beyond what is required.

    The grid's error is the most that halving it changes near the boundary, or by which the value differs there from
    the best flight that was flown, if that is more: either alone can be small by chance.
    """
    excess = answers.value - separation
    near = _near(answers.x, answers.y, answers.value, separation)
    halving = float(np.max(np.abs(answers.rough - answers.value), where=near, initial=0.0))
    off = (answers.value - answers.flown)[np.isfinite(answers.flown)]
    error = max(halving, float(np.max(np.abs(off), initial=0.0)))
    won, lost = answers.verdict == Verdict.RESOLVABLE, answers.verdict == Verdict.UNRESOLVABLE
    undecided = answers.verdict == Verdict.UNDECIDED
    avoidable, unavoidable = excess > error, excess < -error
    cell, map_cell = (spacing / 1_000.0) ** 2, (float(answers.map_x[1] - answers.map_x[0]) / 1_000.0) ** 2
    missed = np.flatnonzero(undecided & avoidable)
    # Witnesses far from the boundary are not judged: the grid cuts their values off.
    tight = won & (answers.witnessed < (1.0 + _NEAR) * separation)
    return {
        "name": answers.slice.name,
        "own_speed_mps": answers.slice.own_speed,
        "intruder_speed_mps": answers.slice.intruder_speed,
        "course_difference_deg": math.degrees(answers.slice.course_difference),
        "points": int(excess.size),
        "points_within_2_percent": int(np.sum(np.abs(excess) < _CLOSE * separation)),
        "resolvable": int(won.sum()),
        "unresolvable": int(lost.sum()),
        "undecided": int(undecided.sum()),
        "grid_error_m": error,
        "change_by_halving_m": halving,
        "value_less_best_flight_m": [_end(np.min, off), _end(np.max, off)],
        "agreements": int(np.sum(avoidable & won) + np.sum(unavoidable & lost)),
        "within_grid_error": int(np.sum(~avoidable & ~unavoidable)),
        "disagreements": {
            "avoidable_but_proven_unresolvable": int(np.sum(avoidable & lost)),
            "unavoidable_but_witnessed": int(np.sum(unavoidable & won)),
        },
        "least_resolvable_excess_m": _end(np.min, excess[won]),
        "greatest_unresolvable_excess_m": _end(np.max, excess[lost]),
        "undecided_excess_m": [_end(np.min, excess[undecided]), _end(np.max, excess[undecided])],
        "undecided_but_unavoidable": int(np.sum(undecided & unavoidable)),
        "undecided_but_avoidable": [
            {
                "ahead_m": float(answers.x[k]),
                "left_m": float(answers.y[k]),
                "value_m": float(answers.value[k]),
                "best_flight_m": float(answers.flown[k]) if np.isfinite(answers.flown[k]) else None,
            }
            for k in missed
        ],
        "greatest_witness_less_value_m": _end(np.max, (answers.witnessed - answers.value)[tight]),
        "unavoidable_area_km2": float(np.sum(answers.map_value < separation) * map_cell),
        "unresolvable_area_km2": float(np.sum(answers.on_raster & lost) * cell),
        "unresolvable_and_unavoidable_area_km2": float(np.sum(answers.on_raster & lost & (excess < 0.0)) * cell),
    }


def _end(end: Any, values: Any) -> float | None:
    return float(end(values)) if values.size else None


def _near(x: Any, y: Any, value: Any, separation: float) -> Any:
    """Return which points are near the boundary and do not start in violation, bool ``[M]``."""
    return (np.abs(value - separation) < _NEAR * separation) & (np.hypot(x, y) >= separation)


def _surroundings(cut: Slice, solution: Solution, separation: float) -> tuple[Any, Any]:
    """Return axes about all that is lost on a slice, with room around it, m."""
    reach, cell, room = float(np.max(np.abs(solution.grid.x))), _MAP * separation, 0.4 * separation
    axis = np.arange(-reach, reach, 2.0 * cell)
    lost = values_at(solution, cut, axis[:, None], axis[None, :]) < separation
    ends = [(axis[np.flatnonzero(lost.any(axis=k))[[0, -1]]]) for k in (1, 0)]
    return tuple(cell * np.arange(math.floor((a - room) / cell), math.ceil((b + room) / cell) + 1) for a, b in ends)


def _raster(map_x: Any, map_y: Any, spacing: float) -> tuple[Any, Any]:
    """Return the points of a raster through the origin within the map, m, ``[M]`` each."""
    axes = (spacing * np.arange(math.ceil(a[0] / spacing), math.floor(a[-1] / spacing) + 1) for a in (map_x, map_y))
    x, y = np.meshgrid(*axes, indexing="ij")
    return x.ravel(), y.ravel()
