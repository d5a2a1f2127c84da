"""Bands of vertical speed and of altitude: which are free, heading and speed held.

The manoeuvre of a vertical speed begins now: the aircraft changes its climb at its vertical
acceleration and holds the target until the end of the look-ahead. That of an altitude climbs or
descends at the greatest rate, levels off there and stays. Over the ground all of them fly straight
on, so that each intruder or area comes too near in the same times, whatever the target
(:mod:`agents.kernel.clearance`). In these times a *layer* of altitudes about it is shut: a band is
closed if its manoeuvre meets a layer, or leaves the floor or the ceiling.

Altitudes are those of the manoeuvre itself, changes of climb included, and errors and the vertical
margin are as bad as they may be, as in plans (:mod:`agents.kernel.levels`). Times of loss are exact
where all fly straight. What lies between two targets is proven by the manoeuvres to both ends of an
interval (:mod:`agents.assurance.vertical_manoeuvres`): where a band ends is good to a 64th of the
way between targets.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.assurance.bands import Bands
from agents.assurance.between import prove_between
from agents.assurance.inputs import no_areas
from agents.assurance.vertical_manoeuvres import (
    Bound,
    Flight,
    Times,
    first_below,
    least_above,
    to_altitude,
    to_climb,
)
from agents.kernel.areas import ActiveArea, area_clearance
from agents.kernel.clearance import Clearance, clearance
from agents.kernel.levels import Altitude, Gap, gap_between
from agents.kernel.separation import separation
from agents.kernel.traffic import Requirement, Traffic, Window
from agents.kernel.trajectory import straight_on
from agents.planner.answer import Field, Subject
from agents.planner.request.options import L, Options
from agents.planner.request.reports import Intruder, check_altitude, is_usable
from envs.aircraft import Vertical
from envs.areas import Keep, Level, uncomparable_limits, vertical_limits
from envs.arrays import Array, Float, Shaped
from envs.frames import Air, F
from envs.kinematics import VehicleState
from envs.trees import map_leaves, take

TARGETS = 81
"""Vertical speeds or altitudes that are looked at where none are asked for."""

_ROUNDING = 1e-6
"""m by which a floor or a ceiling may be passed for rounding's sake."""

_AFTER = 1e-9  # s after the request: later than it, and no time at all
_BLOCK = 200_000  # pieces of flights set against layers at once


class Altitudes(NamedTuple):
    """Altitudes of ownships ``[N]`` and of intruders ``[N, K]`` at the request, comparable."""

    reference: str  # such as "msl", of all of them
    own: Array  # m, [N]
    climb: Array  # of the ownship, m/s, [N]
    # by how much it may be higher or lower than its manoeuvre says, m, [N]
    error: Array
    gap: Gap  # with the errors of both, [N, K]


class Layers(NamedTuple):
    """Altitudes that are shut for some time, and whose they are; fields ``[N, L]``."""

    times: Times
    low: Bound  # below it is free; infinite: nothing is
    high: Bound  # above it is free; infinite: nothing is
    intruder: Array  # number; -1: an area's, or the floor or the ceiling
    area: Array  # number (agents.kernel.areas.ActiveArea); -1 likewise

    def mirrored(self) -> "Layers":
        """Return them upside down."""
        return self._replace(low=self.high.mirrored(), high=self.low.mirrored())

    def reversed(self) -> "Layers":
        """Return them with time going backwards."""
        return self._replace(
            times=self.times.reversed(), low=self.low.reversed(), high=self.high.reversed()
        )


def altitudes_of(own: Altitude, intruders: Sequence[Intruder[F]], options: Options[L]) -> Altitudes:
    """Return the altitudes of a request, ``[1]``, with its intruders' ``[1, K]``.

    An intruder whose altitude is unknown, out of range, or of another reference, counts at all
    altitudes.

    Raises:
        ValueError: the own altitude is out of range, or the own vertical speed is unknown.
    """
    check_altitude(Field(Subject.OWN_ALTITUDE), own)
    if own.vertical_speed is None:
        raise ValueError("the own vertical speed is None, expected a number: manoeuvres begin so")
    flown = replace(own, error=own.error + options.vertical_margin, climb_error=0.0)
    gaps = [_gap(flown, intruder, options) for intruder in intruders]
    return Altitudes(
        own.reference,
        np.array([own.value]),
        np.array([own.vertical_speed]),
        np.array([flown.error]),
        Gap(*np.reshape(gaps, (-1, len(Gap._fields))).T[:, None]),
    )


def _gap(own: Altitude, intruder: Intruder[F], options: Options[L]) -> Gap:
    other = intruder.altitude
    if other is None or other.reference != own.reference or not is_usable(intruder):
        return Gap(0.0, 0.0, np.inf, 0.0)
    return gap_between(own, other, intruder.age, intruder.vertical(options), options.unknown_climb)


def layers(
    own: VehicleState[Air],
    traffic: Traffic,
    requirement: Requirement,
    altitudes: Altitudes,
    look_ahead: float,
    areas: Shaped[Array, " N"] = None,
    floor: Level | None = None,
    ceiling: Level | None = None,
) -> Layers:
    """Return what is shut for ownships ``[N]`` that fly straight on among intruders ``[N, K]``.

    Args:
        traffic: the intruders; not their windows, but the altitudes say when they count.
        look_ahead: for how long is looked ahead, s.
        areas: that each ownship may meet at some altitude, as they are now, object ``[N]`` of
            tuples of :class:`agents.kernel.areas.ActiveArea`; None: none. They count while they are
            valid, whatever the ownship's altitude; the floor and the ceiling of one to be kept in
            are so for the ownship.
        floor: least altitude; None: any. Of another reference than the others nobody knows where it
            is, and all below is shut.
        ceiling: greatest altitude, likewise.
    """
    flown = [_intruder_layers(own, traffic, requirement, altitudes, look_ahead)]
    rows = no_areas(own.x.size) if areas is None else areas
    if any(rows):
        flown.append(_area_layers(own, rows, requirement.margin, altitudes, look_ahead))
    limits = [_limits(row, altitudes.reference, floor, ceiling) for row in rows]
    lowest, highest = np.array(limits, dtype=float).reshape(-1, 2).T
    flown.append(_limit_layers(lowest, highest, altitudes, look_ahead))
    shut = map_leaves(lambda *fields: np.concatenate(fields, axis=1), *flown)
    some_time = (shut.times.begin <= shut.times.end).any(axis=0)
    return take(shut, np.s_[:, some_time])


def vertical_speed_bands(
    shut: Layers,
    altitudes: Altitudes,
    vertical: Vertical,
    look_ahead: float,
    targets: Float[Array, "... B"] = None,
) -> Bands:
    """Return the bands of vertical speeds, ``[N, B]``.

    ``Bands.clearance`` is vertical: by how much, m, the whole flight might be lower, or higher,
    until it met a layer; negative where it would have to be higher, or lower, not to meet one, by
    the smaller of both; -inf where no altitude would do.

    Args:
        shut: what is met, within the look-ahead.
        vertical: what the ownship can do.
        look_ahead: for how long each manoeuvre is looked at, s.
        targets: vertical speeds, m/s, ascending, ``[B]`` or ``[N, B]``; None: :data:`TARGETS` of
            them within what the ownship can do.
    """
    if targets is None:
        targets = np.linspace(-vertical.descent_max, vertical.climb_max, TARGETS)

    def fly(rows: Array, target: Array) -> Flight:
        climb = altitudes.climb[rows, None]
        return to_climb(target, climb, vertical.acceleration, look_ahead)

    return _bands(targets, fly, shut, look_ahead)


def altitude_bands(
    shut: Layers,
    altitudes: Altitudes,
    vertical: Vertical,
    look_ahead: float,
    targets: Float[Array, "... B"] = None,
) -> Bands:
    """Return the bands of altitudes, ``[N, B]``; the arguments are those of
    :func:`vertical_speed_bands`.

    Targets are altitudes, m; None: :data:`TARGETS` of them between the lowest and the highest that
    can be flown within the look-ahead.
    """
    if targets is None:
        targets = np.linspace(*_reach(altitudes, vertical, look_ahead), TARGETS, axis=-1)

    def fly(rows: Array, target: Array) -> Flight:
        own, climb = altitudes.own[rows, None], altitudes.climb[rows, None]
        return to_altitude(target - own, climb, vertical, look_ahead)

    return _bands(targets, fly, shut, look_ahead)


def _reach(altitudes: Altitudes, vertical: Vertical, look_ahead: float) -> tuple[Array, Array]:
    """Return the lowest and the highest altitude of ownships within a time, s, m, ``[N]``."""
    fastest = np.array([-vertical.descent_max, vertical.climb_max])
    flight = to_climb(fastest, altitudes.climb[:, None], vertical.acceleration, look_ahead)
    nothing = Bound(*np.zeros((2, 1, 1)))
    end = Times(*np.full((2, 1, 1), look_ahead))
    low, high = (altitudes.own[:, None] + least_above(flight, nothing, end)).T
    return low, high


def _on_course(clearances: Clearance) -> Times:
    """Return when straight flights lose what they must keep, ``[N, K]``."""
    lost = np.isfinite(clearances.loss)
    return Times(np.where(lost, clearances.loss, 1.0), np.where(lost, clearances.until, 0.0))


def _intruder_layers(
    own: VehicleState[Air],
    traffic: Traffic,
    requirement: Requirement,
    altitudes: Altitudes,
    look_ahead: float,
) -> Layers:
    """Return the layers of intruders, ``[N, K]``."""
    gap = altitudes.gap
    # Of an intruder that is above or below now the present distance says nothing.
    begin = np.where(np.abs(gap.above) <= gap.near, -np.inf, _AFTER)
    window = Window(begin, np.full(begin.shape, np.inf))
    keeping = separation(traffic._replace(window=window), own, requirement)
    times = _on_course(clearance(straight_on(own, look_ahead), keeping))
    numbers = np.broadcast_to(np.arange(begin.shape[1]), begin.shape)
    return Layers(
        times,
        Bound(gap.above - gap.near, gap.climb - gap.widens),
        Bound(gap.above + gap.near, gap.climb + gap.widens),
        numbers,
        np.full(begin.shape, -1),
    )


def _area_layers(
    own: VehicleState[Air], areas: Array, margin: float, altitudes: Altitudes, look_ahead: float
) -> Layers:
    """Return the layers of areas, ``[N, A]``; rows with fewer areas are filled up."""
    rows = [
        _layers_of_areas(take(own, [n]), areas[n], margin, _Height.of(altitudes, n), look_ahead)
        for n in range(own.x.size)
    ]
    most = max(row.area.shape[1] for row in rows)
    nothing = np.zeros((1, 1))
    beyond = Bound(nothing, nothing)
    none = Layers(
        Times(nothing + 1.0, nothing),
        beyond,
        beyond,
        intruder=np.full((1, 1), -1),
        area=np.full((1, 1), -1),
    )

    def fill(field: Array, absent: Array) -> Array:
        padding = np.repeat(absent, most - field.shape[1], axis=1)
        return np.concatenate([field, padding], axis=1)

    filled = [map_leaves(fill, row, none) for row in rows]
    return map_leaves(lambda *fields: np.concatenate(fields), *filled)


class _Height(NamedTuple):
    """Where an ownship is."""

    altitude: float  # m
    error: float  # m
    reference: str

    @classmethod
    def of(cls, altitudes: Altitudes, row: int) -> "_Height":
        """Return the ownship of a row."""
        return cls(float(altitudes.own[row]), float(altitudes.error[row]), altitudes.reference)

    def above(self, level: Level | None, without: float) -> float:
        """Return how far a level is above the ownship, m; ``without``: where there is none."""
        if level is None or level.reference != self.reference:
            return without
        return level.value - self.altitude


def _layers_of_areas(
    own: VehicleState[Air],
    areas: tuple[ActiveArea, ...],
    margin: float,
    height: _Height,
    look_ahead: float,
) -> Layers:
    """Return the layers of the areas of one ownship ``[1]``, ``[1, A]``."""
    # An area that counts several times in level flight is one.
    every = {active.number: active.area for active in areas}
    low, high, active = list[float](), list[float](), list[ActiveArea]()
    for number, area in every.items():
        counts = area.keep is Keep.OUT
        low.append(height.above(area.floor, -np.inf) - height.error if counts else -np.inf)
        high.append(height.above(area.ceiling, np.inf) + height.error if counts else np.inf)
        begin = max(area.valid_from, 0.0 if low[-1] <= 0.0 <= high[-1] else _AFTER)
        active.append(ActiveArea(number, area, begin, min(area.valid_until, look_ahead)))
    keeping = area_clearance(active, own.x, own.y, margin)
    times = _on_course(clearance(straight_on(own, look_ahead), keeping))
    still = np.zeros((1, len(active)))
    return Layers(
        times,
        Bound(np.array([low]), still),
        Bound(np.array([high]), still),
        np.full(still.shape, -1),
        np.array([list(every)], dtype=int),
    )


def _limits(
    areas: tuple[ActiveArea, ...], reference: str, floor: Level | None, ceiling: Level | None
) -> tuple[float, float]:
    """Return the least and the greatest altitude, m, those of areas to be kept in included; one of
    another reference may be anywhere, so that the ownship may only stay.
    """
    of_areas = [active.area for active in areas]
    lowest, highest = vertical_limits(of_areas, reference, floor, ceiling)
    unknown = uncomparable_limits(of_areas, reference, floor, ceiling)
    low = -np.inf if lowest is None else lowest.value
    high = np.inf if highest is None else highest.value
    return np.inf if "floor" in unknown else low, -np.inf if "ceiling" in unknown else high


def _limit_layers(lowest: Array, highest: Array, altitudes: Altitudes, look_ahead: float) -> Layers:
    """Return the layers below least altitudes and above greatest ones, m, ``[N]``, which count
    always: ``[N, 2]``. An ownship that is nearer than its error may stay, but not go farther.
    """
    above_floor = np.minimum(lowest + altitudes.error - altitudes.own, 0.0) - _ROUNDING
    below_ceiling = np.maximum(highest - altitudes.error - altitudes.own, 0.0) + _ROUNDING
    never = np.full(lowest.shape, np.inf)
    low = np.stack([-never, below_ceiling], axis=1)
    high = np.stack([above_floor, never], axis=1)
    nobody = np.full(low.shape, -1)
    return Layers(
        Times(np.zeros(low.shape), np.full(low.shape, look_ahead)),
        Bound(low, np.zeros(low.shape)),
        Bound(high, np.zeros(low.shape)),
        nobody,
        nobody,
    )


def _bands(
    targets: Array, fly: Callable[[Array, Array], Flight], shut: Layers, look_ahead: float
) -> Bands:
    """Return the bands of one kind, of so many rows at once as memory allows.

    ``fly`` gives the flights of some rows, by their numbers ``[R]``, to targets ``[R, B]``.
    """
    count, size = shut.area.shape
    targets = np.broadcast_to(targets, (count, np.shape(targets)[-1]))
    step = max(_BLOCK // (size * targets.shape[1]), 1)
    parts = []
    for first in range(0, max(count, 1), step):
        rows = np.arange(first, min(first + step, count))
        parts.append(_block(rows, targets[rows], fly, take(shut, rows), look_ahead))
    return Bands(*map(np.concatenate, zip(*parts, strict=True)))


def _block(
    rows: Array,
    target: Array,
    fly: Callable[[Array, Array], Flight],
    shut: Layers,
    look_ahead: float,
) -> Bands:
    """Return the bands of some rows; targets and layers are theirs."""
    flight = fly(rows, target)
    losses = _lost(flight, flight, shut)
    first = np.argmin(losses, axis=-1)
    loss = losses.min(axis=-1)
    intruder, area = (
        np.where(np.isfinite(loss), np.take_along_axis(number, first, axis=1), -1)
        for number in (shut.intruder, shut.area)
    )
    until = -_lost(flight.reversed(), flight.reversed(), shut.reversed()).min(axis=-1)

    def judge(rows_judged: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Judge intervals by the manoeuvres to their ends, between which the others are."""
        met = _lost(
            fly(rows[rows_judged], low), fly(rows[rows_judged], high), take(shut, rows_judged)
        ).min(axis=-1)
        return np.isinf(met), np.minimum(met, look_ahead)

    between = prove_between(target, np.isfinite(loss), judge, circle=False)
    return Bands(
        target,
        np.minimum(flight.reached, look_ahead),
        loss,
        intruder,
        area,
        _clear(flight, shut).min(axis=-1),
        np.where(until >= look_ahead, np.inf, np.maximum(until, 0.0)),
        between.low,
        between.high,
        between.nearby,
    )


def _lost(lowest: Flight, highest: Flight, shut: Layers) -> Array:
    """Return when a flight that is between two, ``[N, B]``, meets each layer first at the earliest,
    s, ``[N, B, L]``; inf: none does.

    Each of them begins above a layer or below it, or meets it at once; then it meets it where the
    lowest comes down to it, or the highest up.
    """
    wide, sides = _sides(lowest, highest, shut)
    down, up = (first_below(flight, bound, wide.times) for flight, bound in sides)
    return np.maximum(down, up)


def _clear(flight: Flight, shut: Layers) -> Array:
    """Return the clearances of flights ``[N, B]`` from layers, m, ``[N, B, L]``."""
    wide, sides = _sides(flight, flight, shut)
    above, below = (least_above(side, bound, wide.times) for side, bound in sides)
    return np.maximum(above, below)


def _sides(
    lowest: Flight, highest: Flight, shut: Layers
) -> tuple[Layers, list[tuple[Flight, Bound]]]:
    """Return layers as they broadcast against flights ``[N, B]``, and what is to be above what:
    the flight above the layer, and upside down likewise.
    """
    wide = take(shut, np.s_[:, None])
    low, high = (take(flight, np.s_[:, :, None]) for flight in (lowest, highest))
    return wide, [(low, wide.high), (high.mirrored(), wide.mirrored().high)]
