"""The plan flown once, as in the paper: planned at the start, followed to its end."""

import numpy as np

from agents.planner.planner import Plans, plan_among, plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.options import Options
from agents.planner.request.request import in_wind
from agents.planner.search.in_space import plan_each_in_space
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.altitudes import as_reported
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.frames import Air
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.profile import Height
from envs.trees import take
from envs.waypoints import at, legs
from envs.wind import Wind
from envs.world import begin, known_intruders, perceive_intruders
from eval.flights.among_areas import in_air_at
from eval.flights.in_space import (
    climbers,
    find_met_holding,
    heights_at,
    own_altitudes,
    reports,
    who_counts,
)
from eval.flights.in_wind import drift_of
from eval.flights.plan_flight import SUBSTEPS, Active, PlanFlights, Tally, fly_step
from eval.flights.trajectories import TrajectoryRecorder

SOURCES = ("none", "policy", "fallback", "vertical")  # names of a plan's sources by their codes
STATUSES = ("unresolved", "safe")  # names of a plan's statuses by whether it is safe


def perceive_at_start(
    encounters: Encounter, dt: float, noise: np.ndarray | None = None
) -> VehicleState[Air]:
    """Return the intruders as known at the start, ``[N, K]``, by the sensors' noise ``[4, N, K]``;
    dt in s.
    """
    return perceive_intruders(begin(encounters, np, history_dt=dt), noise, dt, np)


def known_at_start(encounters: Encounter, aircraft: Aircraft) -> Encounter:
    """Return encounters ``[N]`` with the intruders alone that are reported at the start."""
    if encounters.coverage is None:
        return encounters
    state = begin(encounters, np, history_dt=aircraft.dt)
    return encounters._replace(mask=known_intruders(state, aircraft, np))


def plan_at_start(
    encounters: Encounter,
    policy: Policy,
    aircraft: Aircraft,
    options: Options,
    noise: np.ndarray | None = None,
    *,
    wind: Wind | None = None,
    areas: np.ndarray | None = None,
) -> Plans:
    """Plan at the start of encounters ``[N]``, in a wind in its air mass, among areas over the
    ground, object ``[N]``; noise as of :func:`perceive_at_start`. Encounters in space have no
    areas; plans that do not climb leave out who stays above or below.
    """
    encounters = known_at_start(encounters, aircraft)
    intruders = perceive_at_start(encounters, aircraft.dt, noise)
    request = request_of(encounters, aircraft, intruders)._replace(drift=drift_of(wind))
    in_air = in_wind(options, None)  # the wind is known exactly, and takes nothing off the limits
    if encounters.altitudes is not None:
        level = encounters.altitudes.own
        own = own_altitudes(Height(level, np.zeros_like(level)))
        altitudes = reports(encounters.altitudes, 0, aircraft.dt)
        if options.climbs:
            return plan_each_in_space(request, climbers(own, level, altitudes), policy, in_air)
        window = find_met_holding(own, altitudes, options).all_times
        request = request._replace(traffic=who_counts(request.traffic, window))
    if areas is None:
        return plan_many(request, policy, in_air)
    return plan_among(request, in_air_at(areas, wind, 0.0), policy, in_air)


def fly_once(
    encounters: Encounter,
    plans: Plans,
    aircraft: Aircraft,
    options: Options,
    recorder: TrajectoryRecorder | None = None,
    *,
    endless: bool = False,
    wind: Wind | None = None,
) -> PlanFlights:
    """Fly the plans of encounters, ``[N]`` both, float64, once, to their ends; recorded until the
    time limit. In a wind all of it is in its air mass, through which the goals drift.

    An encounter counts as reached if the goal was by the time limit and the separation kept until
    then (in endless flights it need not be). An unresolved plan is flown as an advisory trajectory,
    but is no success even if it arrives. Without a trajectory there is no flight, and the
    separation is not a number.
    """
    tally, dt, count = Tally(len(encounters.goal_x), aircraft, endless=endless), aircraft.dt, 0
    rows = np.flatnonzero(plans.candidates.last >= 0)
    begun, plan_states = take((encounters, plans.candidates.plan_states), rows)
    drift, curves = take(drift_of(wind), rows), legs(plan_states)
    air = Active(begin(begun, np), np.zeros(rows.size), plan_states.time[:, -1], drift)
    profiles = take(plans.candidates.profile, rows)
    while rows.size:
        periods = (count + np.arange(SUBSTEPS + 1)[:, None] * PERIOD) * dt
        altitudes = None
        if profiles is not None:
            change = options.vertical.acceleration
            altitudes = heights_at(profiles, periods[:, 0], change).altitude
        references: VehicleState[Air] = at(curves, periods)
        air, flown = fly_step(air, references, aircraft, options.limits, altitudes)
        count += 1
        tally.add(rows, flown, count)
        if recorder is not None and count <= tally.steps:
            reached = None if altitudes is None else altitudes[-1]
            state = air.state
            recorder.append(
                rows, state.own, state.intruders.vehicle, flown.separation, own_altitude=reached
            )
        on = air.ends > count * dt
        if not on.all():
            rows, air, curves, profiles = take((rows, air, curves, profiles), on)
    whole = tally.judge(plans.candidates.safe)
    for separation in (whole.flights.min_separation, whole.whole_separation):
        separation[plans.candidates.last < 0] = np.nan
    return whole


def promised_separation(
    encounters: Encounter,
    plans: Plans,
    aircraft: Aircraft,
    options: Options,
    lost: np.ndarray,
    noise: np.ndarray | None = None,
) -> np.ndarray:
    """Return how near the flights of lost plans would have come to the intruders as reported, m.

    What SAFE promises is a separation from intruders that go on straight, and climb evenly, from
    the report that the plan was made with. Where that one is kept and the separation was lost all
    the same, an intruder left its reported motion (or its report was wrong), which no plan promises
    to survive.

    Args:
        lost: which plans are meant, bool ``[N]``; nan for the others.
        noise: as of :func:`perceive_at_start`.
    """
    result = np.full(lost.size, np.nan)
    rows = np.flatnonzero(lost)
    if rows.size:
        intruders = take(perceive_at_start(encounters, aircraft.dt, noise), rows)
        straight = Intent(*(np.zeros(intruders.x.shape) for _ in Intent._fields))
        reported = take(known_at_start(encounters, aircraft), rows)
        reported = reported._replace(intruders=intruders, intent=straight)
        if reported.altitudes is not None:
            altitudes = as_reported(reported.altitudes)
            evenly = altitudes._replace(intruders=altitudes.intruders[..., :2])
            reported = reported._replace(altitudes=evenly)
        flown = fly_once(reported, take(plans, rows), aircraft, options)
        result[rows] = flown.flights.min_separation
    return result
