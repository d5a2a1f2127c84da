"""A flight by its number: encounter, conditions, plan, flight and outcome; what it yields depends
on nothing else.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.climbs import Climb, Met, times_met
from agents.assurance.inputs import no_areas
from agents.assurance.thresholds import Thresholds
from agents.kernel.levels import Altitude, steady
from agents.kernel.traffic import Traffic as Known
from agents.kernel.traffic import Window
from agents.planner.request.encounters import request_of
from agents.planner.request.options import Options
from agents.planner.request.reports import Intruder
from agents.planner.search.candidates import empty
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.altitudes import REFERENCE
from envs.areas import Area
from envs.c208.flightgear import FlightGear
from envs.c208.guidance import Path as Track
from envs.c208.vehicle import FlightError, StartError
from envs.encounters import Encounter
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.trees import take
from envs.waypoints import Legs, legs
from envs.wind import Wind, over_ground, through_air
from envs.world import distance_scales
from eval.flights import sources
from eval.flights.among_areas import areas_of
from eval.flights.in_space import of_altitude
from eval.flights.plan_mode import SOURCES, perceive_at_start
from eval.flights.simulate import sensor_noise
from eval.flights.sources import Source
from eval.hifi.config import (
    ConditionConfig,
    Drawn,
    LevelRanges,
    draw_conditions,
    draw_heights,
)
from eval.hifi.errors import Errors, against, roll_out
from eval.hifi.flight import Flight, Levels, Pilot, Traffic, fly
from eval.hifi.pilots import Ascent, Assured, Closed, Follower, Reckoning
from eval.hifi.vehicle import Navigation, begin, lookahead_of, reach_of, takeoff_weight
from eval.hifi.wind import PlanResult, Route, options_in, plan_for, plan_in_space, unflyable


class Campaign(NamedTuple):
    """All that the flights of a run follow from; can be sent to another process."""

    policy: Path | None  # file of the policy; None for the shipped one
    source: Source
    seed: int
    aircraft: Aircraft  # that decisions and plans are made for; its time step is 1 s
    mode: str  # plan, closed or assured
    options: Options
    vehicle: str  # that flies, a key of eval.hifi.vehicle.VARIANT_OF
    condition: ConditionConfig  # from which each flight's conditions are drawn
    viewer: FlightGear | None = None  # of vehicles in JSBSim
    areas: int = 0  # of an encounter at most
    # of the intruders, where plans may climb
    levels: LevelRanges = LevelRanges((0.0, 0.0), (0.0, 0.0))


class Beginning(NamedTuple):
    """Where a flight begins."""

    encounter: Encounter  # [1], in the air mass
    drawn: Drawn
    wind: Wind  # that blows
    frame: Wind  # that the planner knows
    own: VehicleState[Ground]  # plain floats
    route: Route  # over the ground; the second point is the goal
    noise: Callable[[int], np.ndarray] | None  # of the intruders' reports by second, [4, 1, K]
    areas: tuple[Area, ...] = ()  # over the ground, as they are at the start
    # at which the distance to each intruder counts, [1, K]
    distance_scale: np.ndarray | None = None
    levels: Levels | None = None  # of the intruders; None: all are at the ownship's


class FlightRecord(NamedTuple):
    """A flight and all that is known of it."""

    scene: Beginning
    initial: PlanResult | None = None  # the plan; None in mode closed
    legs: Legs[Air] | None = None  # of the plan, in the air mass; None without one
    flight: Flight | None = None  # None where it could not begin
    errors: Errors | None = None  # against the plan, in mode plan
    problem: str | None = None  # why it could not begin
    pilot: Pilot | None = None


def prepare(campaign: Campaign, policy: Policy) -> tuple[Campaign, Policy]:
    """Return a campaign and its policy for the campaign's aircraft: what :func:`fly_one` takes."""
    return campaign, policy.for_aircraft(campaign.aircraft, outside="allow")


def scene_of(campaign: Campaign, number: int) -> Beginning:
    """Return where flight ``number`` begins.

    The encounter is drawn in the air mass, where speeds are air speeds; the wind carries them all,
    and the goal lies where the ownship would arrive if it flew straight on. So the same number is
    the same conflict in any wind.
    """
    condition = campaign.condition
    encounter, _ = sources.draw(campaign.source, campaign.seed, number, 1, heeds=("separation",))
    met = draw_conditions(condition, campaign.seed, number, takeoff_weight(campaign.vehicle))
    wind = Wind(met.air.wind_east, met.air.wind_north)
    if condition.position_std > 0.0 or condition.velocity_std > 0.0 or met.latency > 0.0:
        flaws = (condition.position_std, condition.velocity_std, met.latency)
        encounter = encounter._replace(sensor=Sensor(*(np.full((1, 1), flaw) for flaw in flaws)))
    flawed = any(np.any(field) for field in encounter.sensor)
    noise = sensor_noise(campaign.seed, number, *encounter.mask.shape) if flawed else None
    own: VehicleState[Air] = VehicleState(*(float(field[0]) for field in encounter.own))
    away = (
        math.hypot(float(encounter.goal_x[0]) - own.x, float(encounter.goal_y[0]) - own.y)
        / own.speed
    )
    over = encounter._replace(
        goal_x=encounter.goal_x + wind.east * away,
        goal_y=encounter.goal_y + wind.north * away,
    )
    line = request_of(over, campaign.aircraft)
    areas = areas_of(campaign.areas, campaign.seed, over, np.array([number]), campaign.aircraft)
    return Beginning(
        encounter=encounter,
        drawn=met,
        wind=wind,
        frame=met.believed_wind,
        own=over_ground(own, wind, 0.0),
        route=Route(line.route_x[0], line.route_y[0]),
        noise=noise,
        areas=() if areas is None else areas[0],
        distance_scale=distance_scales(encounter, campaign.aircraft, np),
        levels=_levels(campaign, encounter, met.altitude, number),
    )


def _levels(
    campaign: Campaign, encounter: Encounter, altitude: float, number: int
) -> Levels | None:
    """Return the levels of the intruders of an encounter ``[1]``; None where plans stay at one."""
    if not campaign.options.climbs:
        return None
    start = draw_heights(encounter, campaign.levels, altitude, campaign.seed, number)
    separation = encounter.separation
    if separation is None:
        separation = np.full(encounter.mask.shape, campaign.aircraft.separation)
    return Levels(start, separation / campaign.options.vertical.separation)


def fly_one(campaign: Campaign, policy: Policy, number: int) -> FlightRecord:
    """Fly one flight."""
    scene = scene_of(campaign, number)
    if campaign.mode == "closed":
        return _fly_closed(campaign, scene, number, policy)
    initial, traffic = _initial_plan(campaign, scene, policy)
    curves, problem = None, initial.problem
    if problem is None and int(initial.plans.candidates.last[0]) >= 0:
        curves = legs(take(initial.plans.candidates.plan_states, 0))
        reach = reach_of(campaign.vehicle, campaign.aircraft.limits, scene.drawn)
        problem = unflyable(curves, reach)
    elif problem is None and campaign.mode == "plan":
        problem = "the planner knows no way back to the route"
    record = FlightRecord(scene, initial, curves, problem=problem)
    if problem is not None:
        return record
    if campaign.mode == "assured":
        pilot = _assured_pilot(campaign, scene, initial, traffic, policy)
        until = round(campaign.aircraft.t_max)
        flight, problem = _fly(campaign, scene, number, pilot, until, ("violation",))
        return record._replace(flight=flight, problem=problem, pilot=pilot)
    assert curves is not None
    return _follow(campaign, record, curves, number, policy)


def _fly_closed(campaign: Campaign, scene: Beginning, number: int, policy: Policy) -> FlightRecord:
    """Fly by the policy's decisions, once a second."""
    goal = float(scene.route.x[1]), float(scene.route.y[1])
    limits, mask = campaign.aircraft.limits, scene.encounter.mask
    pilot = Closed(policy, limits, goal, mask, scene.frame, scene.areas, scene.distance_scale)
    until = round(campaign.aircraft.t_max)
    flight, problem = _fly(campaign, scene, number, pilot, until, ("violation", "goal"))
    return FlightRecord(scene, flight=flight, problem=problem, pilot=pilot)


def _follow(
    campaign: Campaign, record: FlightRecord, curves: Legs[Air], number: int, policy: Policy
) -> FlightRecord:
    """Return a record with the flight along its plan to the end, and the errors against it."""
    scene, initial = record.scene, record.initial
    assert initial is not None
    ascent = None
    if initial.profile is not None:
        ascent = Ascent(initial.profile, campaign.options.vertical.acceleration)
    pilot = Follower(Track(curves, scene.frame), lookahead_of(campaign.vehicle), ascent)
    until = math.ceil(float(curves.time[-1] + curves.duration[-1]))
    flight, problem = _fly(campaign, scene, number, pilot, until, ())
    record = record._replace(flight=flight, problem=problem, pilot=pilot)
    if flight is None or flight.failure is not None:
        return record
    surrogate = None
    if initial.request is not None and initial.plans.source[0] == SOURCES.index("policy"):
        goal = int(initial.plans.candidates.goal[0])
        options = options_in(scene.frame, campaign.options)
        surrogate = roll_out(initial.request, goal, policy, options)
    return record._replace(errors=against(flight, curves, scene.frame, surrogate))


def report_at_start(campaign: Campaign, scene: Beginning) -> VehicleState[Ground]:
    """Return the intruders as reported at the start, ``[1, K]``."""
    noise = None if scene.noise is None else scene.noise(0)
    intruders = perceive_at_start(scene.encounter, campaign.aircraft.dt, noise)
    return over_ground(intruders, scene.wind, 0.0)


def _initial_plan(campaign: Campaign, scene: Beginning, policy: Policy) -> tuple[PlanResult, Known]:
    """Return the plan made at the start, and the intruders that it was made with."""
    reported = report_at_start(campaign, scene)
    traffic = Known.straight(through_air(reported, scene.frame, 0.0), scene.encounter.mask)
    traffic = traffic._replace(separation=scene.encounter.separation)
    if scene.levels is not None:
        intruders = _reports(scene, reported, scene.levels)
        fields = scene.route, scene.drawn.altitude, scene.frame, policy, campaign.options
        return plan_in_space(scene.own, intruders, *fields, scene.areas), traffic
    own = through_air(scene.own, scene.frame, 0.0)
    initial = plan_for(
        own, traffic, scene.route, 0.0, scene.frame, policy, campaign.options, scene.areas
    )
    return initial, traffic


def _reports(
    scene: Beginning, reported: VehicleState[Ground], levels: Levels
) -> list[Intruder[Ground]]:
    """Return the intruders as reported at the start, ``[1, K]``, with their altitudes and vertical
    speeds.
    """
    separation, altitudes = scene.encounter.separation, levels.reports(0.0)
    return [
        Intruder(
            VehicleState(*(float(field[0, k]) for field in reported)),
            altitude=altitudes[k],
            separation=None if separation is None else float(separation[0, k]),
        )
        for k in np.flatnonzero(scene.encounter.mask[0])
    ]


def _assured_pilot(
    campaign: Campaign, scene: Beginning, initial: PlanResult, traffic: Known, policy: Policy
) -> Assured:
    """Return what flies a plan under the monitor, made with the known intruders."""
    options, plans = campaign.options, initial.plans
    if int(plans.candidates.last[0]) < 0:
        plans = plans._replace(candidates=empty(1, options.waypoints))
        initial = initial._replace(plans=plans, profile=None)
    if scene.levels is not None:
        traffic = traffic._replace(window=_first_window(scene, scene.levels, initial, options))
    sensor = None if scene.noise is None else scene.encounter.sensor
    gains = lookahead_of(campaign.vehicle)
    reckoning = Reckoning(scene.frame, scene.drawn.altitude, gains, sensor)
    return Assured(
        initial,
        traffic,
        scene.route,
        policy,
        campaign.aircraft.rules(),
        Thresholds.for_plans(options).in_wind(scene.frame),
        reckoning,
        scene.areas,
    )


def _first_window(
    scene: Beginning, levels: Levels, initial: PlanResult, options: Options
) -> Window:
    """Return from the first to the last time in which each intruder counts on the altitudes of a
    plan made at the start, ``[1, K]``.
    """
    own = Altitude(scene.drawn.altitude, REFERENCE, 0.0)
    flight = steady(own)
    if initial.profile is not None:
        flight = Climb(initial.profile, REFERENCE).flight(own, 0.0, options)
    reports = [of_altitude(altitude) for altitude in levels.reports(0.0)]
    return Met(times_met(reports, flight, options), no_areas(1)).all_times


def _fly(
    campaign: Campaign,
    scene: Beginning,
    number: int,
    pilot: Pilot,
    until: int,
    ends: tuple[str, ...],
) -> tuple[Flight | None, str | None]:
    """Fly with a pilot; return the flight, or why it could not begin."""
    try:
        vehicle: Any = begin(
            campaign.vehicle, scene.own, scene.drawn, campaign.options.limits, campaign.viewer
        )
    except StartError as problem:
        return None, str(problem)
    except FlightError as problem:
        return None, f"the aircraft is lost before the start: {problem}"
    navigation = Navigation(campaign.condition.own_position_std, campaign.seed, number)
    goal = float(scene.route.x[1]), float(scene.route.y[1])
    watch = None if campaign.viewer is None else vehicle.show
    traffic = Traffic(
        scene.encounter, scene.wind, scene.noise, watch, scene.distance_scale, scene.levels
    )
    return fly(
        vehicle, pilot, navigation, traffic, goal, campaign.aircraft.rules(), until, ends
    ), None
