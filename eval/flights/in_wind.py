"""Encounters that a wind carries: drawn in the air mass, with the goal over the ground.

The goal lies where the ownship would arrive if it flew straight on, so that a number is the same
conflict in any wind.
"""

import numpy as np

from envs import draws
from envs.encounters import Encounter
from envs.frames import Air, Ground
from envs.intruder import KnownFlight
from envs.wind import NO_WIND, Wind, over_ground
from eval.flights.trajectories import Trajectories

_STREAM = 0x7769_6E64  # keeps the draws apart from those of encounters with the same seed


def winds(span: tuple[float, float], seed: int, numbers: np.ndarray) -> Wind | None:
    """Return the winds of encounters ``[N]`` by their numbers: of a speed within a span, m/s, in
    any direction; None where the span is [0, 0].
    """
    if span == (0.0, 0.0):
        return None
    u = np.concatenate([draws.uniforms(seed, int(n), 1, (2,), stream=_STREAM) for n in numbers])
    speed, course = span[0] + (span[1] - span[0]) * u[:, 0], 2.0 * np.pi * u[:, 1]
    return Wind(speed * np.cos(course), speed * np.sin(course), np.zeros(len(u)))


def carry(encounters: Encounter, wind: Wind | None) -> Encounter:
    """Return encounters ``[N]``, drawn in the air mass, with their goals over the ground."""
    if wind is None:
        return encounters
    own = encounters.own
    away = np.hypot(encounters.goal_x - own.x, encounters.goal_y - own.y)
    seconds = away / np.maximum(own.speed, 1e-9)
    return encounters._replace(
        goal_x=encounters.goal_x + wind.east * seconds,
        goal_y=encounters.goal_y + wind.north * seconds,
    )


def stand(encounters: Encounter, wind: Wind | None) -> Encounter:
    """Return encounters ``[N]`` in the air mass whose intruders of speed 0 stand on the ground."""
    if wind is None or isinstance(encounters.intent, KnownFlight):
        return encounters
    others, intent = encounters.intruders, encounters.intent
    stands = others.speed == 0.0
    east, north = (np.broadcast_to(part, wind.east.shape)[:, None] for part in wind[:2])
    return encounters._replace(
        intruders=others._replace(
            heading=np.where(stands, np.arctan2(-north, -east), others.heading),
            speed=np.where(stands, np.hypot(east, north), others.speed),
        ),
        intent=intent._replace(heading_change=np.where(stands, 0.0, intent.heading_change)),
    )


def drift_of(wind: Wind | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the velocity at which what stands on the ground moves through the air, m/s,
    ``[N]``.
    """
    return None if wind is None else (-wind.east, -wind.north)


def to_ground(flown: Trajectories[Air], wind: Wind | None, dt: float) -> Trajectories[Ground]:
    """Return trajectories of steps of dt, s, ``[T, N]``, as the ground sees them."""
    time = np.arange(len(flown.own.x))[:, None] * dt
    blows = wind or NO_WIND
    wind_of_each = blows if wind is None else Wind(wind.east[:, None], wind.north[:, None])
    own = over_ground(flown.own, blows, time)
    others = over_ground(flown.intruders, wind_of_each, time[..., None])
    return Trajectories(own, others, flown.action, flown.separation, flown.altitudes)
