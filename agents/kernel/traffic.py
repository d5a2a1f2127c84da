"""The intruders as the planner predicts them, and the separation that is required from each."""

import math
from typing import NamedTuple

import numpy as np

from envs.angles import wrap
from envs.arrays import Array, Bool, Float
from envs.backend import FLOATS
from envs.compiled import scalar
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import column, map_leaves

STRAIGHT = 1e-30
"""Turn rate of a turn that is none, rad/s."""

WINDOW_EDGE = 1e-6
"""By how much a window may be wider, for the rounding of times, s."""

_SAME_PLACE = 1e-6  # m by which an intruder may leave its report's flight for rounding's sake


class Window(NamedTuple):
    """When each of some intruders counts, s after the request; fields ``[..., K]``."""

    begin: Array  # -inf: from the request on at least
    end: Array


class Traffic(NamedTuple):
    """Intruders of one or many requests; fields ``[..., K]``."""

    state: VehicleState[Air]  # at the time of the request
    mask: Array  # which of the K intruders count, bool
    turn_rate: Array  # with which each goes on turning, rad/s, positive to the left
    turn_time: Array  # for how long it does, s; straight ahead after that
    position_std: Array  # one sigma of the position, per axis, at the time of the report, m
    velocity_std: Array  # one sigma of the velocity, per axis, m/s
    # of the report at the request, s: for so long the velocity's error has moved the position
    # already
    age: Array
    # to be kept from each, m; nan: the requirement's; None: so for all
    separation: Array | None = None
    # when each counts; else it is above or below. None: all of them always
    window: Window | None = None

    @classmethod
    def straight(cls, state: VehicleState[Air], mask: Array | None = None) -> "Traffic":
        """Return intruders that are known exactly and fly straight ahead, ``[..., K]``."""
        zero = np.zeros(np.shape(state.x))
        return cls(
            state=state,
            mask=np.ones(zero.shape, dtype=bool) if mask is None else mask,
            turn_rate=zero,
            turn_time=zero,
            position_std=zero,
            velocity_std=zero,
            age=zero,
        )


def whole(traffic: Traffic) -> Traffic:
    """Return the intruders with an array in every field, which rows of others can be written
    into.
    """
    shape = np.shape(traffic.mask)
    if traffic.separation is None:
        traffic = traffic._replace(separation=np.full(shape, np.nan))
    if traffic.window is None:
        traffic = traffic._replace(window=Window(np.full(shape, -np.inf), np.full(shape, np.inf)))
    return traffic


def within_window(
    traffic: Traffic, begin: Float[Array, "..."], end: Float[Array, "..."]
) -> Bool[Array, "..."]:
    """Return which intruders ``[..., K]`` may count in parts from some times to others, s, that
    broadcast; all of them where nobody has a window.
    """
    window = traffic.window
    if window is None:
        return True
    return (end >= window.begin - WINDOW_EDGE) & (begin <= window.end + WINDOW_EDGE)


def turn_error(
    speed: Float[Array, "..."], turn_std: Float[Array, "..."], turn_time: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return one sigma of the velocity, m/s, that bounds an error of the turn rate, rad/s, where
    the turn goes on for a time, s.

    t seconds into the turn the error has moved the position by ``speed turn_std t^2 / 2``, after
    its end by ``speed turn_std turn_time`` more each second: a line of that slope bounds both.
    """
    return speed * turn_std * turn_time


class Requirement(NamedTuple):
    """How far the plan must stay from the intruders."""

    separation: float  # never less than this from an intruder without one of its own, m
    margin: float = 0.0  # added to it for what the follower leaves of the plan, m
    sigmas: float = 2.0  # how many sigmas of the predicted position are added


def predict(traffic: Traffic, time: Float[Array, "..."]) -> VehicleState[Air]:
    """Return the intruders ``[..., K]`` some seconds (that broadcast) after the request: a turn,
    then straight on.
    """
    x, y = positions(traffic, time)
    heading = traffic.state.heading + traffic.turn_rate * np.minimum(time, traffic.turn_time)
    return VehicleState(x, y, wrap(heading, np), traffic.state.speed + np.zeros_like(x))


def positions(
    traffic: Traffic, time: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Return where the intruders ``[..., K]`` are some seconds (that broadcast) after the request,
    m.
    """
    state = traffic.state
    x, y = (
        np.asarray(start + state.speed * part(state.heading) * time)
        for start, part in ((state.x, np.cos), (state.y, np.sin))
    )
    # Only turning ones are treated apart, so that the rounding of one does not depend on the
    # others.
    turning = (np.abs(traffic.turn_rate) > STRAIGHT) & (traffic.turn_time > 0.0)
    if turning.any():
        turns = np.broadcast_to(turning, x.shape)
        turners = map_leaves(lambda field: np.broadcast_to(field, x.shape)[turns], traffic)
        x[turns], y[turns] = _positions_of_turning(turners, np.broadcast_to(time, x.shape)[turns])
    return x, y


def _positions_of_turning(traffic: Traffic, time: Array) -> tuple[Array, Array]:
    turning, state = np.minimum(time, traffic.turn_time), traffic.state
    # A turn's chord points half-way through it. Differences of sines would lose 0.1 mm in turns of
    # 1e-9 rad/s.
    half = 0.5 * traffic.turn_rate * turning
    chord = 2.0 * state.speed * np.sin(half) / traffic.turn_rate
    middle, after = state.heading + half, state.heading + 2.0 * half
    straight = state.speed * (time - turning)
    x = state.x + chord * np.cos(middle) + straight * np.cos(after)
    y = state.y + chord * np.sin(middle) + straight * np.sin(after)
    return x, y


@scalar
def predict_one(
    state: VehicleState[Air], turn_rate: float, turn_time: float, time: float
) -> VehicleState[Air]:
    """Return :func:`predict` of one intruder in plain floats."""
    if not (abs(turn_rate) > STRAIGHT and turn_time > 0.0):
        x = state.x + state.speed * math.cos(state.heading) * time
        y = state.y + state.speed * math.sin(state.heading) * time
        heading = state.heading + turn_rate * min(time, turn_time)
        return VehicleState(x, y, wrap(heading, FLOATS), state.speed)
    turning = min(time, turn_time)
    x, y = place_in_turn(state, turn_rate, turning)
    turned = turn_rate * turning
    after, straight = state.heading + turned, state.speed * (time - turning)
    x, y = x + straight * math.cos(after), y + straight * math.sin(after)
    return VehicleState(x, y, wrap(after, FLOATS), state.speed)


@scalar
def place_in_turn(state: VehicleState[Air], turn_rate: float, time: float) -> tuple[float, float]:
    """Return :func:`positions` of one intruder that still turns, in plain floats, m."""
    half = 0.5 * turn_rate * time
    chord = 2.0 * state.speed * math.sin(half) / turn_rate
    middle = state.heading + half
    return state.x + chord * math.cos(middle), state.y + chord * math.sin(middle)


def same_flight(reports: Traffic, age: Float[Array, "N K"], traffic: Traffic) -> Bool[Array, "N K"]:
    """Return whether intruders as of the request fly on as their reports say, which are of some
    age then, s.

    They are looked at where they stand, half-way through the turn, at its end and long after it:
    two arcs of one rate through the same points are the same, two straight lines too.
    """
    reported, used = (map_leaves(np.ravel, source) for source in (reports, traffic))
    turn = used.turn_time[:, None]
    times = np.concatenate([turn * np.array([0.0, 0.5, 1.0]), turn + 500.0], axis=1)
    reported_at = positions(column(reported), times + np.ravel(age)[:, None])
    used_at = positions(column(used), times)
    near = (
        np.hypot(reported_at[0] - used_at[0], reported_at[1] - used_at[1]).max(axis=1)
        <= _SAME_PLACE
    )
    alike = (used.turn_time == 0.0) | (reported.turn_rate == used.turn_rate)
    return (near & alike & (reported.mask == used.mask)).reshape(np.shape(age))


def advance_reports(reports: Traffic, age: Float[Array, "... K"]) -> Traffic:
    """Return the intruders ``[..., K]`` at the request from reports of an age, s: flown on along
    their turns, or back where the age is below 0.

    The spreads stay those of the reports: one error of the velocity lasts from the report on, so
    that what it adds before the request and after it must not be added like independent errors
    (:func:`uncertainty`).
    """
    if not np.any(age):
        return reports._replace(
            state=reports.state._replace(heading=wrap(reports.state.heading, np))
        )
    turn_rate = np.where(reports.turn_time > 0.0, reports.turn_rate, 0.0)
    turn_time = np.where(turn_rate == 0.0, 0.0, np.maximum(reports.turn_time - age, 0.0))
    turning = reports._replace(turn_rate=turn_rate)
    return turning._replace(state=predict(turning, age), turn_time=turn_time, age=np.abs(age))


@scalar
def scalar_uncertainty(position_std: float, velocity_std: float, age: float, time: float) -> float:
    """Return :func:`uncertainty` of one intruder in plain floats, m."""
    drift = velocity_std * (age + time)
    return math.sqrt(position_std * position_std + drift * drift)


def uncertainty(traffic: Traffic, time: Float[Array, "..."]) -> Float[Array, "... K"]:
    """Return one sigma of the positions some seconds after the request, per axis, m."""
    drift = traffic.velocity_std * (traffic.age + time)
    return np.sqrt(traffic.position_std**2 + drift * drift)


def growth(traffic: Traffic, time: Float[Array, "..."], sigmas: float) -> Float[Array, "..."]:
    """Return what uncertainty adds to the required distance by some seconds after the request, m;
    the intruders broadcast against the times.
    """
    if not (sigmas and traffic.velocity_std.any()):
        return 0.0
    return sigmas * (uncertainty(traffic, np.maximum(time, 0.0)) - uncertainty(traffic, 0.0))


@scalar
def scalar_growth(
    position_std: float, velocity_std: float, age: float, time: float, sigmas: float
) -> float:
    """Return :func:`growth` of one intruder in plain floats, m."""
    if velocity_std == 0.0:
        return 0.0
    later = scalar_uncertainty(position_std, velocity_std, age, max(time, 0.0))
    return sigmas * (later - scalar_uncertainty(position_std, velocity_std, age, 0.0))


def separations(traffic: Traffic, requirement: Requirement) -> Float[Array, "... K"]:
    """Return the separation from each intruder, m, or one for all."""
    own = traffic.separation
    if own is None:
        return requirement.separation
    return np.where(np.isnan(own), requirement.separation, own)


def requirement_of(
    traffic: Traffic, own: VehicleState[Air], requirement: Requirement
) -> Float[Array, "... K"]:
    """Return the separation required from each intruder before uncertainty grows, m.

    Where the request begins inside the margin, the present distance from the ownship ``[...]`` must
    not decrease; it is never less than the separation. Of an intruder that counts later only the
    present distance says nothing.
    """
    away = np.hypot(traffic.state.x - own.x[..., None], traffic.state.y - own.y[..., None])
    if traffic.window is not None:
        away = np.where(traffic.window.begin > 0.0, np.inf, away)
    separation = separations(traffic, requirement)
    usual = separation + requirement.margin + requirement.sigmas * uncertainty(traffic, 0.0)
    return np.maximum(separation, np.minimum(usual, away))
