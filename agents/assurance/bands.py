"""Guidance bands: which headings and which speeds are free, and where none is, which opens first.

A band's manoeuvre begins now: the aircraft turns onto the heading at its greatest rate, by the
shorter way, with the speed that it has, or changes its speed at its greatest acceleration on the
heading that it has, and holds what it has reached until the end of the look-ahead. A band is
*closed* if this manoeuvre comes closer to an intruder than is required of plans
(:func:`agents.planner.traffic.requirement_of`, its growth with uncertainty, and the tolerance of
:mod:`agents.planner.validator`), the intruders flying as the planner predicts them, or closer to an
area (:mod:`agents.assurance.area_bands`). So a band says what becomes of one manoeuvre that is
held. A plan may begin towards a closed band and turn away in
time; it never holds one until its loss (docs/explanation/alerts.md).

Clearances are good to 2 cm, and to 0.5 m where an intruder turns or its velocity is uncertain.
Times of loss are good to a second while the ownship turns or an intruder does, and exact after
that. All motion is relative to one mass of air: with wind, intruders' velocities are given less the
wind, and so are those of areas.
"""

from typing import NamedTuple

import numpy as np

from agents.assurance.area_bands import Steering, judge_manoeuvres
from agents.assurance.inputs import no_areas
from agents.assurance.lookahead import growth
from agents.manoeuvres.direct_to_goal import arc_end
from agents.planner.traffic import (
    Requirement,
    Traffic,
    predict,
    requirement_of,
    separations,
    within_window,
)
from agents.planner.validator import CLOSE, ROUNDING
from envs.angles import wrap
from envs.arrays import Array
from envs.kinematics import Limits, VehicleState
from envs.relative import RelativeMotion, step_separation
from envs.trees import column, map_leaves, take

HEADINGS = 72
"""Headings that are looked at where none are asked for: one every 5 degrees."""

SPEEDS = 21
"""Speeds likewise, from the lowest to the highest."""

_ARC = np.radians(3.0)  # of turn in a step, own or an intruder's
_RAMP = 30  # steps of a change of speed over the whole range
_NO_RATE = 1e-9  # rad/s or m/s^2, of what cannot turn or change its speed
_PIECES = 16  # of straight flight, on each of which the required distance grows linearly
_INTEREST = 0.2  # separations of clearance
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
    # number of the area (agents.planner.areas.Counted) of which it is lost first; -1 likewise
    area: Array
    # Smallest distance less the required one, m; a lower bound where it is more than a fifth of the
    # separation, and of areas, too small by the way of 2 s at most; inf without any of them.
    clearance: Array
    # from when on the required distance is kept until the look-ahead's end, s; 0 where always, inf
    # where never
    opens: Array

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


class _Ramp(NamedTuple):
    """The two motions that lead to all targets of a kind."""

    yaw_rate: Array  # of each, rad/s, [2]
    acceleration: Array  # m/s^2, [2]
    side: Array  # which of the two leads to a target, [N, B]
    reached: Array  # when, s, [N, B]; inf where never
    target: Array
    step: float  # between the nodes at which the motions are looked at, s


class _Found(NamedTuple):
    """What a part of a manoeuvre holds; fields ``[N, B]`` or ``[N, B, K]``."""

    loss: Array
    until: Array  # when the required distance is missing last, s; -inf where never
    clearance: Array


class _Against(NamedTuple):
    """What is kept clear of; intruders ``[N, 1, K]``, or one for each of some pairs, ``[m, 1]``."""

    traffic: Traffic
    base: Array  # required before uncertainty grows, m
    requirement: Requirement

    @property
    def interest(self) -> float:
        """Clearance beyond which a lower bound of it will do, m."""
        return _INTEREST * self.requirement.separation

    def intruders_at(self, time: Array) -> VehicleState:
        """Return the intruders at some times, s, that broadcast."""
        return predict(self.traffic, time)

    def required_distance(self, time: Array) -> Array:
        """Return the required distance from each intruder at each time, m, less what the validator
        tolerates; the times broadcast against the intruders.
        """
        grown = self.base + growth(self.traffic, time, self.requirement.sigmas)
        need = np.maximum(grown - CLOSE, separations(self.traffic, self.requirement) - ROUNDING)
        # Where nothing grows, it is one distance for all times.
        return np.broadcast_to(need, np.broadcast_shapes(np.shape(need), np.shape(time)))

    def pick(self, which: tuple[Array, ...]) -> "_Against":
        """Return the intruders of some pairs, numbers of rows and of intruders, ``[m, 1]``."""
        n, k = which
        return self._replace(
            traffic=column(take(self.traffic, (n, 0, k))), base=self.base[n, 0, k, None]
        )


def heading_bands(
    own: VehicleState,
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
        areas: that each ownship may meet, as they are now (:class:`agents.planner.areas.Counted`),
            object ``[N]``; None: none.
    """
    if targets is None:
        targets = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS) - np.pi
    targets = np.broadcast_to(targets, (own.x.size, np.shape(targets)[-1]))
    turn = wrap(targets - own.heading[:, None], np)
    rate = max(limits.yaw_rate_max, _NO_RATE)
    return _bands(
        own,
        _Ramp(
            yaw_rate=np.array([rate, -rate]),
            acceleration=np.zeros(2),
            side=(turn < 0.0).astype(int),
            reached=np.abs(turn) / rate,
            target=wrap(targets, np),
            step=min(_ARC / rate, look_ahead / _RAMP),
        ),
        _against(own, traffic, requirement),
        look_ahead,
        areas,
    )


def speed_bands(
    own: VehicleState,
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
    side = (gain < 0.0).astype(int)
    reached = gain / rates[side]
    return _bands(
        own,
        _Ramp(
            yaw_rate=np.zeros(2),
            acceleration=rates,
            side=side,
            reached=reached,
            target=targets,
            step=max(min(float(reached.max(initial=0.0)), look_ahead) / _RAMP, 1e-3),
        ),
        _against(own, traffic, requirement),
        look_ahead,
        areas,
    )


def losses_on_course(
    own: VehicleState, traffic: Traffic, requirement: Requirement, look_ahead: float
) -> Array:
    """Return when each intruder comes closer than required if the ownship flies straight on, s from
    now, ``[N, K]``; inf: not within the look-ahead.
    """
    against, now = _against(own, traffic, requirement), np.zeros((own.x.size, 1))
    if against.base.size == 0:
        return np.full(traffic.mask.shape, np.inf)
    found = _combine(*_judge_hold(column(own), now, against, look_ahead))
    return np.where(traffic.mask, found.loss[:, 0], np.inf)


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

    An edge lies where the clearance between two neighbouring targets is 0 by interpolation. On a
    ``circle`` (headings) the last stretch ends where the first one begins.
    """
    target, clearance = bands.target[row], bands.clearance[row]
    if circle:
        target = np.append(target, target[0] + 2.0 * np.pi)
        clearance = np.append(clearance, clearance[0])
    closed = clearance < 0.0
    changes = np.flatnonzero(closed[1:] != closed[:-1])
    before, after = clearance[changes], clearance[changes + 1]
    places = target[changes] + before / (before - after) * (target[changes + 1] - target[changes])
    if circle and changes.size:
        bounds, states = np.append(places, places[0] + 2.0 * np.pi), closed[changes + 1]
    else:
        bounds = np.concatenate([target[:1], places, target[-1:]])
        states = np.append(closed[0], closed[changes + 1])
    return [
        Stretch(float(low), float(high), bool(state))
        for low, high, state in zip(bounds[:-1], bounds[1:], states, strict=True)
    ]


def _against(own: VehicleState, traffic: Traffic, requirement: Requirement) -> _Against:
    base = requirement_of(traffic, own, requirement)
    return _Against(column(traffic), base[:, None], requirement)


def _bands(
    own: VehicleState, ramp: _Ramp, against: _Against, look_ahead: float, areas: Array
) -> Bands:
    """Return the bands of one kind, of so many rows at once as memory allows."""
    count, size = own.x.size, against.base.shape[-1] * ramp.target.shape[-1]
    rows = max(_BLOCK // max(size, 1), 1)
    areas = no_areas(count) if areas is None else areas
    parts = []
    for first in range(0, count, rows):
        part = slice(first, first + rows)
        some = ramp._replace(
            side=ramp.side[part], reached=ramp.reached[part], target=ramp.target[part]
        )
        seen = against._replace(traffic=take(against.traffic, part), base=against.base[part])
        parts.append(_block(take(own, part), some, seen, look_ahead, areas[part]))
    return parts[0] if len(parts) == 1 else Bands(*map(np.concatenate, zip(*parts, strict=True)))


def _block(
    own: VehicleState, ramp: _Ramp, against: _Against, look_ahead: float, areas: Array
) -> Bands:
    reached = np.minimum(ramp.reached, look_ahead)
    found, intruder = _judge_traffic(own, ramp, reached, against, look_ahead)
    steering = Steering(ramp.yaw_rate[ramp.side], ramp.acceleration[ramp.side], reached)
    amid = judge_manoeuvres(own, steering, areas, against.requirement.margin, look_ahead)
    by_area = amid.loss < found.loss
    loss = np.minimum(found.loss, amid.loss)
    until = np.maximum(found.until, amid.until)
    return Bands(
        ramp.target,
        reached,
        loss,
        np.where(by_area, -1, intruder),
        np.where(by_area, amid.area, -1),
        np.minimum(found.clearance, amid.clearance),
        np.where(until >= look_ahead, np.inf, np.maximum(until, 0.0)),
    )


def _judge_traffic(
    own: VehicleState, ramp: _Ramp, reached: Array, against: _Against, look_ahead: float
) -> tuple[_Found, Array]:
    """Return what manoeuvres ``[N, B]`` hold against all intruders, and with which it is lost
    first, -1: with none.
    """
    if against.base.size == 0:
        none = np.full(reached.shape, np.inf)
        return _Found(none, -none, none), np.full(reached.shape, -1)
    arrival = _ramp_end(own, ramp, reached)
    found = _combine(
        _judge_ramp(own, ramp, arrival, reached, against),
        *_judge_hold(arrival, reached, against, look_ahead),
    )
    absent = ~against.traffic.mask
    loss = np.where(absent, np.inf, found.loss)
    until = np.where(absent, -np.inf, found.until).max(axis=-1)
    clearance = np.where(absent, np.inf, found.clearance).min(axis=-1)
    intruder, loss = np.argmin(loss, axis=-1), loss.min(axis=-1)
    return _Found(loss, until, clearance), np.where(np.isfinite(loss), intruder, -1)


def _combine(*parts: _Found) -> _Found:
    """Return what the parts of manoeuvres hold together."""
    first, *others = parts
    for other in others:
        first = _Found(
            np.minimum(first.loss, other.loss),
            np.maximum(first.until, other.until),
            np.minimum(first.clearance, other.clearance),
        )
    return first


def _state(own: VehicleState, yaw_rate: Array, acceleration: Array, time: Array) -> VehicleState:
    """Return where a turn at constant speed, or a straight acceleration, leads; arguments
    broadcast.
    """
    turn, speed = yaw_rate * time, own.speed + acceleration * time
    x, y = arc_end(own, turn, 0.5 * (own.speed + speed) * time)
    return VehicleState(x, y, own.heading + turn, speed)


def _ramp_end(own: VehicleState, ramp: _Ramp, time: Array) -> VehicleState:
    """Return the ownship on its way to each target at some times, ``[N, B]``."""
    return _state(column(own), ramp.yaw_rate[ramp.side], ramp.acceleration[ramp.side], time)


def _straight_on(own: VehicleState, seconds: Array) -> VehicleState:
    """Return ownships ``[...]`` after some seconds of straight flight, ``[..., S]``."""
    x, y, heading, speed = (field[..., None] for field in own)
    far = speed * seconds
    return VehicleState(x + far * np.cos(heading), y + far * np.sin(heading), heading, speed)


def _relative(own: VehicleState, other: VehicleState) -> RelativeMotion:
    """Return what :func:`envs.relative.relative_motion` does, for headings that are not wrapped."""
    east, north = own.speed * np.cos(own.heading), own.speed * np.sin(own.heading)
    return RelativeMotion(
        other.x - own.x,
        other.y - own.y,
        other.speed * np.cos(other.heading) - east,
        other.speed * np.sin(other.heading) - north,
    )


def _judge_step(
    first: RelativeMotion,
    last: RelativeMotion,
    begin: Array,
    end: Array,
    need: Array,
    need_after: Array,
) -> _Found:
    """Judge steps of motion from some times to others, s, at which some distances are required,
    m.
    """
    near = step_separation(first, last, end - begin, np)
    at_first, at_last = np.hypot(first.x, first.y) - need, np.hypot(last.x, last.y) - need_after
    between = near.distance - (need + near.share * (need_after - need))
    # At an end of the step the distance there counts, against what is required there.
    inside = (near.share > 0.0) & (near.share < 1.0)
    clearance = np.minimum(np.minimum(at_first, at_last), np.where(inside, between, np.inf))
    lost = clearance < 0.0
    until = np.where(at_last < 0.0, end, 0.5 * (begin + end))
    return _Found(np.where(lost, begin, np.inf), np.where(lost, until, -np.inf), clearance)


def _judge_steps(path: RelativeMotion, times: Array, need: Array, axis: int) -> _Found:
    """Judge the steps from node to node of a path along an axis."""
    before = tuple([slice(None)] * axis + [slice(None, -1)])
    after = tuple([slice(None)] * axis + [slice(1, None)])
    return _judge_step(
        take(path, before),
        take(path, after),
        times[before],
        times[after],
        need[before],
        need[after],
    )


def _drop_uncounted(found: _Found, traffic: Traffic, begin: Array, end: Array) -> _Found:
    """Return what parts of manoeuvres from some times to others, s, hold, but for those in which an
    intruder is above or below.
    """
    if traffic.window is None:
        return found
    counts = within_window(traffic, begin, end)
    return _Found(
        np.where(counts, found.loss, np.inf),
        np.where(counts, found.until, -np.inf),
        np.where(counts, found.clearance, np.inf),
    )


def _judge_ramp(
    own: VehicleState, ramp: _Ramp, arrival: VehicleState, reached: Array, against: _Against
) -> _Found:
    """Judge the way from the present to each target, ``[N, B, K]``.

    Both motions are looked at once, from node to node; a target has all steps before it, and a last
    one of its own.
    """
    step = min(ramp.step, _ARC / max(_fastest_turn(against), 1e-9))
    nodes = np.arange(int(np.ceil(float(reached.max()) / step - 1e-9)) + 1) * step
    times = nodes[None, :, None]
    there, need = against.intruders_at(times), against.required_distance(times)
    paths = []
    for yaw_rate, acceleration in zip(ramp.yaw_rate, ramp.acceleration, strict=True):
        moving = _state(column(own), yaw_rate, acceleration, nodes)
        paths.append(_relative(VehicleState(*(field[..., None] for field in moving)), there))
    path = RelativeMotion(*(np.stack(pair, axis=1) for pair in zip(*paths, strict=True)))
    both = np.broadcast_to(need[:, None], path.x.shape)
    each = _judge_steps(path, np.broadcast_to(times[:, None], path.x.shape), both, axis=2)
    wide, ends = map_leaves(lambda field: field[:, None], against.traffic), times[:, None]
    each = _drop_uncounted(each, wide, ends[:, :, :-1], ends[:, :, 1:])
    so_far = _Found(
        _accumulate(np.minimum, each.loss, np.inf),
        _accumulate(np.maximum, each.until, -np.inf),
        _accumulate(np.minimum, each.clearance, np.inf),
    )
    number = np.minimum((reached / step).astype(int), nodes.size - 1)
    rows = np.arange(reached.shape[0])[:, None]
    chosen = rows, ramp.side, number
    end = reached[..., None]
    last = _judge_step(
        take(path, chosen),
        _relative(
            VehicleState(*(field[..., None] for field in arrival)), against.intruders_at(end)
        ),
        nodes[number][..., None],
        end,
        need[rows, number],
        against.required_distance(end),
    )
    last = _drop_uncounted(last, against.traffic, nodes[number][..., None], end)
    return _combine(take(so_far, chosen), last)


def _fastest_turn(against: _Against) -> float:
    """Return the greatest turn rate of an intruder, rad/s."""
    traffic = against.traffic
    rate = np.where(traffic.mask & (traffic.turn_time > 0.0), np.abs(traffic.turn_rate), 0.0)
    return float(rate.max())


def _accumulate(function: np.ufunc, values: Array, nothing: float) -> Array:
    """Return what all steps before a node hold, ``[N, 2, nodes, K]``."""
    none = np.full((*values.shape[:2], 1, values.shape[-1]), nothing)
    return np.concatenate([none, function.accumulate(values, axis=2)], axis=2)


def _judge_hold(
    own: VehicleState, reached: Array, against: _Against, look_ahead: float
) -> tuple[_Found, ...]:
    """Judge straight flight from targets on, ``[N, B]``, until the end of the look-ahead, ``[N, B,
    K]``.
    """
    traffic = against.traffic
    turning = traffic.mask & (traffic.turn_rate != 0.0) & (traffic.turn_time > 0.0)
    turn_end = np.where(turning, np.minimum(traffic.turn_time, look_ahead), 0.0)
    straight_from = np.maximum(reached[..., None], turn_end)
    parts = [_judge_straight(own, reached, straight_from, against, look_ahead)]
    if turning.any():
        parts.append(_judge_among_turning(own, reached, straight_from, against))
    return tuple(parts)


def _judge_among_turning(
    own: VehicleState, reached: Array, until: Array, against: _Against
) -> _Found:
    """Judge straight flight from targets on until an intruder's turn ends, ``[N, B, K]``."""
    lasts = until - reached[..., None]
    there = against.intruders_at(reached[..., None])
    far = np.hypot(there.x - own.x[..., None], there.y - own.y[..., None])
    # No nearer than both flying at each other, and no more required than at the end.
    bound = far - (own.speed[..., None] + there.speed) * lasts - against.required_distance(until)
    bound = np.where(lasts > 0.0, bound, np.inf)
    found = _Found(np.full(bound.shape, np.inf), np.full(bound.shape, -np.inf), bound)
    which = np.nonzero(bound < against.interest)
    if which[0].size == 0:
        return found
    n, band, k = which
    one = against.pick((n, k))
    steps = int(np.ceil(float(lasts[which].max()) * _fastest_turn(one) / _ARC))
    since = np.linspace(0.0, 1.0, steps + 1) * lasts[which][:, None]
    times = reached[n, band, None] + since
    path = _relative(_straight_on(take(own, (n, band)), since), one.intruders_at(times))
    steps_of = _judge_steps(path, times, one.required_distance(times), 1)
    _write(found, which, _drop_uncounted(steps_of, one.traffic, times[:, :-1], times[:, 1:]))
    return found


def _judge_straight(
    own: VehicleState, reached: Array, begin: Array, against: _Against, look_ahead: float
) -> _Found:
    """Judge straight flight of both, from ``begin``, s, to the end of the look-ahead, in closed
    form, ``[N, B, K]``.
    """
    window, over = against.traffic.window, look_ahead
    if window is not None:
        begin, over = np.maximum(begin, window.begin), np.minimum(look_ahead, window.end)
    far = _relative(_straight_on(own, begin - reached[..., None]), against.intruders_at(begin))
    lasts = np.maximum(over - begin, 0.0)
    found = _judge_piece(
        far,
        begin,
        lasts,
        against.required_distance(begin),
        against.required_distance(begin + lasts),
    )
    found = _drop_uncounted(found, against.traffic, begin, over)
    if not (against.traffic.velocity_std.any() and against.requirement.sigmas):
        return found
    # Growth is convex: a straight line between its ends requires more. What is clear of that is
    # clear, the rest is judged in pieces; the growth bends most at first.
    which = np.nonzero(found.clearance < against.interest)
    if which[0].size:
        n, _, k = which
        one = against.pick((n, k))
        since = np.linspace(0.0, 1.0, _PIECES + 1) ** 2 * lasts[which][:, None]
        times = begin[which][:, None] + since
        x, y, vx, vy = column(take(far, which))
        x, y = x + vx * since[:, :-1], y + vy * since[:, :-1]
        need, pieces = one.required_distance(times), np.diff(since, axis=1)
        place = RelativeMotion(x, y, vx, vy)
        _write(found, which, _judge_piece(place, times[:, :-1], pieces, need[:, :-1], need[:, 1:]))
    return found


def _write(found: _Found, which: tuple[Array, ...], parts: _Found) -> None:
    """Write what the parts ``[m, P]`` of some pairs hold together, in place."""
    found.loss[which] = parts.loss.min(axis=1)
    found.until[which] = parts.until.max(axis=1)
    found.clearance[which] = parts.clearance.min(axis=1)


def _judge_piece(
    far: RelativeMotion, begin: Array, lasts: Array, first: Array, last: Array
) -> _Found:
    """Judge uniform relative motion that lasts some seconds, the required distance growing evenly
    from ``first`` to ``last``, m.

    The distance is less than required where A t^2 + 2 B t + C < 0.
    """
    grows = (last - first) / np.maximum(lasts, 1e-9)
    pace = far.vx * far.vx + far.vy * far.vy
    closing = far.x * far.vx + far.y * far.vy
    square = far.x * far.x + far.y * far.y
    a, b, c = pace - grows * grows, closing - first * grows, square - first * first
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    crosses = (b * b > a * c) & (root > b)
    enters = np.where(c < 0.0, 0.0, np.where(crosses, c / np.where(crosses, root - b, 1.0), np.inf))
    lost = enters < lasts
    leaves = np.where(a > 0.0, (root - b) / np.where(a > 0.0, a, 1.0), np.inf)
    # Nearest to what is required: where the range opens as fast as that grows.
    pace = np.maximum(pace, 1e-12)
    passing = np.sqrt(np.maximum(square - closing * closing / pace, 0.0))
    outruns = a > 0.0
    after_closest = passing * grows / np.sqrt(np.where(outruns, a, 1.0) * pace)
    when = np.where(outruns, -closing / pace + after_closest, lasts)
    when = np.clip(when, 0.0, lasts)
    distance = np.hypot(far.x + far.vx * when, far.y + far.vy * when)
    clearance = np.minimum(np.sqrt(square) - first, distance - (first + grows * when))
    return _Found(
        np.where(lost, begin + enters, np.inf),
        np.where(lost, begin + np.minimum(leaves, lasts), -np.inf),
        clearance,
    )
