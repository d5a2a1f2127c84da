"""The intruder: a PID waypoint controller on the same kinematics, and a change of its intent.

The paper's intruder flies a passive trajectory by a "simplified PID-based waypoint controller";
changing its intent is the paper's future work and here a part of every encounter (switched off by a
change of 0 rad).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.angles import atan2, sincos, wrap
from envs.arrays import Array, ArrayModule
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance
from envs.reaction import Answer

LOOKAHEAD = 10_000_000.0
"""Distance of the waypoint, m for each second of a time step: no intruder reaches it and turns
back, and a turn's own displacement does not bend the course flown after it (with 50 km, a change of
120 degrees at 1 degree/s would end at 131)."""

COASTING = Limits(0.0, math.inf, 0.0, 0.0, math.inf)
"""Limits of an intruder, which keeps its speed: none is ever reached."""


class Gains(NamedTuple):
    """PID gains from the heading error to the turn in a time step: with 0.5 a step takes half of
    the error back.
    """

    proportional: float = 0.5
    integral: float = 0.0
    derivative: float = 0.0


GAINS = Gains()


class Intent(NamedTuple):
    """A planned change of course; fields ``[..., K]``, s, rad and rad/s."""

    onset: Array  # s after the start; the controller notices it at its next step
    heading_change: Array  # rad, positive to the left, within +-pi; 0 for a passive intruder
    turn_rate: Array  # largest turn rate used, rad/s, positive


class KnownFlight(VehicleState[Air]):
    """A flight that is known already, in the place of an :class:`Intent`; fields ``[..., K, T +
    1]``, numpy.

    Row 0 is the start, and the rows are one time step apart. After the last one the intruder flies
    straight on.
    """


class IntruderState(NamedTuple):
    """Vehicle and controller; fields ``[..., K]``."""

    vehicle: VehicleState[Air]
    waypoint_x: Array  # m
    waypoint_y: Array
    error: Array  # heading error of the step before, rad
    error_sum: Array  # sum of the heading errors, rad times steps


def start(vehicle: VehicleState[Air], xp: ArrayModule) -> IntruderState:
    """Return an intruder at the beginning of its flight, its waypoint straight ahead."""
    sine, cosine = sincos(vehicle.heading, xp)
    return IntruderState(
        vehicle,
        vehicle.x + LOOKAHEAD * cosine,
        vehicle.y + LOOKAHEAD * sine,
        vehicle.heading * 0.0,
        vehicle.heading * 0.0,
    )


def step(
    state: IntruderState,
    intent: Intent | KnownFlight,
    time: Array,
    dt: Array,
    xp: ArrayModule,
    gains: Gains = GAINS,
    *,
    response: Array | None = None,
    answers: Callable[[VehicleState[Air], Array], Answer] | None = None,
) -> IntruderState:
    """Advance the intruder by one step of its motion, or by one row of its recording.

    Args:
        state: ``[..., K]``.
        intent: ``[..., K]``.
        time: s since the start at the beginning of the step, ``[..., 1]`` or broadcastable.
        dt: duration of the step, s.
        response: time step that the gains count in, s, where the motion's is another; None: ``dt``.
        answers: (vehicles, turns back to their courses, rad) -> what they do about the ownship
            (:func:`envs.reaction.answer`); None: nothing.
    """
    period = dt if response is None else response
    far = LOOKAHEAD * period
    vehicle = state.vehicle
    if isinstance(intent, KnownFlight):
        return state._replace(vehicle=_replay_step(vehicle, intent, time, dt))
    # The intent changes in the one step that begins at or within dt after the onset.
    changes = xp.logical_and(time >= intent.onset, time - dt < intent.onset)
    sine, cosine = sincos(wrap(vehicle.heading + intent.heading_change, xp), xp)
    waypoint_x = xp.where(changes, vehicle.x + far * cosine, state.waypoint_x)
    waypoint_y = xp.where(changes, vehicle.y + far * sine, state.waypoint_y)

    error = wrap(atan2(waypoint_y - vehicle.y, waypoint_x - vehicle.x, xp) - vehicle.heading, xp)
    error_sum = state.error_sum + error * (dt / period)
    change = wrap(error - state.error, xp) * (period / dt)
    command = gains.proportional * error + gains.integral * error_sum + gains.derivative * change
    command = command * (1.0 / period)
    yaw_rate = xp.clip(command, -intent.turn_rate, intent.turn_rate)
    if answers is not None:
        answer = answers(vehicle, error)
        yaw_rate = xp.where(answer.reacts, answer.yaw_rate, yaw_rate)
    moved = advance(vehicle, error * 0.0, yaw_rate, dt, COASTING, xp)
    return IntruderState(moved, waypoint_x, waypoint_y, error, error_sum)


def _replay_step(
    vehicle: VehicleState[Air], recording: KnownFlight, time: Array, dt: float
) -> VehicleState[Air]:
    """Return the vehicles after the step that begins at ``time``, ``[..., K]``."""
    zeros = vehicle.heading * 0.0
    straight = advance(vehicle, zeros, zeros, dt, COASTING, np)
    row = np.broadcast_to(np.rint(np.asarray(time) / dt).astype(int) + 1, zeros.shape)
    last = recording.x.shape[-1] - 1
    index = np.minimum(row, last)[..., None]
    return VehicleState(
        *(
            np.where(row <= last, np.take_along_axis(rows, index, axis=-1)[..., 0], onward)
            for rows, onward in zip(recording, straight, strict=True)
        )
    )
