"""What resolvers believe of traffic that is not always reported: the tracker between perception and
decision, in evaluations.

An intruder that was reported is carried on along its course or its turn for some time after its
last report, and is gone then. Where nobody is believed to be there, a policy steers to the goal:
its network, trained for traffic, would turn to and fro within half a degree.
"""

import numpy as np

from agents.baselines.baselines import Observation, course_to_goal, steer
from agents.kernel.traffic import Traffic, predict
from envs.aircraft import Aircraft
from envs.frames import Air
from envs.perception import Sensor, declared_errors
from envs.tracking.tracker import TURN_STEPS, Reports, Sightings, belief, lasting, observe
from envs.trees import map_leaves

CARRIED = 60.0
"""Time steps without a report, after which an intruder is gone. With 30 the policy loses 0.4 % more
of the encounters of ``circle + partly_seen``, because it turns back into the way of those that it
has turned its view from."""


def carry_on(
    observation: Observation,
    mask: np.ndarray,
    sightings: Sightings[Air] | None,
    sensor: Sensor | None,
    time: float,
    aircraft: Aircraft,
) -> tuple[Observation, Sightings[Air]]:
    """Return what is believed at a time, s, and what the tracker knows then.

    Args:
        observation: its mask has the intruders that are reported; these stay as they are.
        mask: which intruders exist, bool ``[M, K]``.
        sightings: what the tracker knew a time step ago; None: nothing yet.
        sensor: of the reports; None: they are exact.
        time: s after the start.
        aircraft: the ownship.
    """
    sightings = observe(
        sightings, Reports(observation.intruders, *declared_errors(sensor)), time, observation.mask
    )
    age = time - sightings.time
    carried = mask & ~observation.mask & is_carried(sightings, time, aircraft)
    if not carried.any():
        return observation, sightings
    believed, longest = belief(sightings.tracks), TURN_STEPS * aircraft.dt
    turn_rate = believed.turn_rate
    flown = Traffic.straight(believed.state, carried)._replace(
        turn_rate=turn_rate, turn_time=lasting(turn_rate, believed.turn_std, longest)
    )
    carried_on = predict(flown, np.where(carried, age, 0.0))
    intruders = map_leaves(
        lambda predicted, reported: np.where(carried, predicted, reported),
        carried_on,
        observation.intruders,
    )
    return observation._replace(intruders=intruders, mask=observation.mask | carried), sightings


def is_carried(sightings: Sightings[Air], time: float, aircraft: Aircraft) -> np.ndarray:
    """Return who was reported so lately at a time, s, that it is believed to be there, bool
    ``[M, K]``.
    """
    return np.asarray(time - sightings.time <= CARRIED * aircraft.dt)


def steer_alone(action: np.ndarray, observation: Observation, aircraft: Aircraft) -> np.ndarray:
    """Return a policy's actions ``[M, 2]``, of which those with nobody in observation steer to the
    goal.
    """
    without_traffic = ~observation.mask.any(axis=-1)
    if not without_traffic.any():
        return action
    steering = steer(observation.own, course_to_goal(observation, aircraft), aircraft)
    return np.stack([action[:, 0], np.where(without_traffic, steering, action[:, 1])], axis=-1)
