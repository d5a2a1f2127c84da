"""The same as in wrong_exchanges.py, done right: a type checker has nothing against it."""

from dataclasses import replace

import numpy as np

from agents.assurance import monitor as monitors
from agents.assurance.inputs import Inputs
from agents.assurance.state import Monitor
from agents.assurance.thresholds import Thresholds
from agents.kernel.areas import area_clearance
from agents.kernel.clearance import clearance
from agents.kernel.traffic import Requirement, Traffic
from agents.kernel.trajectory import Trajectory, straight, straight_on, trajectory
from agents.planner.judge.validator import validate
from agents.planner.planner import plan, plan_many
from agents.planner.publish.certificate import Evidence
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.reports import Intruder, arrays_of_reports, report_in_air
from agents.planner.request.request import Request, check_request, in_wind
from agents.policy.inference import Policy
from envs.follower import deviation
from envs.frames import Air, Ground
from envs.kinematics import SURROGATE, VehicleState, velocity
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
from envs.wind import NO_WIND, Wind, over_ground, through_air

ROUTE: list[RoutePoint] = []


def arguments(own: VehicleState[Ground], start: VehicleState[Air], policy: Policy, wind: Wind):
    plan(own, [own, Intruder(own)], ROUTE, policy, wind=wind)
    plan(over_ground(start, wind, 0.0), [], ROUTE, policy, wind=wind)
    arrays_of_reports([report_in_air(Intruder(own), wind)])
    plan_states(own, [])
    straight_cpa(through_air(own, wind, 0.0), start, np)
    _ = velocity(own, np), velocity(start, np)


def plans(ground: PlanStates[Ground], air: PlanStates[Air], traffic: Traffic, wind: Wind):
    on_ground(in_air(on_ground(air, wind), wind), wind)
    validate(air, traffic, Requirement(1e3), SURROGATE, curves=legs(air))
    trajectory(ground, legs(ground))
    bare: PlanStates[Ground] = PlanStates(0.0, 0.0, 0.0, 70.0, 0.0)
    in_air(bare, wind)
    in_air(ground._replace(time=0.0), wind)
    in_air(map_leaves(np.add, ground, ground), wind)
    in_air(take(ground, 0), wind)


def curves(air: PlanStates[Air], start: VehicleState[Air], own: VehicleState[Ground], wind: Wind):
    through_air(at(legs(air), 0.0, wind), wind, 0.0)
    at(repeat(legs(plan_states(own, [])), 2), np.zeros(2), wind)
    deviation(legs(air), start, np.zeros(1))
    over_ground(at(legs(air), 0.0), wind, 0.0)


def trajectories(own: VehicleState[Air], air: PlanStates[Air]) -> Trajectory[Air]:
    if own.x > 0.0:
        return straight_on(own, 60.0)
    flown: Trajectory[Air] = straight(np.zeros((1, 2)), np.zeros((1, 2)), np.ones((1, 2)))
    clearance(flown, area_clearance([], np.zeros(1), np.zeros(1), 0.0))
    return trajectory(air).since(np.zeros(1))


def returned(own: VehicleState[Ground], legs: Legs[Air], wind: Wind) -> VehicleState[Air]:
    if wind.speed == 0.0:
        return through_air(own, NO_WIND, 0.0)
    return at(legs, 0.0)


def limits(options: Options, own: VehicleState[Ground], policy: Policy, wind: Wind | None):
    in_air: Options[Narrowed] = in_wind(options, wind)
    plan(own, [], ROUTE, policy, replace(options, goals=1), wind=wind)
    check_request(own, [], ROUTE, replace(in_air, goals=1), None, wind)
    Evidence(own, [], [], [], None, options, wind)


def search(request: Request, policy: Policy):
    plan_many(request, policy, in_wind(Options.for_aircraft(policy.aircraft), None))


def watch(monitor: Monitor, given: Inputs, thresholds: Thresholds, wind: Wind):
    monitors.step(monitor, given, thresholds.in_wind(wind))


def bare_constructions(policy: Policy, wind: Wind):
    here: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 70.0)
    plan(here, [], ROUTE, policy)
    plan(VehicleState(0.0, 0.0, 0.0, 70.0), [], ROUTE, policy)  # said where it is handed on


def bare_requests(start: VehicleState[Air]):
    traffic = Traffic.straight(start)
    Request(start, traffic, np.zeros(1), np.zeros(1), np.ones(1))


def unpacking(own: VehicleState[Ground], start: VehicleState[Air], policy: Policy):
    here, there = own, start
    plan(here, [over_ground(there, NO_WIND, 0.0)], ROUTE, policy)
    copied: VehicleState[Ground] = VehicleState(*own)
    plan(copied, [], ROUTE, policy)


def replaced(own: VehicleState[Ground], policy: Policy):
    plan(own._replace(x=0.0), [replace(Intruder(own), age=1.0)], ROUTE, policy)


def leaves(own: VehicleState[Ground], policy: Policy):
    plan(map_leaves(float, own), [take(own, 0), column(own)], ROUTE, policy)
    plan(map_leaves(np.add, own, own), [], ROUTE, policy)
    plan(choose(np.ones(1, bool), own, own, np), [], ROUTE, policy)
