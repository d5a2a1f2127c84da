"""The simulator of manoeuvres: many at once, away from the route until the way back is clear.

What the flights are tested against is an argument (:class:`Surroundings`): the planner's fallback
gives the predicted traffic and the areas. Backups are ranked on the same motion
(:func:`integrate`).

Several strides are flown at once: calls on arrays cost more than strides that are flown beyond an
end.

For one request the planner flies the same manoeuvres compiled, one after the other in each stride
(:mod:`agents.planner.search.compiled_flight`). Two flights remain beside this one, because their
commands follow from the state at every step. The clairvoyant search also flies the way home
(:func:`agents.manoeuvres.escape_manoeuvre.fly_step`). The policy's flight asks the network
(:mod:`agents.planner.search.rollout`).
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from agents.manoeuvres.escape_manoeuvre import Flight, Manoeuvre, steer_away, takeoff
from envs.angles import wrap
from envs.arrays import Array
from envs.backend import FLOATS
from envs.compiled import scalar
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.trees import scatter, take

_AT_ONCE = 6  # strides flown at once at first
# strides times manoeuvres times intruders at once: more do not stay in a core's cache
_PAIRS = 8_192


class Departure(NamedTuple):
    """States in which manoeuvres may turn back; fields ``[R]``."""

    own: VehicleState[Air]
    stride: Array  # number of the stride that begins there
    owner: Array  # whose manoeuvre it is
    slack: Array  # what the way back keeps beyond the required distance, m


class Surroundings(Protocol):
    """What manoeuvres of N owners are tested against."""

    @property
    def intruders(self) -> int:
        """About how many each flight is set against."""
        ...

    def clearance(self, flown: VehicleState[Air], first: int, owner: Array) -> Array:
        """Return the least distance less the required one in each stride of flights, m, ``[S, M]``.

        Args:
            flown: states at the ends of the strides, ``[S + 1, M]``.
            first: number of the first stride.
            owner: whose flights they are, ``[M]``.
        """
        ...

    def way_back(self, departure: Departure) -> Array:
        """Return whether the way back is clear, bool ``[R]``."""
        ...


def _never() -> bool:
    return False


class Effort(NamedTuple):
    """When manoeuvres are given up."""

    least: float  # below this clearance, m
    good: float  # clearance with which a manoeuvre ends well, m
    enough: int  # once so many of an owner's manoeuvres have ended well, the others are
    longest: float = np.inf  # latest time at which a manoeuvre may turn back, s
    ends: Callable[[], bool] = _never  # whether the flight of all ends now


class Finished(NamedTuple):
    """Where manoeuvres have been and ended; fields ``[M]``."""

    states: VehicleState[Air]  # at the beginning of each stride until the end, [S, M]; nan after it
    end: Array  # number of the stride at whose beginning each ended
    returned: Array  # whether it turned back there, bool; else it was given up
    clearance: Array  # least distance less the required one until then, m; an estimate


class _Active(NamedTuple):
    """Manoeuvres in the air; fields ``[M]``."""

    row: Array  # their numbers
    owner: Array
    manoeuvre: Manoeuvre
    flight: Flight
    closest: Array  # clearance so far, m


def fly_until_clear(
    own: VehicleState[Air],
    owner: Array,
    manoeuvre: Manoeuvre,
    around: Surroundings,
    effort: Effort,
    stride: float,
    until: float,
    limits: Limits,
) -> Finished:
    """Fly manoeuvres ``[M]`` until the way back is clear, or they are given up.

    Args:
        own: states in which the owners' manoeuvres begin, ``[N]``.
        owner: number of the owner of each manoeuvre, ``[M]``.
        manoeuvre: parameters, ``[M]``.
        around: what the flights are tested against.
        effort: when manoeuvres are given up.
        stride: time step, s.
        until: latest time at which a manoeuvre may turn back, s, whatever the effort.
        limits: of the ownship.
    """
    last = int(min(until, effort.longest) / stride + 1e-9)
    finished = _nothing(owner.size, last)
    count_well = np.zeros(np.size(own.x), dtype=int)
    active = _Active(
        row=np.arange(owner.size),
        owner=owner,
        manoeuvre=manoeuvre,
        flight=takeoff(take(own, owner), manoeuvre),
        closest=np.full(owner.size, np.inf),
    )
    first = 0
    while active.row.size and first <= last and not effort.ends():
        # As many strides as before, because the direct route is mostly clear soon.
        most = _PAIRS // max(active.row.size * around.intruders, 1)
        count = min(max(min(max(first, _AT_ONCE), most), 1), last + 1 - first)
        flown, flight = fly_away(active.flight, active.manoeuvre, first, count, stride, limits)
        clearance = around.clearance(flown, first, active.owner)
        # At the beginning of each stride, and after the last.
        nearest = np.minimum.accumulate(np.concatenate([active.closest[None], clearance]), axis=0)
        active = active._replace(flight=flight, closest=nearest[-1])
        nearest = nearest[:-1]
        returning = _may_turn_back(active, flown, nearest, first, stride, around, effort)
        over, count_well = _ends(active.owner, nearest, returning, count_well, effort)
        on = over == count
        over = np.minimum(over, count - 1)
        _note(finished, active.row, first, flown, over, ~on, returning, nearest)
        if not on.all():
            active = take(active, on)
        first += count
    return finished


def _may_turn_back(
    active: _Active,
    flown: VehicleState[Air],
    nearest: Array,
    first: int,
    stride: float,
    around: Surroundings,
    effort: Effort,
) -> Array:
    """Return at the beginning of which strides manoeuvres may turn back, bool ``[S, M]``."""
    strides = np.arange(first, first + len(nearest))
    returning = (nearest >= effort.least) & (strides[:, None] * stride >= active.manoeuvre.resume)
    at, asking = np.nonzero(returning)
    slack = active.manoeuvre.slack[asking]
    departure = Departure(take(flown, (at, asking)), strides[at], active.owner[asking], slack)
    returning[at, asking] = around.way_back(departure)
    return returning


def _ends(
    owner: Array, nearest: Array, returning: Array, count_well: Array, effort: Effort
) -> tuple[Array, Array]:
    """Return the stride at whose beginning each manoeuvre ends, ``[M]``, all of them where it does
    not, and how many have ended well, ``[N]``.
    """
    count, rows = len(nearest), np.arange(owner.size)
    end, ended = _first(returning | ~(nearest >= effort.least))
    good = nearest[end, rows] >= max(effort.least, effort.good)
    returned = ended & returning[end, rows] & good
    # A manoeuvre that is under way for longer than so many others costs more than they.
    well = np.zeros((count, count_well.size), dtype=int)
    np.add.at(well, (end[returned], owner[returned]), 1)
    well = count_well + np.cumsum(well, axis=0)
    full, enough_there = _first(well >= effort.enough)
    own_end = np.where(ended, end, count)
    return np.minimum(own_end, np.where(enough_there, full, count)[owner]), well[-1]


def _first(happens: Array) -> tuple[Array, Array]:
    """Return in which row something ``[S, M]`` happens first, 0 where it does not, and whether it
    does, ``[M]``.
    """
    return np.argmax(happens, axis=0), happens.any(axis=0)


def _nothing(count: int, last: int) -> Finished:
    """Return that no manoeuvre has been flown, ``[count]``."""
    states: VehicleState[Air] = VehicleState(*np.full((4, last + 1, count), np.nan))
    no = np.zeros(count, dtype=bool)
    return Finished(states, np.full(count, last), no, np.full(count, np.inf))


def _note(
    finished: Finished,
    row: Array,
    first: int,
    flown: VehicleState[Air],
    over: Array,
    ended: Array,
    returning: Array,
    nearest: Array,
) -> None:
    """Note strides of manoeuvres: the last of them in which each is in the air, and whether it
    turned back there.
    """
    rows, count = np.arange(row.size), len(nearest)
    scatter(finished.states, (slice(first, first + count), row), take(flown, slice(-1)))
    finished.end[row] = first + over
    finished.returned[row] = ended & returning[over, rows]
    finished.clearance[row] = nearest[over, rows]


def fly_away(
    flight: Flight, manoeuvre: Manoeuvre, first: int, count: int, dt: float, limits: Limits
) -> tuple[VehicleState[Air], Flight]:
    """Fly ``count`` steps of ``dt`` seconds of escapes ``[M]`` as
    :func:`agents.manoeuvres.escape_manoeuvre.fly` does, from step number ``first`` on.

    The way to the goal is the caller's: until it turns back, headings and speeds of an escape
    follow from its manoeuvre alone.

    Returns:
        The states at the beginning and after every step, ``[count + 1, M]``, and the escapes at the
        end, their headings not wrapped, so that the result does not depend on how many steps are
        flown at once.
    """
    own, full_turn = flight.own, limits.yaw_rate_max * dt
    shape = (count, np.size(own.x))
    turns, throttles = np.empty(shape), np.empty(shape)
    for number in range(count):
        away = steer_away(flight, manoeuvre, (first + number) * dt, full_turn, np)
        turns[number], throttles[number] = away.turn, away.throttle
        flight = flight._replace(to_turn=away.to_turn - away.turn, switched=away.switched)
    acceleration, yaw_rate = commands((throttles, turns / full_turn), limits, np)
    states, end = integrate(own, acceleration, yaw_rate, dt, limits)
    return states, flight._replace(own=end)


@scalar
def fly_one_away(
    flight: Flight, manoeuvre: Manoeuvre, number: int, dt: float, limits: Limits
) -> Flight:
    """Return what :func:`fly_away` does of step ``number`` of one escape, in plain floats."""
    own, full_turn = flight.own, limits.yaw_rate_max * dt
    away = steer_away(flight, manoeuvre, number * dt, full_turn, FLOATS)
    acceleration, yaw_rate = commands((away.throttle, away.turn / full_turn), limits, FLOATS)
    at_origin = VehicleState(0.0, 0.0, wrap(own.heading, FLOATS), own.speed)
    moved = advance(at_origin, acceleration, yaw_rate, dt, limits, FLOATS)
    low, high = min(own.speed, limits.speed_min), max(own.speed, limits.speed_max)
    speed = min(max(own.speed + acceleration * dt, low), high)
    x, y, course = own.x + moved.x, own.y + moved.y, own.heading + yaw_rate * dt
    after: VehicleState[Air] = VehicleState(x, y, course, speed)
    return Flight(after, away.to_turn - away.turn, away.switched, flight.returning)


def integrate(
    own: VehicleState[Air], acceleration: Array, yaw_rate: Array, dt: float, limits: Limits
) -> tuple[VehicleState[Air], VehicleState[Air]]:
    """Return motion under known controls, every displacement found at once.

    Args:
        own: states at the beginning, ``[M]``.
        acceleration: of each step, m/s^2, ``[S, M]``; only the speed limits are applied here.
        yaw_rate: of each step, rad/s, ``[S, M]``.
        dt: time step, s.
        limits: of the speed.

    Returns:
        The states at the beginning and after every step, ``[S + 1, M]``, and the state at the end
        with a heading that is not wrapped, ``[M]``: who goes on from there gets the bits of a
        motion that is integrated at once.
    """
    count = len(acceleration)
    speed = np.empty((count + 1, acceleration.shape[1]))
    speed[0] = own.speed
    for number in range(count):
        # As in advance: a speed beyond a limit stays until it is commanded inwards.
        low = np.minimum(speed[number], limits.speed_min)
        high = np.maximum(speed[number], limits.speed_max)
        after = speed[number] + acceleration[number] * dt
        np.clip(after, low, high, out=speed[number + 1])
    course = _running_sums(own.heading, yaw_rate * dt)
    heading = wrap(course, np)
    at_origin = VehicleState(0.0, 0.0, heading[:-1], speed[:-1])
    moved = advance(at_origin, acceleration, yaw_rate, dt, limits, np)
    x, y = _running_sums(own.x, moved.x), _running_sums(own.y, moved.y)
    return VehicleState(x, y, heading, speed), VehicleState(x[-1], y[-1], course[-1], speed[-1])


def _running_sums(start: Array, steps: Array) -> Array:
    """Return the running sums of steps ``[S, M]`` from a start ``[M]``, ``[S + 1, M]``."""
    return np.add.accumulate(np.concatenate([start[None], steps]), axis=0)
