"""The intruders as the planner predicts them, and the separation that is required from each."""

from typing import NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import arc_end
from envs.angles import wrap
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState

_EDGE = 1e-6  # s by which a window may be wider, for the rounding of times


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


def within_window(traffic: Traffic, begin: Array, end: Array) -> Array:
    """Return which intruders ``[..., K]`` may count in parts from some times to others, s, that
    broadcast; all of them where nobody has a window.
    """
    window = traffic.window
    if window is None:
        return True
    return (end >= window.begin - _EDGE) & (begin <= window.end + _EDGE)


class Requirement(NamedTuple):
    """How far the plan must stay from the intruders."""

    separation: float  # never less than this from an intruder without one of its own, m
    margin: float = 0.0  # added to it for what the follower leaves of the plan, m
    sigmas: float = 2.0  # how many sigmas of the predicted position are added


def predict(traffic: Traffic, time: Array) -> VehicleState[Air]:
    """Return the intruders ``[..., K]`` some seconds (that broadcast) after the request: a turn,
    then straight on.
    """
    state = traffic.state
    turning = np.minimum(time, traffic.turn_time)
    arc = traffic.turn_rate * turning
    x, y = arc_end(state, arc, state.speed * turning)
    heading, straight = state.heading + arc, state.speed * (time - turning)
    x, y = x + straight * np.cos(heading), y + straight * np.sin(heading)
    return VehicleState(x, y, wrap(heading, np), state.speed + np.zeros_like(x))


def advance_reports(reports: Traffic, age: Array) -> Traffic:
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


def uncertainty(traffic: Traffic, time: Array) -> Array:
    """Return one sigma of the positions some seconds after the request, per axis, m,
    ``[..., K]``.
    """
    drift = traffic.velocity_std * (traffic.age + time)
    return np.sqrt(traffic.position_std**2 + drift * drift)


def separations(traffic: Traffic, requirement: Requirement) -> Array:
    """Return the separation from each intruder, m, ``[..., K]``, or one for all."""
    own = traffic.separation
    if own is None:
        return requirement.separation
    return np.where(np.isnan(own), requirement.separation, own)


def requirement_of(traffic: Traffic, own: VehicleState[Air], requirement: Requirement) -> Array:
    """Return the separation required from each intruder before uncertainty grows, m, ``[..., K]``.

    Where the request begins inside the margin, the present distance from the ownship ``[...]`` must
    not decrease; it is never less than the separation. Of an intruder that counts later only the
    present distance says nothing.
    """
    away = np.hypot(traffic.state.x - own.x[..., None], traffic.state.y - own.y[..., None])
    if traffic.window is not None:
        away = np.where(traffic.window.begin > 0.0, np.inf, away)
    separation = separations(traffic, requirement)
    wanted = separation + requirement.margin + requirement.sigmas * uncertainty(traffic, 0.0)
    return np.maximum(separation, np.minimum(wanted, away))
