"""What the monitor is given at each time step, what of it is valid, and what it remembers.

A report that is not finite, out of range, too old, out of order or from the future changes nothing
but the causes; the last good one stays and ages.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.climbs import BackupMeets, OnProfile
from agents.assurance.thresholds import Cause, Thresholds
from agents.kernel.traffic import Traffic, Window, advance_reports, turn_error
from agents.planner.request.options import Narrowed
from agents.planner.request.reports import AHEAD
from agents.policy.domain import excess
from envs.angles import wrap
from envs.arrays import Array, Bool, Float, Int, Shaped
from envs.frames import Air
from envs.kinematics import FASTEST, VehicleState, velocity
from envs.tracking.tracker import Sightings, belief, lasting, plausible_turn
from envs.trees import map_leaves
from envs.wind import turned_error

_SAME = (
    1e-6  # s by which the time of one report differs between two steps: rounding of now less age
)
_FARTHEST, _LONGEST, _FASTEST_TURN = 1e6, 1e12, 2.0 * math.pi  # m, s, rad/s
_SIGMAS = 5.5
"""Standard deviations that excuse a speed or a turn rate: of thousands of noisy reports none is out
of range."""


class Inputs(NamedTuple):
    """What a step is given; fields ``[N]``, of intruders ``[N, K]``; what is missing is nan.

    What stands here is believed: reports go through :mod:`envs.tracking` first, which says how
    exact they are and who turns. A standard deviation of 0 is exact. Where the accuracy is unknown,
    the caller gives the worst that is plausible.
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
    turn_rate: Array  # rad/s, positive to the left, [N, K]; 0: straight flight
    turn_std: Array  # one sigma of it, rad/s, [N, K]
    separation: Array = None  # to be kept from each, m, [N, K]; nan, None: the requirement's
    window: Window | None = None  # when each counts, s from now, [N, K]; None: always
    # that each may meet, as they are now: tuples of kernel.areas.ActiveArea, object [N]; None: none
    areas: Array = None
    # how a plan that climbs is flown, and what it meets; None: one in the plane, which meets what
    # window and areas say
    on_profile: OnProfile | None = None
    # finds what backups meet by their altitudes: those of a code of Sense, of ownships by their
    # numbers [M]; None: in the plane, likewise
    backups: Callable[[Any, Int[Array, " M"]], BackupMeets] | None = None


class Memory(NamedTuple):
    """The last good reports; fields ``[N]``, of intruders ``[N, K]``."""

    time: Array  # of the last step, s; -inf before the first
    own: VehicleState[Air]
    own_time: Array  # time of the own report, s; -inf before the first
    intruders: VehicleState[Air]  # [N, K]
    reported: Array  # times of the intruders' reports, s, [N, K]; -inf before the first
    position_std: Array
    velocity_std: Array
    turn_rate: Array  # rad/s, [N, K]
    turn_std: Array
    separation: Array  # to be kept from each, m, [N, K]; nan: the requirement's
    window: Window  # when each counts, on the monitor's clock, s, [N, K]
    areas: Array  # as they are at the last step, object [N]


def inputs(
    time: Float[Array, " #N"],
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    mask: Bool[Array, "N K"] = None,
    **more: Any,
) -> Inputs:
    """Return inputs ``[N]``, those of intruders ``[N, K]``; what is not given is 0, that is exact,
    fresh and straight ahead, and every intruder exists.
    """
    rows, pairs = np.shape(own.x), np.shape(intruders.x)
    exact: dict[str, Any] = {
        "own_age": np.zeros(rows),
        "age": np.zeros(pairs),
        "position_std": np.zeros(pairs),
        "velocity_std": np.zeros(pairs),
        "turn_rate": np.zeros(pairs),
        "turn_std": np.zeros(pairs),
    } | more
    exists = np.ones(pairs, dtype=bool) if mask is None else mask
    return Inputs(
        np.broadcast_to(np.asarray(time, float), rows),
        own,
        intruders=intruders,
        mask=exists,
        **exact,
    )


def believed(
    time: float,
    own: VehicleState[Air],
    sightings: Sightings[Air],
    mask: Bool[Array, "N K"],
    **more: Any,
) -> Inputs:
    """Return inputs ``[N]`` of intruders ``[N, K]`` as the tracker believes them to be at a time,
    s; what cannot be believed, and who was never reported, is missing.

    ``more`` is as of :func:`inputs`.
    """
    beliefs = belief(sightings.tracks)
    missing = beliefs.doubtful | ~np.isfinite(sightings.time)
    return inputs(
        time,
        own,
        map_leaves(lambda field: np.where(missing, np.nan, field), beliefs.state),
        mask,
        age=np.where(missing, 0.0, time - sightings.time),
        position_std=beliefs.position_std,
        velocity_std=beliefs.velocity_std,
        turn_rate=beliefs.turn_rate,
        turn_std=beliefs.turn_std,
        **more,
    )


def blank(count: int, intruders: int, speed: Float[Array, " #count"]) -> Memory:
    """Return the memory before the first step, ``[count]``, with an own speed, m/s."""
    never, pairs = np.full(count, -np.inf), (count, intruders)
    return Memory(
        never,
        VehicleState(np.zeros(count), np.zeros(count), np.zeros(count), np.array(speed)),
        never.copy(),
        VehicleState(*(np.zeros(pairs) for _ in range(4))),
        np.full(pairs, -np.inf),
        *(np.zeros(pairs) for _ in range(4)),
        separation=np.full(pairs, np.nan),
        window=Window(np.full(pairs, -np.inf), np.full(pairs, np.inf)),
        areas=no_areas(count),
    )


def no_areas(count: int) -> Shaped[Array, " count"]:
    """Return that there are no areas, object ``[count]``."""
    none = np.empty(count, dtype=object)
    none[:] = [()] * count
    return none


def update(
    memory: Memory, inputs: Inputs, thresholds: Thresholds[Narrowed]
) -> tuple[Memory, VehicleState[Air], Traffic, Array, Array]:
    """Return the memory with what is valid, own states and known intruders now (dead-reckoned), and
    the causes, int32: those that do not lie in intruders ``[N]``, and those that do ``[N, K]``.
    """
    clock = clock_runs(memory, inputs)
    time = np.where(clock, inputs.time, np.where(np.isfinite(memory.time), memory.time, 0.0))
    causes = np.where(clock, 0, int(Cause.CLOCK)).astype(np.int32)
    own, own_time, of_own = _take_own(memory, inputs, time, clock, thresholds)
    memory, of_intruders = _take_intruders(memory, inputs, time, clock, thresholds)
    areas = no_areas(time.size) if inputs.areas is None else inputs.areas
    memory = memory._replace(time=time, own=own, own_time=own_time, areas=areas)
    return memory, *advance(memory, inputs.mask, thresholds), causes | of_own, of_intruders


def _take_own(
    memory: Memory, inputs: Inputs, time: Array, clock: Array, thresholds: Thresholds[Narrowed]
) -> tuple[VehicleState[Air], Array, Array]:
    """Return the last good own states, their times, s, and the causes that lie in them, ``[N]``."""
    sane = _sane(inputs.own, inputs.own_age)
    reported = time - np.where(sane, inputs.own_age, 0.0)
    ordered = (inputs.own_age >= -AHEAD) & (reported >= memory.own_time - _SAME)
    good = sane & ordered & clock
    own = map_leaves(partial(np.where, good), inputs.own, memory.own)
    own_time = np.where(good, np.fmax(reported, memory.own_time), memory.own_time)
    causes = _bit(~sane, Cause.OWN_MISSING) | _bit(sane & ~ordered, Cause.OWN_OUT_OF_ORDER)
    causes |= _bit(time - own_time > thresholds.own_age, Cause.OWN_STALE)
    return own, own_time, causes


def _take_intruders(
    memory: Memory, inputs: Inputs, time: Array, clock: Array, thresholds: Thresholds[Narrowed]
) -> tuple[Memory, Array]:
    """Return the memory with the last good reports of intruders, and the causes that lie in them,
    ``[N, K]``.
    """
    sane, ordered, reported, last = _judge_reports(memory, inputs, time)
    good = sane & ordered & clock[:, None] & inputs.mask
    names = "intruders", "position_std", "velocity_std", "turn_rate", "turn_std"
    fields = {
        name: map_leaves(partial(np.where, good), getattr(inputs, name), getattr(memory, name))
        for name in names
    }
    separation = memory.separation
    if inputs.separation is not None:
        separation = np.where(good, inputs.separation, separation)
    ends = inputs.window or Window(-np.inf, np.inf)
    window = map_leaves(
        lambda old, new: np.where(good, time[:, None] + new, old), memory.window, ends
    )
    memory = memory._replace(
        **fields,
        reported=np.where(good, np.fmax(reported, last), last),
        separation=separation,
        window=window,
    )
    causes = (
        _bit(~sane, Cause.INTRUDER_MISSING)
        | _bit(sane & ~ordered, Cause.INTRUDER_OUT_OF_ORDER)
        | _lasting_causes(memory, time[:, None], thresholds)
    )
    return memory, np.where(inputs.mask, causes, 0).astype(np.int32)


def good_reports(memory: Memory, inputs: Inputs) -> Bool[Array, "N K"]:
    """Return whose reports are taken: they replace the last good ones."""
    reports = _judge_reports(memory, inputs, inputs.time)
    return reports.sane & reports.ordered & clock_runs(memory, inputs)[:, None] & inputs.mask


def clock_runs(memory: Memory, inputs: Inputs) -> Bool[Array, " N"]:
    """Return whether the clock has gone on since the last step."""
    return (np.abs(inputs.time) <= _LONGEST) & (inputs.time > memory.time)


class _Reports(NamedTuple):
    """What is judged of reports of intruders; fields ``[N, K]``."""

    sane: Array  # whether they are finite and in range, bool
    ordered: Array  # whether they are neither before the last one nor from the future, bool
    time: Array  # when they held, s
    before: Array  # when the last good ones did, s; -inf: there is none


def _judge_reports(memory: Memory, inputs: Inputs, time: Array) -> _Reports:
    """Return what is judged of the reports of intruders at a time, s, ``[N]``."""
    sane = (
        _sane(inputs.intruders, inputs.age)
        & _spread(inputs.position_std)
        & _spread(inputs.velocity_std)
        & (np.abs(inputs.turn_rate) <= _FASTEST_TURN)
        & _spread(inputs.turn_std)
    )
    if inputs.separation is not None:
        sane &= np.isnan(inputs.separation) | (inputs.separation > 0.0)
        sane &= ~(inputs.separation > _FARTHEST)
    if inputs.window is not None:
        sane &= ~(np.isnan(inputs.window.begin) | np.isnan(inputs.window.end))
    reported = time[:, None] - np.where(sane, inputs.age, 0.0)
    last = np.where(inputs.mask, memory.reported, -np.inf)
    ordered = (inputs.age >= -AHEAD) & (reported >= last - _SAME)
    return _Reports(sane, ordered, reported, last)


def _lasting_causes(memory: Memory, time: Array, thresholds: Thresholds[Narrowed]) -> Array:
    """Return the causes that lie in the last good reports of intruders, ``[N, K]``, at a time, s,
    ``[N, 1]``.
    """
    speed = excess(thresholds.traffic["intruder_speed"], memory.intruders.speed)
    outside = speed > _SIGMAS * memory.velocity_std
    turn = excess(thresholds.traffic["intruder_turn_rate"], np.abs(memory.turn_rate))
    outside |= turn > thresholds.turn_rate_min + _SIGMAS * memory.turn_std
    outside |= excess(thresholds.traffic["position_std"], memory.position_std) > 0.0
    outside |= excess(thresholds.traffic["velocity_std"], memory.velocity_std) > 0.0
    causes = np.zeros(outside.shape, np.int32)
    for where, cause in (
        (~(time - memory.reported <= thresholds.intruder_age), Cause.INTRUDER_STALE),
        (outside & np.isfinite(memory.reported), Cause.OUTSIDE_RANGE),
    ):
        causes |= _bit(where, cause)
    return causes


def advance(
    memory: Memory, mask: Bool[Array, "N K"], thresholds: Thresholds[Narrowed]
) -> tuple[VehicleState[Air], Traffic]:
    """Return ownship and intruders now, advanced from the last good reports; intruders along the
    turns they show.
    """
    own_age = np.where(np.isfinite(memory.own_time), memory.time - memory.own_time, 0.0)
    reported = np.isfinite(memory.reported)
    age = np.where(reported, memory.time[:, None] - memory.reported, 0.0)
    limits = thresholds.turn_rate_min, thresholds.turn_rate_max
    turn_rate = plausible_turn(memory.turn_rate, *limits)
    turn_time = lasting(turn_rate, memory.turn_std, thresholds.turn_time)
    turned = turn_error(memory.intruders.speed, memory.turn_std, turn_time)
    reports = Traffic(
        state=memory.intruders,
        mask=mask & reported,
        turn_rate=turn_rate,
        turn_time=turn_time,
        position_std=memory.position_std,
        velocity_std=np.hypot(memory.velocity_std, turned)
        + turned_error(turn_rate * turn_time, thresholds.wind_std),
        age=0.0 * age,
        separation=memory.separation,
        window=map_leaves(lambda when: when - memory.time[:, None], memory.window),
    )
    vx, vy = velocity(memory.own, np)
    x, y = memory.own.x + vx * own_age, memory.own.y + vy * own_age
    return VehicleState(x, y, wrap(memory.own.heading, np), memory.own.speed), advance_reports(
        reports, age
    )


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
