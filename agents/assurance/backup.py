"""The backup: a manoeuvre that is ready when no plan is.

A backup is a course and a speed: the aircraft turns onto the course at the greatest rate of
decisions, accelerates or decelerates to the speed, and holds both. It is published as plan states
like any plan, every leg of constant controls, and judged by
:mod:`agents.planner.judge.validator` over the sum of :data:`STEPS`. The one of the step before
stays if it passes from the present state; only otherwise is the family searched.

Where the aircraft may climb, a backup levels off at once; only where none that does is safe are
those that climb or descend searched, by what they meet at their altitudes.
"""

import math
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from agents.assurance.areas import judge_backups, nameless
from agents.assurance.inputs import no_areas
from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Traffic, growth, predict, requirement_of, within_window
from agents.manoeuvres.simulator import integrate
from agents.planner.judge.validator import validate
from agents.planner.request.options import L, Narrowed, Options
from envs.angles import wrap
from envs.arrays import Array, Float, Int, Shaped
from envs.frames import Air
from envs.kinematics import UNLIMITED, Limits, VehicleState, advance
from envs.relative import chord
from envs.trees import column, map_leaves, scatter, take
from envs.waypoints import Legs, PlanStates, legs

STEPS = (5.0, 5.0, 5.0, 5.0, 10.0, 10.0, 10.0, 10.0, 20.0, 20.0, 20.0)
"""Durations of a backup's legs, in time steps; their sum is the horizon over which it is judged."""

_TURNS = np.radians(
    [
        0.0,
        15.0,
        -15.0,
        30.0,
        -30.0,
        45.0,
        -45.0,
        60.0,
        -60.0,
        90.0,
        -90.0,
        120.0,
        -120.0,
        150.0,
        -150.0,
    ]
)
_FAMILY_TURN = np.repeat(_TURNS, 3)
_FAMILY_SPEED = np.tile([0.0, -1.0, 1.0], _TURNS.size)  # hold, decelerate, accelerate
_STEP = 2.5  # time steps between samples when the family is ranked
_ENOUGH = 0.3  # separations of clearance beyond which more is worth nothing
_TURN_COST = 0.03  # separations of clearance that a radian of turn must yield
_TRIED = 3  # of the family that are validated
_BLOCK = 256  # aircraft searched for at once
_SAME_SPEED = 1e-6  # by which a speed may be greater for rounding's sake, m/s


class Sense(IntEnum):
    """What a backup does up and down."""

    LEVEL_OFF = 0
    """At once; a backup in the plane has this one too."""
    CLIMB = 1
    """At the greatest rate, until the ceiling is near."""
    DESCEND = 2
    """At the greatest rate, until the floor is near."""


class Surroundings(NamedTuple):
    """What backups of one sense may meet; fields ``[N]``."""

    traffic: Traffic  # [N, K]
    areas: Array  # tuples of kernel.areas.ActiveArea, object
    possible: Array  # whether they can be flown, bool
    # share of the vertical separation kept at sample_times, [N, K, S]; None: in the plane
    share: Array = None


class Around(NamedTuple):
    """What backups of ownships ``[N]`` may meet, looked up where it is needed."""

    senses: tuple[Sense, ...]  # of which there are backups; the first levels off
    find: Callable[[Sense, Int[Array, " M"]], Surroundings]  # of ownships by their numbers

    def of(self, rows: Int[Array, " M"]) -> "Around":
        """Return what is around some of the ownships."""
        return Around(self.senses, lambda sense, numbers: self.find(sense, rows[numbers]))


class Backup(NamedTuple):
    """Backups; fields ``[N]``."""

    course: Array  # to turn onto, rad in [-pi, pi)
    speed: Array  # to reach, m/s
    plan_states: PlanStates[Air]  # [N, B], their times from when the backup was refreshed
    legs: Legs[Air]  # between them
    started: Array  # when that was, on the monitor's clock, s; nan where there has never been one
    # smallest distance less the required one over the horizon, to intruders and areas, m
    clearance: Array
    safe: Array  # whether nothing was found wrong but the validator's own resolution, bool
    depth: Array  # how deep it is in areas on average, m; 0 where it stays out of all
    area: Array  # what messages call the area that it enters first; "" where it enters none, object
    avoids: Array  # whether it keeps the required separation, bool
    # what tells backups of one grade apart, m: the clearance; of one that does not keep the
    # separation, and is not in the plane, an estimate in which a share of the vertical separation
    # is worth the same of the horizontal one
    value: Array
    sense: Array  # code of Sense, int8


def grade(backup: Backup) -> Float[Array, " N"]:
    """Return how good backups are, from 0: those that stay out of all areas come before
    all others, then those that keep more of what is required.
    """
    return 4 * (backup.depth > 0.0) + 2 * ~backup.safe + ~backup.avoids


def backup_states(
    own: VehicleState[Air],
    course: Float[Array, " M"],
    speed: Float[Array, " M"],
    thresholds: Thresholds[Narrowed],
) -> PlanStates[Air]:
    """Return backups from the present states as plan states, ``[M, B]``; every leg has constant
    controls.
    """
    limits, state, states = thresholds.manoeuvre, own, [own]
    to_turn = wrap(course - own.heading, np)
    for duration in durations(thresholds.options):
        turn, gain = _controls(to_turn, speed - state.speed, duration, limits)
        state = advance(state, gain / duration, turn / duration, duration, UNLIMITED, np)
        to_turn = to_turn - turn
        states.append(state)
    times = np.cumsum((0.0, *durations(thresholds.options)))
    times = np.broadcast_to(times, (own.x.size, times.size))
    x, y, heading, velocity = (np.stack(field, axis=-1) for field in zip(*states, strict=True))
    return PlanStates(x, y, wrap(heading, np), velocity, times.copy())


def surroundings(traffic: Traffic, areas: Shaped[Array, " N"] = None) -> Surroundings:
    """Return what backups ``[N]`` in the plane may meet: intruders ``[N, K]`` and areas as of now,
    object ``[N]``, None: none.
    """
    count = len(traffic.mask)
    areas = no_areas(count) if areas is None else areas
    return Surroundings(traffic, areas, np.ones(count, dtype=bool))


def in_plane(meets: Surroundings) -> Around:
    """Return what is around ownships ``[N]`` whose backups stay in the plane."""
    return Around((Sense.LEVEL_OFF,), lambda _, rows: take(meets, rows))


def refresh(
    previous: Backup,
    own: VehicleState[Air],
    around: Around,
    time: Float[Array, " N"],
    thresholds: Thresholds[Narrowed],
) -> Backup:
    """Return the backups for this step, ``[N]``, from those of the step before, by the present
    states and what is around them; time on the monitor's clock, s.
    """
    result = _hold(previous, own, around, time, thresholds)
    level, *climbing = around.senses
    # Those that climb and descend are searched where none is safe that levels off.
    for senses in ((level,), climbing):
        unsafe = np.flatnonzero(~result.safe)
        for sense in senses if unsafe.size else ():
            meets = around.find(sense, unsafe)
            fits = (sense is level) | _fits_climb(own.speed[unsafe], sense, thresholds)
            possible = np.flatnonzero(meets.possible & fits)
            for first in range(0, possible.size, _BLOCK):
                block = possible[first : first + _BLOCK]
                rows = unsafe[block]
                states, when = take((own, time), rows)
                other = search(states, take(meets, block), when, thresholds, sense)
                _exchange(result, rows, other, previous, thresholds)
    return result


def _hold(
    previous: Backup,
    own: VehicleState[Air],
    around: Around,
    time: Array,
    thresholds: Thresholds[Narrowed],
) -> Backup:
    """Return the backups of the step before with what is found of them now; a climb or descent
    ends where it is not possible any more, and where to level off is safe from here on.
    """
    result, level = map_leaves(np.array, previous), around.senses[0]
    held = np.where(np.isin(previous.sense, around.senses), previous.sense, level)
    for sense in around.senses:
        rows = np.flatnonzero(held == sense)
        if rows.size == 0:
            continue
        before, states, when = take((previous, own, time), rows)
        meets = around.find(sense, rows)
        scatter(result, rows, _continue(before, states, meets, when, thresholds, sense))
        if sense is not level:
            meets_level = around.find(level, rows)
            levelled = _continue(before, states, meets_level, when, thresholds, level)
            ends = levelled.safe | ~meets.possible
            scatter(result, rows[ends], take(levelled, ends))
    return result


def _exchange(
    result: Backup, rows: Array, other: Backup, previous: Backup, thresholds: Thresholds[Narrowed]
) -> None:
    """Put other backups ``[M]`` in the place of those in some rows, where they are better by more
    than the hysteresis, or where there was none.
    """
    current = take(result, rows)
    grades = grade(other) - grade(current)
    gain = _value(other) > _value(current) + thresholds.backup_gain
    never = ~np.isfinite(previous.started[rows]) & (other.sense == Sense.LEVEL_OFF)
    better = never | (grades < 0) | ((grades == 0) & gain)
    scatter(result, rows[better], take(other, better))


def _continue(
    previous: Backup,
    own: VehicleState[Air],
    meets: Surroundings,
    time: Array,
    thresholds: Thresholds[Narrowed],
    sense: Sense,
) -> Backup:
    """Return the backups of the step before, of one sense, with what is found of them now; those
    that go on straight ahead where there was none, which are never safe.
    """
    exists = np.isfinite(previous.started)
    course = np.where(exists, previous.course, own.heading)
    speed = np.where(exists, previous.speed, own.speed)
    turns = _Turns(np.arange(own.x.size), course, speed)
    continued = _judge(turns, own, meets, time, thresholds, sense)
    return continued._replace(safe=continued.safe & exists)


class _Turns(NamedTuple):
    """Turns onto courses, with changes of speed, of some ownships; fields ``[M]``."""

    of: Array  # numbers of the ownships
    course: Array  # to turn onto, rad in [-pi, pi)
    speed: Array  # to reach, m/s


def search(
    own: VehicleState[Air],
    meets: Surroundings,
    time: Float[Array, " N"],
    thresholds: Thresholds[Narrowed],
    sense: Sense = Sense.LEVEL_OFF,
) -> Backup:
    """Return the best backup of the family at a time (s), ``[N]``, of a sense, by what is met in
    it: a safe one, or that of greatest clearance.

    One that enters an area is returned only where all of the family do: that of least depth, of
    those first that seem to keep the required separation.
    """
    family = _family(own, thresholds, sense)
    likely = _likely(family, own, meets, thresholds)
    tried = _judge(take(family, likely), own, meets, time, thresholds, sense)
    worse = np.where(tried.safe, 0.0, -_value(tried))
    order = np.lexsort((np.arange(likely.size), worse, grade(tried), family.of[likely]))
    return take(tried, order[::_TRIED])


def _family(own: VehicleState[Air], thresholds: Thresholds[Narrowed], sense: Sense) -> _Turns:
    """Return all turns of the family, those of one ownship after those of another, ``[N * F]``."""
    count, slowest = own.x.size, thresholds.manoeuvre.speed_min
    fastest = fastest_in(sense, thresholds)
    of, change = np.repeat(np.arange(count), _FAMILY_TURN.size), np.tile(_FAMILY_SPEED, count)
    held = np.clip(own.speed, slowest, fastest)[of]
    extreme = np.where(change > 0.0, fastest, slowest)
    course = wrap(own.heading[of] + np.tile(_FAMILY_TURN, count), np)
    return _Turns(of, course, np.where(change == 0.0, held, extreme))


def _fits_climb(
    speed: Float[Array, " M"], sense: Sense, thresholds: Thresholds[L]
) -> Shaped[Array, " M"]:
    """Return whether a climb or descent of a sense is within the limits of the airspeed, bool: from
    speeds, m/s, and at each that the family may reach.
    """
    fastest = fastest_in(sense, thresholds)
    return (speed <= fastest + _SAME_SPEED) & (thresholds.manoeuvre.speed_min <= fastest)


def fastest_in(sense: Sense, thresholds: Thresholds[L]) -> float:
    """Return the greatest speed over the horizon of backups of a sense, m/s: with the climb it is
    that of the aircraft's limits; 0 where the climb alone is more.
    """
    speed_max, rate = thresholds.manoeuvre.speed_max, climb_of(sense, thresholds.options)
    return math.sqrt(max(speed_max * speed_max - rate * rate, 0.0))


def climb_of(sense: Sense, options: Options[L]) -> float:
    """Return the vertical speed that backups of a sense change to, m/s, positive upwards."""
    if sense is Sense.LEVEL_OFF:
        return 0.0
    vertical = options.vertical
    return vertical.climb_max if sense is Sense.CLIMB else -vertical.descent_max


def _likely(
    family: _Turns,
    own: VehicleState[Air],
    meets: Surroundings,
    thresholds: Thresholds[Narrowed],
) -> Array:
    """Return the numbers of those of the family that are worth a validation, the same number of
    each ownship, ``[N * _TRIED]``: by estimates, those first that enter no area.
    """
    count, unit = own.x.size, thresholds.options.aircraft.separation
    areas = meets.areas
    clearance = _estimate(family, own, meets, thresholds)
    depth = np.zeros(family.of.size)
    among_areas = np.flatnonzero(np.array([bool(row) for row in areas])[family.of])
    if among_areas.size:
        turns = take(family, among_areas)
        plan_states = backup_states(take(own, turns.of), turns.course, turns.speed, thresholds)
        keeps = judge_backups(plan_states, legs(plan_states), areas, turns.of, thresholds)
        depth[among_areas] = keeps.depth
        near = np.where(keeps.depth > 0.0, np.inf, keeps.clearance)
        clearance[among_areas] = np.minimum(clearance[among_areas], near)
    effort = _TURN_COST * unit * np.abs(np.tile(_FAMILY_TURN, count))
    merit = np.minimum(clearance, _ENOUGH * unit) - effort
    enters = depth > 0.0
    order = np.lexsort((-merit, depth, enters & (clearance < 0.0), enters, family.of))
    return order.reshape(count, _FAMILY_TURN.size)[:, :_TRIED].ravel()


def _judge(
    turns: _Turns,
    own: VehicleState[Air],
    meets: Surroundings,
    time: Array,
    thresholds: Thresholds[Narrowed],
    sense: Sense,
) -> Backup:
    """Return backups ``[M]`` of ownships ``[N]``, of a sense, with what is found of them; a start
    inside the margin must keep its present distance from intruders to the last digit.
    """
    plan_states = backup_states(take(own, turns.of), turns.course, turns.speed, thresholds)
    curves, others = legs(plan_states), take(meets.traffic, turns.of)
    findings = validate(
        plan_states, others, thresholds.requirement, thresholds.limits, curves=curves
    )
    from_areas = judge_backups(plan_states, curves, meets.areas, turns.of, thresholds)
    clearance = np.where(np.isnan(findings.clearance), -np.inf, findings.clearance)
    avoids = clearance >= -thresholds.resolution
    clearance = np.minimum(clearance, from_areas.clearance)
    value, lost = clearance.copy(), np.flatnonzero(~avoids)
    if meets.share is not None and lost.size:
        of, course, speed = take(turns, lost)
        alone = _Turns(np.arange(lost.size), course, speed)
        estimated = _estimate(alone, *take((own, meets), of), thresholds)
        value[lost] = np.minimum(estimated, from_areas.clearance[lost])
    return Backup(
        course=turns.course,
        speed=turns.speed,
        plan_states=plan_states,
        legs=curves,
        started=np.array(np.asarray(time)[turns.of]),
        clearance=clearance,
        safe=findings.legal & avoids & (from_areas.clearance >= 0.0),
        depth=from_areas.depth,
        area=from_areas.area,
        avoids=avoids,
        value=value,
        sense=np.full(turns.of.size, sense, dtype=np.int8),
    )


def _value(backup: Backup) -> Array:
    """Return what tells backups of one grade apart, m, ``[N]``; the more the better."""
    return np.where(backup.depth > 0.0, -backup.depth, backup.value)


def sample_times(options: Options[L]) -> Array:
    """Return the times at which backups are compared, s after they begin, ``[S]``."""
    return np.arange(round(sum(STEPS) / _STEP) + 1) * (_STEP * options.aircraft.dt)


def _estimate(
    turns: _Turns,
    own: VehicleState[Air],
    meets: Surroundings,
    thresholds: Thresholds[Narrowed],
) -> Array:
    """Return the smallest distance less the required one of backups of ownships ``[N]``, m; an
    estimate. All have as many, one after the other, ``[N * F]``.

    A share of the vertical separation is worth as much as the same of the horizontal one.
    """
    traffic, sigmas = meets.traffic, thresholds.requirement.sigmas
    required = requirement_of(traffic, own, thresholds.requirement)
    base = np.where(traffic.mask, required, -np.inf)
    samples, wide = sample_times(thresholds.options), column(traffic)
    times, stride = samples[:, None], samples[1]
    tracks, own = predict(wide, times), take(own, turns.of)
    required_range = np.broadcast_to(base[:, None] + growth(wide, times, sigmas), tracks.x.shape)
    counts = within_window(wide, times - stride, times)
    required_range = np.where(counts, required_range, -np.inf)
    lost_in_height = None
    if meets.share is not None:
        shares = np.minimum(meets.share[..., 1:], meets.share[..., :-1])
        lost_in_height = (shares - 1.0) * base[..., None]
    to_turn, least = wrap(turns.course - own.heading, np), np.full(own.x.size, np.inf)
    step = 0
    for duration in durations(thresholds.options):
        turn, gain = _controls(to_turn, turns.speed - own.speed, duration, thresholds.manoeuvre)
        shape = (round(duration / stride), own.x.size)
        acceleration = np.broadcast_to(gain / duration, shape)
        yaw_rate = np.broadcast_to(turn / duration, shape)
        flown, own = integrate(own, acceleration, yaw_rate, stride, UNLIMITED)
        to_turn = to_turn - turn
        x0, y0 = _relative(flown, tracks, step, 0)
        for sample in range(1, len(flown.x)):
            x1, y1 = _relative(flown, tracks, step, sample)
            clearance = chord(x0, y0, x1, y1) - required_range[:, step + sample, None]
            if lost_in_height is not None:
                clearance = np.fmax(clearance, lost_in_height[:, None, :, step + sample - 1])
            least = np.minimum(least, np.min(clearance, axis=-1, initial=np.inf).ravel())
            x0, y0 = x1, y1
        step += shape[0]
    return least


def _relative(
    flown: VehicleState[Air], tracks: VehicleState[Air], first: int, sample: int
) -> tuple[Array, Array]:
    """Return the intruders' place relative to backups at a sample of their flight, m, ``[N, F, K]``
    each.

    The flight ``[S, N * F]`` begins at the time numbered ``first`` of the tracks ``[N, T, K]``.
    """
    count, at = tracks.x.shape[0], first + sample
    shape = count, flown.x.shape[-1] // max(count, 1), 1
    x, y = (field[sample].reshape(shape) for field in (flown.x, flown.y))
    return tracks.x[:, at, None] - x, tracks.y[:, at, None] - y


def resting(count: int, thresholds: Thresholds[L]) -> Backup:
    """Return that there has never been a backup, ``[count]``."""
    zero, no = np.zeros(count), np.zeros(count, dtype=bool)
    plan_states = straight_east(
        count, np.arange(len(STEPS) + 1) * 10.0, thresholds.options.aircraft.limits
    )
    return Backup(
        course=zero,
        speed=plan_states.speed[:, 0].copy(),
        plan_states=plan_states,
        legs=legs(plan_states),
        started=zero + np.nan,
        clearance=zero - np.inf,
        safe=no,
        depth=zero.copy(),
        area=nameless(count),
        avoids=no.copy(),
        value=zero - np.inf,
        sense=np.zeros(count, dtype=np.int8),
    )


def straight_east(count: int, times: Float[Array, " W"], limits: Limits) -> PlanStates[Air]:
    """Return plan states of a straight flight at a middle speed, ``[count, W]``."""
    time = np.broadcast_to(times, (count, times.size)).copy()
    zero, speed = np.zeros_like(time), 0.5 * (limits.speed_min + limits.speed_max)
    return PlanStates(speed * time, zero, zero.copy(), zero + speed, time)


def durations(options: Options[L]) -> list[float]:
    """Return the durations of a backup's legs, s."""
    return [steps * options.aircraft.dt for steps in STEPS]


def _controls(
    to_turn: Array, to_gain: Array, duration: float, limits: Limits
) -> tuple[Array, Array]:
    """Return the turn (rad) and the change of speed (m/s) of one leg."""
    most = limits.yaw_rate_max * duration
    gain = np.clip(to_gain, limits.acceleration_min * duration, limits.acceleration_max * duration)
    return np.clip(to_turn, -most, most), gain
