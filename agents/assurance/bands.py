"""Guidance bands: which headings and which speeds are free, and where none is, which opens first.

A band's manoeuvre begins now: the aircraft turns onto the heading at its greatest rate, by the
shorter way, with the speed that it has, or changes its speed at its greatest acceleration on the
heading that it has, and holds what it has reached until the end of the look-ahead. A band is
*closed* if this manoeuvre comes closer to an intruder than is required of plans
(:func:`agents.kernel.traffic.requirement_of`, its growth with uncertainty, and the tolerance of
:mod:`agents.planner.judge.validator`), the intruders flying as the planner predicts them, or closer
to an area (:mod:`agents.assurance.area_bands`). So a band says what becomes of one manoeuvre that
is held. A plan may begin towards a closed band and turn away in time; it never holds one until its
loss (docs/explanation/alerts.md).

Clearances are good to 2 cm, and to 0.5 m where an intruder turns or its velocity is uncertain.
Times of loss are good to a second while the ownship turns or an intruder does, and exact after
that. All motion is relative to one mass of air: with wind, intruders' velocities are given less the
wind, and so are those of areas.
"""

from typing import NamedTuple

import numpy as np

from agents.assurance.area_bands import judge_manoeuvres
from agents.assurance.between import free_runs, prove_between
from agents.assurance.held import (
    ARC,
    Against,
    Ramp,
    Spread,
    against_traffic,
    judge_traffic,
)
from agents.assurance.inputs import no_areas
from agents.kernel.areas import Counted, area_clearance
from agents.kernel.clearance import clearance
from agents.kernel.separation import separation
from agents.kernel.traffic import Requirement, Traffic
from agents.kernel.trajectory import Steering, straight_on
from envs.angles import wrap
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.trees import take

HEADINGS = 72
"""Headings that are looked at where none are asked for: one every 5 degrees."""

SPEEDS = 21
"""Speeds likewise, from the lowest to the highest."""

_RAMP = 30  # steps of a change of speed over the whole range
_NO_RATE = 1e-9  # rad/s or m/s^2, of what cannot turn or change its speed
_ALIKE = 0.1  # separations by which a way may come closer than the best and open sooner
_BLOCK = 1_000_000  # distances at once


class Bands(NamedTuple):
    """Manoeuvres of one kind and what becomes of each; fields ``[N, B]``."""

    target: Array  # heading, rad in [-pi, pi), or speed, m/s, in ascending order
    reached: Array  # when the target is, s from now; the look-ahead where it is not within that
    # when less than the required distance is left first, s from now; inf where that is kept
    loss: Array
    # number of the intruder with which it is lost first; -1 where it is kept, or an area is earlier
    intruder: Array
    # number of the area (agents.kernel.areas.Counted) of which it is lost first; -1 likewise
    area: Array
    # Smallest distance less the required one, m; a lower bound where it is more than a fifth of the
    # separation, and of areas, too small by the way of 2 s at most; inf without any of them.
    clearance: Array
    # from when on the required distance is kept until the look-ahead's end, s; 0 where always, inf
    # where never
    opens: Array
    # About the target, as far as the neighbouring ones at most: from where to where all manoeuvres
    # are proven to keep the required distance, good to a 64th of the way between targets; the
    # target alone where it is closed. The heading opposite to the own one is reached from both
    # sides, and lies between two targets.
    low: Array
    high: Array
    # when a manoeuvre half-way to the neighbouring targets at most may lose the required distance
    # first, s from now; inf: none does
    nearby: Array

    @property
    def closed(self) -> Array:
        """Whether the manoeuvre loses the required distance within the look-ahead, ``[N, B]``."""
        return np.isfinite(self.loss)


class Recovery(NamedTuple):
    """The way out where no band is free; fields ``[N]``."""

    index: Array  # of the band; -1 where some band is free
    opens: Array  # from when on it keeps the required distance, s; inf: not within the look-ahead
    clearance: Array  # by how much it falls short of the required distance until then, m, negative


class Stretch(NamedTuple):
    """A stretch of neighbouring bands that are all free or all closed."""

    low: float  # where it begins: a heading, rad, may be beyond the circle's end; or a speed, m/s
    high: float
    closed: bool


def heading_bands(
    own: VehicleState[Air],
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    look_ahead: float,
    targets: Array = None,
    areas: Array = None,
) -> Bands:
    """Return the bands of headings, ``[N, B]``, of ownships ``[N]`` among intruders ``[N, K]``.

    Args:
        limits: of the ownship; its turn rate counts.
        look_ahead: for how long each manoeuvre is looked at, s.
        targets: headings, rad, ``[B]`` or ``[N, B]``, ascending where :func:`stretches` is asked
            for; None: :data:`HEADINGS` of them.
        areas: that each ownship may meet, as they are now (:class:`agents.kernel.areas.Counted`),
            object ``[N]``; None: none.
    """
    if targets is None:
        targets = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS) - np.pi
    targets = np.broadcast_to(targets, (own.x.size, np.shape(targets)[-1]))
    turn = wrap(targets - own.heading[:, None], np)
    rate = max(limits.yaw_rate_max, _NO_RATE)
    ramp = Ramp(
        yaw_rate=np.array([rate, -rate]),
        acceleration=np.zeros(2),
        step=min(ARC / rate, look_ahead / _RAMP),
        change=turn,
    )
    against = against_traffic(own, traffic, requirement)
    return _bands(_Kind(own, wrap(targets, np), own.speed, True), ramp, against, look_ahead, areas)


def speed_bands(
    own: VehicleState[Air],
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    look_ahead: float,
    targets: Array = None,
    areas: Array = None,
) -> Bands:
    """Return the bands of speeds, ``[N, B]``; the arguments are those of :func:`heading_bands`.

    Targets are speeds, m/s, ascending; None: :data:`SPEEDS` of them within the limits.
    """
    if targets is None:
        targets = np.linspace(limits.speed_min, limits.speed_max, SPEEDS)
    targets = np.broadcast_to(targets, (own.x.size, np.shape(targets)[-1]))
    gain = targets - own.speed[:, None]
    rates = np.array(
        [max(limits.acceleration_max, _NO_RATE), min(limits.acceleration_min, -_NO_RATE)]
    )
    fastest = np.abs(gain / np.where(gain < 0.0, rates[1], rates[0])).max(initial=0.0)
    ramp = Ramp(
        yaw_rate=np.zeros(2),
        acceleration=rates,
        step=max(min(float(fastest), look_ahead) / _RAMP, 1e-3),
        change=gain,
    )
    against = against_traffic(own, traffic, requirement)
    kind = _Kind(own, targets, np.ones(own.x.shape), False)
    return _bands(kind, ramp, against, look_ahead, areas)


def losses_on_course(
    own: VehicleState[Air], traffic: Traffic, requirement: Requirement, look_ahead: float
) -> Array:
    """Return when each intruder comes closer than required if the ownship flies straight on, s from
    now, ``[N, K]``; inf: not within the look-ahead.
    """
    flown = straight_on(own, look_ahead)
    return clearance(flown, separation(traffic, own, requirement)).loss


def area_losses(
    own: VehicleState[Air], areas: tuple[Counted, ...], margin: float, look_ahead: float
) -> list[float]:
    """Return when an ownship ``[1]`` that flies straight on loses what it must keep of each area, s
    from now; inf: not within the look-ahead.
    """
    flown = straight_on(own, look_ahead)
    return clearance(flown, area_clearance(areas, own.x, own.y, margin)).loss[0].tolist()


def recovery(bands: Bands, separation: float) -> Recovery:
    """Return the way out of rows in which no band is free, ``[N]``.

    Of the bands that come no closer than the best one, but for a tenth of the separation (m), it is
    the one that opens soonest.
    """
    alike = bands.clearance >= bands.clearance.max(axis=1, keepdims=True) - _ALIKE * separation
    opens = np.where(alike, bands.opens, np.inf)
    order = np.lexsort((-bands.clearance, opens, ~alike), axis=1)
    rows, index = np.arange(order.shape[0]), order[:, 0]
    nothing_free = bands.closed.all(axis=1)
    return Recovery(
        np.where(nothing_free, index, -1), bands.opens[rows, index], bands.clearance[rows, index]
    )


def stretches(bands: Bands, row: int = 0, *, circle: bool = True) -> list[Stretch]:
    """Return the free and the closed stretches of one row, in ascending order.

    All manoeuvres of a free stretch are proven to keep the required distance (``Bands.low``). On a
    ``circle`` (headings) the last stretch ends where the first one begins.
    """
    begin, end = float(bands.target[row, 0]), float(bands.target[row, -1])
    whole = 2.0 * np.pi if circle else None
    runs = free_runs(bands.low[row], bands.high[row], whole)
    if whole is not None:
        # In ascending order from the first target on.
        begins = sorted(begin + (low - begin) % whole for low, _ in runs)
        lengths = {begin + (low - begin) % whole: high - low for low, high in runs}
        runs = [(low, low + lengths[low]) for low in begins]
        begin = runs[0][0] if runs else begin
        end = begin + whole
    found, last = list[Stretch](), begin
    for low, high in runs:
        found += [Stretch(last, low, closed=True), Stretch(low, high, closed=False)]
        last = high
    found.append(Stretch(last, end, closed=True))
    return [one for one in found if one.high > one.low]


class _Kind(NamedTuple):
    """Ownships ``[N]`` whose manoeuvres of one kind are looked at."""

    own: VehicleState[Air]
    target: Array  # [N, B]
    change: Array  # of the velocity by a unit of change, m/s, [N]
    circle: bool


def _bands(kind: _Kind, ramp: Ramp, against: Against, look_ahead: float, areas: Array) -> Bands:
    """Return the bands of one kind, of so many rows at once as memory allows."""
    count, size = kind.own.x.size, against.base.shape[-1] * ramp.change.shape[-1]
    rows = max(_BLOCK // max(size, 1), 1)
    areas = no_areas(count) if areas is None else areas
    parts = []
    for first in range(0, max(count, 1), rows):
        part = slice(first, first + rows)
        some = kind._replace(
            own=take(kind.own, part), target=kind.target[part], change=kind.change[part]
        )
        turns = ramp._replace(change=ramp.change[part])
        parts.append(_block(some, turns, against.rows(part), look_ahead, areas[part]))
    return parts[0] if len(parts) == 1 else Bands(*map(np.concatenate, zip(*parts, strict=True)))


class _Judged(NamedTuple):
    """What manoeuvres keep of traffic and areas; fields ``[N, B]`` as those of bands."""

    loss: Array
    until: Array
    intruder: Array
    area: Array
    traffic_clearance: Array
    area_clearance: Array


def _judge(
    own: VehicleState[Air], ramp: Ramp, against: Against, look_ahead: float, areas: Array
) -> _Judged:
    """Judge manoeuvres against all that they may meet."""
    reached = np.minimum(ramp.reached, look_ahead)
    kept, intruder = judge_traffic(own, ramp, reached, against, look_ahead)
    steering = Steering(ramp.yaw_rate[ramp.side], ramp.acceleration[ramp.side], reached)
    amid, area = judge_manoeuvres(own, steering, areas, against.requirement.margin, look_ahead)
    by_area = amid.loss < kept.loss
    return _Judged(
        np.minimum(kept.loss, amid.loss),
        np.maximum(kept.until, amid.until),
        np.where(by_area, -1, intruder),
        np.where(by_area, area, -1),
        kept.clearance,
        amid.clearance,
    )


def _block(kind: _Kind, ramp: Ramp, against: Against, look_ahead: float, areas: Array) -> Bands:
    own = kind.own
    judged = _judge(own, ramp, against, look_ahead, areas)

    def judge(rows: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Judge intervals by the manoeuvre in their middle, which the others leave by their
        differences of velocity at most, from when the first of them has reached its target.
        """
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        ends = (ramp._replace(change=end).reached for end in (low, high))
        since = np.where(low * high <= 0.0, 0.0, np.minimum(*ends))
        since = np.minimum(since, look_ahead)
        inner = ramp._replace(change=middle)
        reached = np.minimum(inner.reached, look_ahead)
        rate = half * kind.change[rows, None]
        wider = against.rows(rows)._replace(
            allowance=float((rate * (reached - since)).max()),
            spread=Spread(rate[..., None], reached[..., None]),
        )
        found = _judge(take(own, rows), inner, wider, look_ahead, areas[rows])
        clearance = np.minimum(
            found.traffic_clearance, found.area_clearance - rate * (look_ahead - since)
        )
        return clearance >= 0.0, np.minimum(found.loss, look_ahead)

    closed = np.isfinite(judged.loss)
    between = prove_between(ramp.change, closed, judge, circle=kind.circle)
    return Bands(
        kind.target,
        np.minimum(ramp.reached, look_ahead),
        judged.loss,
        judged.intruder,
        judged.area,
        np.minimum(judged.traffic_clearance, judged.area_clearance),
        np.where(judged.until >= look_ahead, np.inf, np.maximum(judged.until, 0.0)),
        kind.target + (between.low - ramp.change),
        kind.target + (between.high - ramp.change),
        between.nearby,
    )
