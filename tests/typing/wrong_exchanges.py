"""Exchanges of frames and of limits that a type checker must refuse, each marked; none is run."""

from dataclasses import replace

import numpy as np

from agents.assurance import monitor as monitors
from agents.assurance.inputs import Inputs
from agents.assurance.state import Monitor
from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Requirement, Traffic
from agents.kernel.trajectory import Trajectory, straight_on, trajectory
from agents.planner.judge.validator import validate
from agents.planner.planner import plan, plan_many
from agents.planner.publish.certificate import Evidence
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.reports import Intruder, arrays_of_reports
from agents.planner.request.request import Request, check_request, in_wind
from agents.policy.inference import Policy
from envs.follower import deviation
from envs.frames import Air, Ground
from envs.kinematics import SURROGATE, VehicleState
from envs.relative import straight_cpa
from envs.trees import choose, column, map_leaves, take
from envs.waypoints import (
    Legs,
    PlanStates,
    RoutePoint,
    at,
    in_air,
    legs,
    on_ground,
    plan_states,
    repeat,
)
from envs.wind import Wind, over_ground, through_air

ROUTE: list[RoutePoint] = []


def arguments(own: VehicleState[Ground], start: VehicleState[Air], policy: Policy, wind: Wind):
    plan(start, [], ROUTE, policy)  # error
    plan(own, [start], ROUTE, policy)  # error
    plan(own, [Intruder(start)], ROUTE, policy)  # error
    arrays_of_reports([Intruder(own)])  # error
    plan_states(start, [])  # error
    through_air(start, wind, 0.0)  # error
    over_ground(own, wind, 0.0)  # error
    over_ground(over_ground(start, wind, 0.0), wind, 0.0)  # error
    straight_cpa(own, start, np)  # error


def plans(ground: PlanStates[Ground], air: PlanStates[Air], traffic: Traffic, wind: Wind):
    in_air(air, wind)  # error
    on_ground(ground, wind)  # error
    validate(ground, traffic, Requirement(1e3), SURROGATE)  # error
    validate(air, traffic, Requirement(1e3), SURROGATE, curves=legs(ground))  # error
    trajectory(ground, legs(air))  # error
    bare, copied = PlanStates(0.0, 0.0, 0.0, 70.0, 0.0), PlanStates(*air)
    in_air(bare, wind)  # error
    in_air(copied, wind)  # error
    in_air(air._replace(time=0.0), wind)  # error
    in_air(map_leaves(np.add, ground, air), wind)  # error
    in_air(take(air, 0), wind)  # error


def curves(ground: PlanStates[Ground], start: VehicleState[Air], own: VehicleState[Ground]):
    at(legs(ground), 0.0, Wind())  # error
    at(repeat(legs(ground), 2), np.zeros(2), Wind())  # error
    deviation(legs(ground), start, np.zeros(1))  # error
    deviation(legs(plan_states(own, [])), own, np.zeros(1))  # error
    over_ground(at(legs(ground), 0.0), Wind(), 0.0)  # error


def trajectories(own: VehicleState[Ground], air: PlanStates[Air]) -> Trajectory[Air]:
    if own.x > 0.0:
        return straight_on(own, 60.0)  # error
    flown: Trajectory[Ground] = trajectory(air)  # error
    return flown.since(np.zeros(1))  # error


def returned(own: VehicleState[Ground], legs: Legs[Air], wind: Wind) -> VehicleState[Air]:
    if wind.speed == 0.0:
        return own  # error
    return at(legs, 0.0, wind)  # error


def limits(options: Options, in_air: Options[Narrowed], own: VehicleState[Ground], policy: Policy):
    plan(own, [], ROUTE, policy, in_air)  # error
    plan(own, [], ROUTE, policy, replace(in_air, goals=1))  # error
    in_wind(in_air, None)  # error
    check_request(own, [], ROUTE, options)  # error
    Evidence(own, [], [], [], None, in_air)  # error


def search(request: Request, policy: Policy, options: Options):
    plan_many(request, policy, options)  # error


def watch(monitor: Monitor, given: Inputs, thresholds: Thresholds, wind: Wind):
    monitors.step(monitor, given, thresholds)  # error
    thresholds.in_wind(wind).in_wind(wind)  # error


def bare_constructions(policy: Policy, wind: Wind):
    here = VehicleState(0.0, 0.0, 0.0, 70.0)
    plan(here, [], ROUTE, policy)  # error
    through_air(here, wind, 0.0)  # error
    over_ground(here, wind, 0.0)  # error


def bare_requests(own: VehicleState[Ground], traffic: Traffic):
    Request(own, traffic, np.zeros(1), np.zeros(1), np.ones(1))  # error
    Traffic.straight(own)  # error


def unpacking(own: VehicleState[Ground], start: VehicleState[Air], policy: Policy):
    here, there = start, own
    plan(here, [], ROUTE, policy)  # error
    over_ground(there, Wind(), 0.0)  # error
    copied = VehicleState(*start)
    plan(copied, [], ROUTE, policy)  # error


def replaced(own: VehicleState[Ground], start: VehicleState[Air], policy: Policy):
    plan(start._replace(x=0.0), [], ROUTE, policy)  # error
    plan(own, [replace(Intruder(start), age=1.0)], ROUTE, policy)  # error


def leaves(own: VehicleState[Ground], start: VehicleState[Air], policy: Policy):
    plan(map_leaves(float, start), [], ROUTE, policy)  # error
    plan(map_leaves(np.add, own, start), [], ROUTE, policy)  # error
    plan(take(start, 0), [], ROUTE, policy)  # error
    plan(column(start), [], ROUTE, policy)  # error
    plan(choose(np.ones(1, bool), own, start, np), [], ROUTE, policy)  # error
