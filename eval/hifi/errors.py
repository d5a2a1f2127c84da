"""How far a flight was from its plan, and the plan from what the surrogate flew.

Path-definition error: the plan's legs against the surrogate's flight that its waypoints were taken
from. Flight-technical error: the aircraft against the legs. Total error: the aircraft against the
surrogate's flight. All are distances at the same time; beside them stand the usual errors across
the path, along it, and in time.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.planner.request.options import Narrowed, Options
from agents.planner.request.request import Request
from agents.planner.search.rollout import roll
from agents.policy.inference import Policy
from envs.follower import PERIOD, offset
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import Legs, at, repeat
from envs.wind import Wind, over_ground
from eval.flights.plan_flight import SUBSTEPS
from eval.hifi.flight import Flight

_SEARCH = 3  # steps towards the point abeam


class Errors(NamedTuple):
    """Errors of one flight; T periods, S whole seconds of the policy's own flight in the
    surrogate.
    """

    cross_track: np.ndarray  # distance from the path over the ground, m, left positive, [T + 1]
    # distance ahead of where the plan is at the time, along the path, m, [T + 1]
    along_track: np.ndarray
    late: np.ndarray  # how much later than planned the aircraft is at its place, s, [T + 1]
    # distance from where the plan is at the time, m, [T + 1]: the flight-technical error
    position: np.ndarray
    # path-definition error, m, [S]; empty where the plan is not the policy's
    definition: np.ndarray
    total: np.ndarray  # total error, m, [S]


def against(
    flight: Flight, legs: Legs[Air], wind: Wind, surrogate: VehicleState[Air] | None = None
) -> Errors:
    """Compare a flight from the plan's time 0 on with the plan's legs ``[L]``, in an air mass with
    this wind.

    The surrogate's flight there is second by second from time 0 on, ``[S]``; None: not known.
    """
    clock = PERIOD * np.arange(flight.altitude.size)
    own, planned = flight.own, _planned_state(legs, wind, clock)
    # Begun where the guidance was: a late aircraft on a winding path has several places abeam.
    abeam = clock - flight.late
    for _ in range(_SEARCH):
        place = _planned_state(legs, wind, abeam)
        abeam = abeam + offset(own, place)[0] / np.maximum(place.speed, 1.0)
    place = _planned_state(legs, wind, abeam)
    late = clock - abeam
    definition, total = np.zeros(0), np.zeros(0)
    if surrogate is not None:
        seconds = np.arange(surrogate.x.size)
        count = min(seconds.size, (clock.size - 1) // SUBSTEPS + 1)
        true = over_ground(take(surrogate, slice(count)), wind, seconds[:count] * 1.0)
        part = slice(None, count * SUBSTEPS, SUBSTEPS)
        definition = np.hypot(true.x - planned.x[part], true.y - planned.y[part])
        total = np.hypot(true.x - own.x[part], true.y - own.y[part])
    return Errors(
        cross_track=offset(own, place)[1],
        along_track=-late * 0.5 * (place.speed + planned.speed),
        late=late,
        position=np.hypot(own.x - planned.x, own.y - planned.y),
        definition=definition,
        total=total,
    )


def _planned_state(legs: Legs[Air], wind: Wind, time: np.ndarray) -> VehicleState[Ground]:
    """Return where a plan of legs ``[L]`` is over the ground at times, s, ``[T]``."""
    return at(repeat(legs, time.size), time, wind)


def roll_out(
    request: Request, goal: int, policy: Policy, options: Options[Narrowed]
) -> VehicleState[Air]:
    """Return the surrogate's flight to the route's point ``goal`` that the policy's plan ``[1]``
    was made from.

    It is second by second, ``[S]``, and ends where the planner took over.
    """
    flown = roll(request, np.array([goal]), policy, replace(options, spacing=1), floats=True)
    end, dt = float(flown.time[0]), options.aircraft.dt
    return VehicleState(
        *(field[0, : 1 if math.isnan(end) else round(end / dt) + 1] for field in flown.plan_states)
    )
