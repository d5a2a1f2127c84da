"""What the monitor is given at each time step, what of it is valid, and what it remembers.

A report that is not finite, out of range, too old, out of order or from the future changes nothing
but the causes; the last good one stays and ages.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.plausible import SIGMAS, Drift, follow, greatest_change, unknown
from agents.assurance.thresholds import Cause, Thresholds
from agents.kernel.traffic import Traffic, Window, advance_reports
from agents.planner.request.options import Narrowed
from agents.planner.request.reports import AHEAD
from agents.policy.domain import excess
from envs.angles import wrap
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import FASTEST, VehicleState, velocity
from envs.trees import map_leaves
from envs.wind import turned_error

_SAME = (
    1e-6  # s by which the time of one report differs between two steps: rounding of now less age
)
_FARTHEST, _LONGEST = 1e6, 1e12  # m, s
_BASELINE = (0.2, 5.0)  # time steps between two reports that a turn rate may be read from
_SIGNIFICANT = 3.0  # sigmas that an estimated turn must differ from straight flight


class Inputs(NamedTuple):
    """What a step is given; fields ``[N]``, of intruders ``[N, K]``; what is missing is nan.

    Standard deviations are believed: 0 is exact. Where the accuracy is unknown, the caller gives
    the worst that is plausible.
    """

    time: Array  # now, on the monitor's clock, s
    own: VehicleState[Air]  # as last reported
    own_age: Array  # of that report, s
    # as last reported, each in a place of its own as long as it exists, [N, K]
    intruders: VehicleState[Air]
    age: Array  # of those reports, s, [N, K]
    mask: Array  # which intruders exist, bool, [N, K]; one that is updated away here is forgotten
    position_std: Array  # one sigma per axis, m, [N, K]
    velocity_std: Array  # one sigma per axis, m/s, [N, K]
    separation: Array = None  # to be kept from each, m, [N, K]; nan, None: the requirement's
    window: Window | None = None  # when each counts, s from now, [N, K]; None: always
    # that each may meet, as they are now: tuples of kernel.areas.ActiveArea, object [N]; None: none
    areas: Array = None


class Memory(NamedTuple):
    """The last good reports; fields ``[N]``, of intruders ``[N, K]``."""

    time: Array  # of the last step, s; -inf before the first
    own: VehicleState[Air]
    own_time: Array  # time of the own report, s; -inf before the first
    intruders: VehicleState[Air]  # [N, K]
    seen: Array  # times of the intruders' reports, s, [N, K]; -inf before the first
    turn_rate: Array  # from the last two reports, rad/s, [N, K]
    position_std: Array
    velocity_std: Array
    separation: Array  # to be kept from each, m, [N, K]; nan: the requirement's
    window: Window  # when each counts, on the monitor's clock, s, [N, K]
    drift: Drift  # [N, K]
    areas: Array  # as they are at the last step, object [N]


def inputs(
    time: Array,
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    mask: Array = None,
    **more: Any,
) -> Inputs:
    """Return inputs ``[N]``, those of intruders ``[N, K]``; what is not given is 0, that is exact
    and fresh, and every intruder exists.
    """
    each, pairs = np.shape(own.x), np.shape(intruders.x)
    given: dict[str, Any] = {
        "own_age": np.zeros(each),
        "age": np.zeros(pairs),
        "position_std": np.zeros(pairs),
        "velocity_std": np.zeros(pairs),
    } | more
    exists = np.ones(pairs, dtype=bool) if mask is None else mask
    return Inputs(
        np.broadcast_to(np.asarray(time, float), each),
        own,
        intruders=intruders,
        mask=exists,
        **given,
    )


def blank(count: int, intruders: int, speed: Array) -> Memory:
    """Return the memory before the first step, ``[count]``, with an own speed, m/s."""
    never, pairs = np.full(count, -np.inf), (count, intruders)
    return Memory(
        never,
        VehicleState(np.zeros(count), np.zeros(count), np.zeros(count), np.array(speed)),
        never.copy(),
        VehicleState(*(np.zeros(pairs) for _ in range(4))),
        np.full(pairs, -np.inf),
        *(np.zeros(pairs) for _ in range(3)),
        separation=np.full(pairs, np.nan),
        window=Window(np.full(pairs, -np.inf), np.full(pairs, np.inf)),
        drift=unknown(pairs),
        areas=no_areas(count),
    )


def no_areas(count: int) -> Array:
    """Return that there are no areas, object ``[count]``."""
    none = np.empty(count, dtype=object)
    none[:] = [()] * count
    return none


def update(
    memory: Memory, given: Inputs, thresholds: Thresholds[Narrowed]
) -> tuple[Memory, VehicleState[Air], Traffic, Array, Array]:
    """Return the memory with what is valid, own states and known intruders now (dead-reckoned), and
    the causes, int32: those that do not lie in intruders ``[N]``, and those that do ``[N, K]``.
    """
    clock = (np.abs(given.time) <= _LONGEST) & (given.time > memory.time)
    now = np.where(clock, given.time, np.where(np.isfinite(memory.time), memory.time, 0.0))
    causes = np.where(clock, 0, int(Cause.CLOCK)).astype(np.int32)
    own, own_time, of_own = _take_own(memory, given, now, clock, thresholds)
    memory, of_intruders = _take_intruders(memory, given, now, clock, thresholds)
    areas = no_areas(now.size) if given.areas is None else given.areas
    memory = memory._replace(time=now, own=own, own_time=own_time, areas=areas)
    return memory, *advance(memory, given.mask, thresholds), causes | of_own, of_intruders


def _take_own(
    memory: Memory, given: Inputs, now: Array, clock: Array, thresholds: Thresholds[Narrowed]
) -> tuple[VehicleState[Air], Array, Array]:
    """Return the last good own states, their times, s, and the causes that lie in them, ``[N]``."""
    sane = _sane(given.own, given.own_age)
    reported = now - np.where(sane, given.own_age, 0.0)
    ordered = (given.own_age >= -AHEAD) & (reported >= memory.own_time - _SAME)
    good = sane & ordered & clock
    own = map_leaves(partial(np.where, good), given.own, memory.own)
    own_time = np.where(good, np.fmax(reported, memory.own_time), memory.own_time)
    causes = _bit(~sane, Cause.OWN_MISSING) | _bit(sane & ~ordered, Cause.OWN_OUT_OF_ORDER)
    causes |= _bit(now - own_time > thresholds.own_age, Cause.OWN_STALE)
    return own, own_time, causes


def _take_intruders(
    memory: Memory, given: Inputs, now: Array, clock: Array, thresholds: Thresholds[Narrowed]
) -> tuple[Memory, Array]:
    """Return the memory with the last good reports of intruders, and the causes that lie in them,
    ``[N, K]``.
    """
    sane = (
        _sane(given.intruders, given.age)
        & _spread(given.position_std)
        & _spread(given.velocity_std)
    )
    reported = now[:, None] - np.where(sane, given.age, 0.0)
    known = np.where(given.mask, memory.seen, -np.inf)
    ordered = (given.age >= -AHEAD) & (reported >= known - _SAME)
    good = sane & ordered & clock[:, None] & given.mask
    turn_rate, outside = _turn_rate(memory, given, reported - known, good, thresholds)
    before = memory.intruders, memory.position_std, memory.velocity_std
    report = given.intruders, given.position_std, given.velocity_std
    drift = follow(memory.drift, before, report, (known, reported), good, thresholds)
    intruders, position_std, velocity_std = map_leaves(partial(np.where, good), report, before)
    separation = memory.separation
    if given.separation is not None:
        separation = np.where(good, given.separation, separation)
    ends = given.window or Window(-np.inf, np.inf)
    window = map_leaves(
        lambda had, new: np.where(good, now[:, None] + new, had), memory.window, ends
    )
    memory = memory._replace(
        intruders=intruders,
        seen=np.where(good, np.fmax(reported, known), known),
        turn_rate=turn_rate,
        position_std=position_std,
        velocity_std=velocity_std,
        separation=separation,
        window=window,
        drift=drift,
    )
    causes = (
        _bit(~sane, Cause.INTRUDER_MISSING)
        | _bit(sane & ~ordered, Cause.INTRUDER_OUT_OF_ORDER)
        | _lasting_causes(memory, now[:, None], outside, thresholds)
    )
    return memory, np.where(given.mask, causes, 0).astype(np.int32)


def _lasting_causes(
    memory: Memory, now: Array, outside: Array, thresholds: Thresholds[Narrowed]
) -> Array:
    """Return the causes that lie in the last good reports of intruders, ``[N, K]``, at a time, s,
    ``[N, 1]``; ``outside`` says whose turn rates are out of range, ``[N, K]``.
    """
    speed = excess(thresholds.traffic["intruder_speed"], memory.intruders.speed)
    outside = outside | (speed > SIGMAS * memory.velocity_std)
    outside |= excess(thresholds.traffic["position_std"], memory.position_std) > 0.0
    outside |= excess(thresholds.traffic["velocity_std"], memory.velocity_std) > 0.0
    causes = np.zeros(outside.shape, np.int32)
    for where, cause in (
        (~(now - memory.seen <= thresholds.intruder_age), Cause.INTRUDER_STALE),
        (outside & np.isfinite(memory.seen), Cause.OUTSIDE_RANGE),
        (now < memory.drift.rate_until, Cause.IMPOSSIBLE_RATE),
        (now < memory.drift.place_until, Cause.CONTRADICTION),
    ):
        causes |= _bit(where, cause)
    return causes


def advance(
    memory: Memory, mask: Array, thresholds: Thresholds[Narrowed]
) -> tuple[VehicleState[Air], Traffic]:
    """Return ownship and intruders now, advanced from the last good reports; intruders along the
    turns they show.
    """
    own_age = np.where(np.isfinite(memory.own_time), memory.time - memory.own_time, 0.0)
    known = np.isfinite(memory.seen)
    age = np.where(known, memory.time[:, None] - memory.seen, 0.0)
    turn_time = np.where(memory.turn_rate == 0.0, 0.0, thresholds.turn_time)
    reports = Traffic(
        state=memory.intruders,
        mask=mask & known,
        turn_rate=memory.turn_rate,
        turn_time=turn_time,
        position_std=memory.position_std,
        velocity_std=memory.velocity_std
        + turned_error(memory.turn_rate * turn_time, thresholds.wind_std),
        age=0.0 * age,
        separation=memory.separation,
        window=map_leaves(lambda when: when - memory.time[:, None], memory.window),
    )
    vx, vy = velocity(memory.own, np)
    x, y = memory.own.x + vx * own_age, memory.own.y + vy * own_age
    return VehicleState(x, y, wrap(memory.own.heading, np), memory.own.speed), advance_reports(
        reports, age
    )


def _turn_rate(
    memory: Memory, given: Inputs, elapsed: Array, good: Array, thresholds: Thresholds[Narrowed]
) -> tuple[Array, Array]:
    """Return the turn rates (rad/s, 0 where they may be noise) of the last two reports, and which
    are outside.
    """
    shortest, longest = (steps * thresholds.options.aircraft.dt for steps in _BASELINE)
    comparable = good & (elapsed >= shortest) & (elapsed <= longest)
    seconds = np.where(comparable, elapsed, 1.0)
    rate = (
        wrap(np.where(comparable, given.intruders.heading - memory.intruders.heading, 0.0), np)
        / seconds
    )
    speed = np.maximum(np.where(comparable, given.intruders.speed, 1.0), 1.0)
    noise = np.hypot(np.where(comparable, given.velocity_std, 0.0), memory.velocity_std)
    std = noise / (speed * seconds)
    size = np.abs(rate)
    turning = size >= np.maximum(thresholds.turn_rate_min, _SIGNIFICANT * std)
    fastest = thresholds.traffic["intruder_turn_rate"]
    # A track that begins anew, because its aircraft turns, adds what it lagged behind.
    outside = comparable & (excess(fastest, size) > thresholds.turn_rate_min + 2.0 * SIGMAS * std)
    # What seems to turn a little faster than an aircraft can turns as fast as one can. Beyond that
    # it has jumped: nothing follows but Cause.IMPOSSIBLE_RATE.
    seen = map_leaves(lambda field: np.where(comparable, field, 0.0), given.intruders)
    before, after = velocity(memory.intruders, np), velocity(seen, np)
    change = np.hypot(after[0] - before[0], after[1] - before[1])
    most, limits = thresholds.turn_rate_max, thresholds.options.aircraft.limits
    greatest = np.maximum(memory.intruders.speed, seen.speed)
    possible = change <= greatest_change(greatest, seconds, noise, most, limits)
    rate = np.where(turning & possible, np.clip(rate, -most, most), 0.0)
    # A repeated report says nothing new; one after a gap begins anew.
    again = ~good | (elapsed < shortest)
    rate = np.where(comparable, rate, np.where(again, memory.turn_rate, 0.0))
    return np.where(given.mask, rate, 0.0), outside


def _sane(state: VehicleState[Air], age: Array) -> Array:
    """Return whether states are finite and in range; nan fails every comparison."""
    place = (np.abs(state.x) <= _FARTHEST) & (np.abs(state.y) <= _FARTHEST)
    motion = (
        (np.abs(state.heading) <= 2.0 * math.pi)
        & (state.speed >= 0.0)
        & (state.speed <= FASTEST.speed_max)
    )
    return place & motion & (np.abs(age) <= _LONGEST)


def _spread(std: Array) -> Array:
    """Return whether standard deviations are sizes in range; nan fails every comparison."""
    return (std >= 0.0) & (std <= 10_000.0)


def _bit(where: Array, cause: Cause) -> Array:
    """Return the bit of a cause where it holds, else 0, int32."""
    return np.where(where, int(cause), 0).astype(np.int32)
