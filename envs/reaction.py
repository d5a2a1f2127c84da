"""Intruders that answer the ownship: they give way by the rules of the air, or turn into its way.

They see the ownship as it is, and take it to fly straight on. Who does neither flies as in
:mod:`envs.intruder`.
"""

import math
from typing import NamedTuple

from envs.angles import wrap
from envs.arrays import Array, ArrayModule
from envs.frames import F
from envs.kinematics import VehicleState, velocity
from envs.relative import bearing, distance, straight_cpa

GIVES_WAY, TAKES_NO_NOTICE, TURNS_INTO = 1.0, 0.0, -1.0
"""Manners of an intruder."""

AHEAD = math.radians(10.0)
"""Who is farther to the left than this has to give way itself; nearer to the course, both turn to
the right (ICAO Annex 2, 3.2.2.2 and 3.2.2.3)."""

ABAFT = math.radians(110.0)
"""Who comes from farther behind overtakes, and has to keep clear itself (3.2.2.4)."""

NAVIGATION = 3.0
"""Turn rate of who turns into the ownship's way, in the rate at which the line of sight turns
(proportional navigation: it meets what flies straight on)."""


class Reaction(NamedTuple):
    """How intruders answer the ownship; fields ``[..., K]``."""

    manner: Array  # one of GIVES_WAY, TAKES_NO_NOTICE and TURNS_INTO
    ahead: Array  # closest approaches within this time are answered, s
    within: Array  # those nearer than this are, m
    heading_change: Array  # greatest turn off its own course, rad, positive
    turn_rate: Array  # greatest turn rate, rad/s, positive


NONE = Reaction(TAKES_NO_NOTICE, 0.0, 0.0, 0.0, 0.0)
"""That of an intruder which takes no notice."""


class Answer(NamedTuple):
    """What intruders do now; fields ``[..., K]``."""

    reacts: Array  # whether they turn otherwise than their controller would, bool
    yaw_rate: Array  # rad/s, where they do


def answer(
    vehicle: VehicleState[F], back: Array, own: VehicleState[F], reaction: Reaction, xp: ArrayModule
) -> Answer:
    """Return what intruders ``[..., K]`` do about the ownship ``[..., 1]``.

    Args:
        back: turn that brings each back to its course, rad, left positive.
    """
    gives_way = reaction.manner == GIVES_WAY
    turns_into = reaction.manner == TURNS_INTO

    # Who gives way turns to the side on which it passes anyway, to the right where they would
    # collide, until it passes clear; it comes back once its own course is clear.
    on_course = vehicle._replace(heading=wrap(vehicle.heading + back, xp))
    in_the_way = _conflict(on_course, own, reaction, xp)
    seen_at = bearing(on_course, own.x, own.y, xp)
    must = (seen_at <= AHEAD) & (seen_at >= -ABAFT)
    approaches = _conflict(vehicle, own, reaction, xp)
    drift = sight_rate(vehicle, own, xp)
    side = xp.where(drift >= 0.0, -1.0, 1.0)
    away = xp.where(approaches, side * reaction.turn_rate, 0.0)

    # Who turns into the ownship's way stops the line of sight from turning.
    towards = xp.clip(NAVIGATION * drift, -reaction.turn_rate, reaction.turn_rate)

    turn_rate = xp.where(gives_way, away, towards)
    # The turn off its course is -back; no one turns farther than its greatest.
    too_far = (turn_rate * -back > 0.0) & (xp.abs(back) >= reaction.heading_change)
    reacts = (gives_way & in_the_way & must) | (turns_into & approaches)
    return Answer(reacts, xp.where(too_far, 0.0, turn_rate))


def _conflict(
    vehicle: VehicleState[F], own: VehicleState[F], reaction: Reaction, xp: ArrayModule
) -> Array:
    """Return which straight flights come near soon, bool ``[..., K]``."""
    cpa = straight_cpa(vehicle, own, xp)
    soon = (cpa.time > 0.0) & (cpa.time <= reaction.ahead)
    return soon & (cpa.distance < reaction.within)


def sight_rate(vehicle: VehicleState[F], own: VehicleState[F], xp: ArrayModule) -> Array:
    """Return how fast the line from intruders ``[..., K]`` to the ownship turns, rad/s, left
    positive.
    """
    x, y = own.x - vehicle.x, own.y - vehicle.y
    (own_vx, own_vy), (vx, vy) = velocity(own, xp), velocity(vehicle, xp)
    apart = xp.maximum(distance(x, y, xp), 1.0)
    return (x * (own_vy - vy) - y * (own_vx - vx)) / (apart * apart)
