"""Motion of an aircraft in the horizontal plane: a mass-less Dubins vehicle with speed control.

The exact solution for constant acceleration and yaw rate replaces an Euler step, which would shift
every turn by up to 50 m (source: the paper's surrogate, section "Surrogate Environment"; closed
form ours). Frame: local ENU, x east and y north in metres; heading counter-clockwise from east in
[-pi, pi).
"""

import math
from typing import Generic, NamedTuple

from envs.angles import sincos, wrap
from envs.arrays import Array, ArrayModule
from envs.compiled import scalar
from envs.frames import F


class VehicleState(NamedTuple, Generic[F]):
    """Position, heading and speed of one or many aircraft in a frame (:mod:`envs.frames`), SI units
    and radians; fields ``[...]``.
    """

    x: Array  # east position, m
    y: Array  # north position, m
    heading: Array  # direction of the velocity, rad counter-clockwise from east, in [-pi, pi)
    speed: Array  # speed along the heading, m/s


class Limits(NamedTuple):
    """What a vehicle can do, SI units and radians; floats, or arrays that broadcast against the
    state.
    """

    speed_min: Array  # m/s
    speed_max: Array  # m/s
    acceleration_min: Array  # strongest deceleration, m/s^2, negative
    acceleration_max: Array  # m/s^2
    yaw_rate_max: Array  # largest turn rate to either side, rad/s


SURROGATE = Limits(50.0, 100.0, -0.5, 0.5, math.radians(3.0))
"""The surrogate's conservative limits (paper, table "Surrogate vs. true dynamic parameters")."""

FASTEST = Limits(400.0, 400.0, -20.0, 20.0, math.radians(57.0))
"""Beyond any aircraft that this world describes: what configurations and policy files may ask for
at most.
"""

C208_PUBLISHED = Limits(31.0, 100.0, -0.8, 0.5, math.radians(5.0))
"""The Cessna 208's limits as the paper states them (same table); JSBSim's are narrower."""


UNLIMITED = Limits(-math.inf, math.inf, -math.inf, math.inf, math.inf)
"""No limits, where controls respect them already."""


def within(inner: Limits, outer: Limits) -> bool:
    """Return whether all that inner limits allow is allowed by outer ones, too; floats."""
    return (
        outer.speed_min <= inner.speed_min
        and inner.speed_max <= outer.speed_max
        and outer.acceleration_min <= inner.acceleration_min
        and inner.acceleration_max <= outer.acceleration_max
        and inner.yaw_rate_max <= outer.yaw_rate_max
    )


def intersection(first: Limits, second: Limits) -> Limits:
    """Return the limits that keep both; floats.

    Raises:
        ValueError: they share less than 1 m/s of speed.
    """
    limits = Limits(
        speed_min=max(first.speed_min, second.speed_min),
        speed_max=min(first.speed_max, second.speed_max),
        acceleration_min=max(first.acceleration_min, second.acceleration_min),
        acceleration_max=min(first.acceleration_max, second.acceleration_max),
        yaw_rate_max=min(first.yaw_rate_max, second.yaw_rate_max),
    )
    if limits.speed_min >= limits.speed_max - 1.0:
        raise ValueError(
            f"allows {second.speed_min:g} to {second.speed_max:g} m/s; expected a range that "
            f"overlaps {first.speed_min:g} to {first.speed_max:g} m/s by more than 1 m/s"
        )
    return limits


@scalar
def commands(action: Array, limits: Limits, xp: ArrayModule) -> tuple[Array, Array]:
    """Return the acceleration (m/s^2) and yaw rate (rad/s) that an action asks for, ``[...]`` each.

    The action, a pair or an array ``[2, ...]``, holds shares of the limits in [-1, 1]; values
    beyond are clipped.
    """
    throttle = xp.clip(action[0], -1.0, 1.0)
    steering = xp.clip(action[1], -1.0, 1.0)
    acceleration = xp.where(
        throttle >= 0.0, throttle * limits.acceleration_max, -throttle * limits.acceleration_min
    )
    return acceleration, steering * limits.yaw_rate_max


@scalar
def velocity(state: VehicleState[F], xp: ArrayModule) -> tuple[Array, Array]:
    """Return the velocity's east and north components, m/s, ``[...]`` each."""
    sine, cosine = sincos(state.heading, xp)
    return state.speed * cosine, state.speed * sine


@scalar
def advance(
    state: VehicleState[F],
    acceleration: Array,
    yaw_rate: Array,
    dt: Array,
    limits: Limits,
    xp: ArrayModule,
) -> VehicleState[F]:
    """Move the vehicle by ``dt`` seconds under constant acceleration and yaw rate.

    The speed stops at its limit inside the step: the motion is one accelerated arc up to that
    moment and one at constant speed after it, both exact. A speed outside the limits stays until it
    is commanded inwards.

    Args:
        state: ``[...]``.
        acceleration: m/s^2, ``[...]``; only the speed limits are applied here, not those on
            commands.
        yaw_rate: rad/s, positive to the left, ``[...]``; ``|yaw_rate| * dt`` must not exceed 1 rad.
        dt: s, broadcasts.
    """
    # The gap and not the limit is chosen: of two plain numbers numpy would make float64.
    gap = xp.where(
        acceleration > 0.0, limits.speed_max - state.speed, limits.speed_min - state.speed
    )
    # The guard makes a zero acceleration reach its limit after an age, not never.
    rate = xp.where(xp.abs(acceleration) < 1e-9, -1e-9, acceleration)
    accelerated = xp.clip(gap / rate, 0.0, dt)
    steady = dt - accelerated
    speed = state.speed + acceleration * accelerated

    east_1, north_1 = _arc(state.heading, state.speed, acceleration, yaw_rate, accelerated, xp)
    east_2, north_2 = _arc(state.heading + yaw_rate * accelerated, speed, 0.0, yaw_rate, steady, xp)
    heading = wrap(state.heading + yaw_rate * dt, xp)
    return VehicleState(state.x + east_1 + east_2, state.y + north_1 + north_2, heading, speed)


@scalar
def _arc(
    heading: Array,
    speed: Array,
    acceleration: Array,
    yaw_rate: Array,
    duration: Array,
    xp: ArrayModule,
) -> tuple[Array, Array]:
    """Return the displacement (m) of an arc, in the frame of its middle heading and then in ENU.

    With h half the duration and theta = yaw_rate h, integrating the velocity about the middle of
    the arc gives 2 h v_m sin(theta)/theta along the middle heading and 2 h^2 a (sin(theta) - theta
    cos(theta))/theta^2 to its left. Both quotients are power series here, exact to 1e-10 for
    |theta| <= 0.5 and without a pole at 0.
    """
    half = 0.5 * duration
    theta = yaw_rate * half
    square = theta * theta
    sinc = 1.0 - square * (1.0 / 6.0) * (
        1.0 - square * (1.0 / 20.0) * (1.0 - square * (1.0 / 42.0))
    )
    slant = theta * (1.0 / 3.0) * (1.0 - square * (1.0 / 10.0) * (1.0 - square * (1.0 / 28.0)))
    along = duration * (speed + acceleration * half) * sinc
    left = duration * half * acceleration * slant
    sine, cosine = sincos(heading + theta, xp)
    return along * cosine - left * sine, along * sine + left * cosine
