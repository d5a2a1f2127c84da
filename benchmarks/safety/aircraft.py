"""Aircraft drawn at random, and the attack's requests scaled to them."""

from typing import Any

import numpy as np

from agents.planner.request import Options, Request
from agents.planner.traffic import Requirement
from agents.policy.inference import Policy
from envs.aircraft import PAPER, Aircraft, new_aircraft
from envs.kinematics import Limits, VehicleState

__all__ = ["policy_for", "random_aircraft", "random_options", "scaled"]


def random_aircraft(rng: np.random.Generator) -> Aircraft:
    """Return an aircraft of 25 to 240 m/s that flies 4 to 60 s for a separation, and turns in 0.3 to 2.5 of them."""
    fastest = float(25.0 * (240.0 / 25.0) ** rng.uniform())
    separation = fastest * float(4.0 * 15.0 ** rng.uniform())
    turn = fastest / (float(rng.uniform(0.3, 2.5)) * separation)
    push = fastest * fastest / separation * rng.uniform(0.02, 0.1, 2)
    slowest = float(rng.uniform(0.3, 0.7)) * fastest
    return new_aircraft(Limits(slowest, fastest, -1.5 * float(push[0]), float(push[1]), turn), separation)


def random_options(aircraft: Aircraft, rng: np.random.Generator) -> Options:
    """Return options of plans for an aircraft, with some requirement."""
    unit = aircraft.separation / PAPER.separation
    margin = float(rng.choice([0.0, 0.02, 0.1, 10.0, 50.0])) * unit
    return Options.for_aircraft(
        aircraft,
        requirement=Requirement(aircraft.separation, margin, float(rng.choice([0.0, 1.0, 2.0, 3.0]))),
        goals=1,
        extend_route=bool(rng.random() < 0.5),
        exhaustive=False,
    )


def policy_for(aircraft: Aircraft) -> Policy:
    """Return the policy that ships, for an aircraft that may be outside its family."""
    return Policy.load().for_aircraft(aircraft, outside="allow")


def scaled(request: Request, aircraft: Aircraft) -> Request:
    """Return requests for the paper's aircraft as another's: lengths in separations, speeds in its greatest speed."""
    length, pace = aircraft.separation / PAPER.separation, aircraft.limits.speed_max / PAPER.limits.speed_max
    own, traffic = request.own, request.traffic

    def state(one: VehicleState) -> VehicleState:
        return VehicleState(length * one.x, length * one.y, one.heading, pace * one.speed)

    moving: Any = state(own)
    moving = moving._replace(speed=np.clip(moving.speed, aircraft.limits.speed_min, aircraft.limits.speed_max))
    time = length / pace
    seen = traffic._replace(
        state=state(traffic.state),
        turn_rate=traffic.turn_rate / time,
        turn_time=traffic.turn_time * time,
        position_std=traffic.position_std * length,
        velocity_std=traffic.velocity_std * pace,
    )
    return request._replace(
        own=moving, traffic=seen, route_x=length * request.route_x, route_y=length * request.route_y
    )
