"""What manoeuvres keep that begin now and are held: a turn onto a heading at a rate, or a change of
speed, and straight flight from then on, against traffic.

Clearances are good to 2 cm, and to 0.5 m where an intruder turns or its velocity is uncertain.
Times of loss are good to a second while the ownship turns or an intruder does, and exact after
that.
"""

from typing import NamedTuple

import numpy as np

from agents.kernel.clearance import CLOSE, ROUNDING
from agents.kernel.traffic import (
    Requirement,
    Traffic,
    growth,
    predict,
    requirement_of,
    separations,
    within_window,
)
from agents.kernel.trajectory import Steering, steered
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.relative import RelativeMotion, step_separation
from envs.trees import column, map_leaves, take

ARC = np.radians(3.0)
"""Of turn in a step, own or an intruder's."""

_PIECES = 16  # of straight flight, on each of which the required distance grows linearly
_INTEREST = 0.2  # separations of clearance


class Ramp(NamedTuple):
    """Manoeuvres of one kind, ``[N, B]``: two motions lead to all of them."""

    yaw_rate: Array  # of each motion, rad/s, [2]
    acceleration: Array  # m/s^2, [2]
    step: float  # between the nodes at which the motions are looked at, s
    # of the heading, rad, or of the speed, m/s, to which a manoeuvre leads; 0 or more: by the first
    # motion
    change: Array

    @property
    def side(self) -> Array:
        """Which of the two motions leads to a target."""
        return (self.change < 0.0).astype(int)

    @property
    def reached(self) -> Array:
        """When a target is reached, s from now."""
        return self.change / (self.yaw_rate + self.acceleration)[self.side]


class Spread(NamedTuple):
    """How manoeuvres like some others leave them; fields ``[N, B, 1]``, or ``[m, 1]``."""

    rate: Array  # by how much more in a second, m/s
    since: Array  # from when on, s


class Kept(NamedTuple):
    """What manoeuvres, or parts of them, keep of what is required; fields ``[N, B]`` or
    ``[N, B, K]``.
    """

    loss: Array  # when it is lost first, s from now; inf where it is kept
    until: Array  # when it is missing last, s; -inf where never
    clearance: Array  # smallest distance less the required one, m; inf where nothing is near


class Against(NamedTuple):
    """What is kept clear of; intruders ``[N, 1, K]``, or one for each of some pairs, ``[m, 1]``."""

    traffic: Traffic
    base: Array  # required before uncertainty grows, m
    requirement: Requirement
    allowance: float = 0.0  # that is required beyond that, m
    spread: Spread | None = None  # required beyond that while what is reached is held

    @property
    def interest(self) -> float:
        """Clearance beyond which a lower bound of it will do, m."""
        return _INTEREST * self.requirement.separation

    def intruders_at(self, time: Array) -> VehicleState[Air]:
        """Return the intruders at some times, s, that broadcast."""
        return predict(self.traffic, time)

    def required_distance(self, time: Array) -> Array:
        """Return the required distance from each intruder at each time, m, less what the validator
        tolerates; the times broadcast against the intruders.
        """
        grown = self.base + growth(self.traffic, time, self.requirement.sigmas)
        need = np.maximum(grown - CLOSE, separations(self.traffic, self.requirement) - ROUNDING)
        need = need + self.allowance
        if self.spread is not None:
            need = need + self.spread.rate * np.maximum(time - self.spread.since, 0.0)
        # Where nothing grows, it is one distance for all times.
        return np.broadcast_to(need, np.broadcast_shapes(np.shape(need), np.shape(time)))

    def pick(self, which: tuple[Array, ...]) -> "Against":
        """Return the intruders of some pairs, numbers of rows, of manoeuvres and of intruders,
        ``[m, 1]``.
        """
        n, band, k = which
        return self._replace(
            traffic=column(take(self.traffic, (n, 0, k))),
            base=self.base[n, 0, k, None],
            spread=take(self.spread, (n, band)),
        )

    def rows(self, which: slice | Array) -> "Against":
        """Return what some ownships are to keep clear of."""
        return self._replace(
            traffic=take(self.traffic, which),
            base=self.base[which],
            spread=take(self.spread, which),
        )


def against_traffic(own: VehicleState[Air], traffic: Traffic, requirement: Requirement) -> Against:
    """Return what ownships ``[N]`` are to keep clear of, intruders ``[N, K]``."""
    base = requirement_of(traffic, own, requirement)
    return Against(column(traffic), base[:, None], requirement)


def judge_traffic(
    own: VehicleState[Air], ramp: Ramp, reached: Array, against: Against, look_ahead: float
) -> tuple[Kept, Array]:
    """Return what manoeuvres ``[N, B]`` hold against all intruders, and with which it is lost
    first, -1: with none.
    """
    if against.base.size == 0 or reached.size == 0:
        none = np.full(reached.shape, np.inf)
        return Kept(none, -none, none), np.full(reached.shape, -1)
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
    return Kept(loss, until, clearance), np.where(np.isfinite(loss), intruder, -1)


def _combine(*parts: Kept) -> Kept:
    """Return what the parts of manoeuvres hold together."""
    first, *others = parts
    for other in others:
        first = Kept(
            np.minimum(first.loss, other.loss),
            np.maximum(first.until, other.until),
            np.minimum(first.clearance, other.clearance),
        )
    return first


def _ramp_end(own: VehicleState[Air], ramp: Ramp, time: Array) -> VehicleState[Air]:
    """Return the ownship on its way to each target at some times, ``[N, B]``."""
    rates = ramp.yaw_rate[ramp.side], ramp.acceleration[ramp.side]
    return steered(column(own), Steering(*rates, np.inf), time)


def _straight_on(own: VehicleState[Air], seconds: Array) -> VehicleState[Air]:
    """Return ownships ``[...]`` after some seconds of straight flight, ``[..., S]``."""
    still = Steering(*np.zeros(3))
    return steered(map_leaves(lambda field: field[..., None], own), still, seconds)


def _relative(own: VehicleState[Air], other: VehicleState[Air]) -> RelativeMotion:
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
) -> Kept:
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
    return Kept(np.where(lost, begin, np.inf), np.where(lost, until, -np.inf), clearance)


def _judge_steps(path: RelativeMotion, times: Array, need: Array, axis: int) -> Kept:
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


def _drop_uncounted(found: Kept, traffic: Traffic, begin: Array, end: Array) -> Kept:
    """Return what parts of manoeuvres from some times to others, s, hold, but for those in which an
    intruder is above or below.
    """
    if traffic.window is None:
        return found
    counts = within_window(traffic, begin, end)
    return Kept(
        np.where(counts, found.loss, np.inf),
        np.where(counts, found.until, -np.inf),
        np.where(counts, found.clearance, np.inf),
    )


def _judge_ramp(
    own: VehicleState[Air], ramp: Ramp, arrival: VehicleState[Air], reached: Array, against: Against
) -> Kept:
    """Judge the way from the present to each target, ``[N, B, K]``; of what is kept clear of, no
    spread.

    Both motions are looked at once, from node to node; a target has all steps before it, and a last
    one of its own.
    """
    against = against._replace(spread=None)
    step = min(ramp.step, ARC / max(_fastest_turn(against), 1e-9))
    nodes = np.arange(int(np.ceil(float(reached.max()) / step - 1e-9)) + 1) * step
    times = nodes[None, :, None]
    there, need = against.intruders_at(times), against.required_distance(times)
    paths = []
    for yaw_rate, acceleration in zip(ramp.yaw_rate, ramp.acceleration, strict=True):
        moving = steered(column(own), Steering(yaw_rate, acceleration, np.inf), nodes)
        paths.append(_relative(VehicleState(*(field[..., None] for field in moving)), there))
    path = RelativeMotion(*(np.stack(pair, axis=1) for pair in zip(*paths, strict=True)))
    both = np.broadcast_to(need[:, None], path.x.shape)
    each = _judge_steps(path, np.broadcast_to(times[:, None], path.x.shape), both, axis=2)
    wide, ends = map_leaves(lambda field: field[:, None], against.traffic), times[:, None]
    each = _drop_uncounted(each, wide, ends[:, :, :-1], ends[:, :, 1:])
    so_far = Kept(
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


def _fastest_turn(against: Against) -> float:
    """Return the greatest turn rate of an intruder, rad/s."""
    traffic = against.traffic
    rate = np.where(traffic.mask & (traffic.turn_time > 0.0), np.abs(traffic.turn_rate), 0.0)
    return float(rate.max())


def _accumulate(function: np.ufunc, values: Array, nothing: float) -> Array:
    """Return what all steps before a node hold, ``[N, 2, nodes, K]``."""
    none = np.full((*values.shape[:2], 1, values.shape[-1]), nothing)
    return np.concatenate([none, function.accumulate(values, axis=2)], axis=2)


def _judge_hold(
    own: VehicleState[Air], reached: Array, against: Against, look_ahead: float
) -> tuple[Kept, ...]:
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
    own: VehicleState[Air], reached: Array, until: Array, against: Against
) -> Kept:
    """Judge straight flight from targets on until an intruder's turn ends, ``[N, B, K]``."""
    lasts = until - reached[..., None]
    there = against.intruders_at(reached[..., None])
    far = np.hypot(there.x - own.x[..., None], there.y - own.y[..., None])
    # No nearer than both flying at each other, and no more required than at the end.
    bound = far - (own.speed[..., None] + there.speed) * lasts - against.required_distance(until)
    bound = np.where(lasts > 0.0, bound, np.inf)
    found = Kept(np.full(bound.shape, np.inf), np.full(bound.shape, -np.inf), bound)
    which = np.nonzero(bound < against.interest)
    if which[0].size == 0:
        return found
    n, band, _ = which
    one = against.pick(which)
    steps = int(np.ceil(float(lasts[which].max()) * _fastest_turn(one) / ARC))
    since = np.linspace(0.0, 1.0, steps + 1) * lasts[which][:, None]
    times = reached[n, band, None] + since
    path = _relative(_straight_on(take(own, (n, band)), since), one.intruders_at(times))
    steps_of = _judge_steps(path, times, one.required_distance(times), 1)
    _write(found, which, _drop_uncounted(steps_of, one.traffic, times[:, :-1], times[:, 1:]))
    return found


def _judge_straight(
    own: VehicleState[Air], reached: Array, begin: Array, against: Against, look_ahead: float
) -> Kept:
    """Judge straight flight of both, from ``begin``, s, to the end of the look-ahead, in closed
    form, ``[N, B, K]``.
    """
    window, over = against.traffic.window, look_ahead
    if window is not None:
        # One that counts later, or never, is looked at for no time.
        begin = np.minimum(np.maximum(begin, window.begin), look_ahead)
        over = np.minimum(look_ahead, window.end)
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
        one = against.pick(which)
        since = np.linspace(0.0, 1.0, _PIECES + 1) ** 2 * lasts[which][:, None]
        times = begin[which][:, None] + since
        x, y, vx, vy = column(take(far, which))
        x, y = x + vx * since[:, :-1], y + vy * since[:, :-1]
        need, pieces = one.required_distance(times), np.diff(since, axis=1)
        place = RelativeMotion(x, y, vx, vy)
        _write(found, which, _judge_piece(place, times[:, :-1], pieces, need[:, :-1], need[:, 1:]))
    return found


def _write(found: Kept, which: tuple[Array, ...], parts: Kept) -> None:
    """Write what the parts ``[m, P]`` of some pairs hold together, in place."""
    found.loss[which] = parts.loss.min(axis=1)
    found.until[which] = parts.until.max(axis=1)
    found.clearance[which] = parts.clearance.min(axis=1)


def _judge_piece(
    far: RelativeMotion, begin: Array, lasts: Array, first: Array, last: Array
) -> Kept:
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
    return Kept(
        np.where(lost, begin + enters, np.inf),
        np.where(lost, begin + np.minimum(leaves, lasts), -np.inf),
        clearance,
    )
