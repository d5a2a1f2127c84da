"""The assured loop: a plan, a monitor that watches it every second, new plans, and a backup at
hand.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents import assurance
from agents.assurance.areas import may_be_met
from agents.assurance.asking import ALONG, Planner, renew
from agents.assurance.monitor import Decision, Thresholds
from agents.assurance.state import Monitor
from agents.assurance.tracker import Tracks, follow
from agents.planner.candidates import Proposals
from agents.planner.planner import Plans, plan_among, plan_many
from agents.planner.request import Options, Request, drift_points
from agents.planner.traffic import Traffic
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.kinematics import VehicleState
from envs.trees import take
from envs.wind import Wind
from envs.world import State, begin, perceive_intruders
from eval.flights.among_areas import in_air_at
from eval.flights.in_wind import drift_of
from eval.flights.plan_flight import (
    SUBSTEPS,
    Air,
    PlanFlights,
    Tally,
    fly_step,
    request_of,
    route_of,
)
from eval.flights.trajectories import TrajectoryRecorder

_GOAL = 1  # number of the goal among the route's points


class Assured(NamedTuple):
    """How encounters went; fields ``[N]``."""

    flown: PlanFlights
    replans: np.ndarray  # new plans asked for, int32
    backup: np.ndarray  # time on the backup, s


def fly_assured(  # noqa: PLR0913 - all that a flight needs
    encounters: Encounter,
    plans: Plans,
    policy: Policy,
    aircraft: Aircraft,
    options: Options,
    *,
    noise: Callable[[int], np.ndarray] | None = None,
    recorder: TrajectoryRecorder | None = None,
    endless: bool = False,
    wind: Wind | None = None,
    areas: Any = None,
) -> Assured:
    """Fly encounters ``[N]``, float64, planned at their start, with the monitor until the time
    limit or a violation.

    With noise of the sensors by step, ``[4, N, K]``, monitor and planner see tracks of such
    reports. The limits of the options are those of the vehicle. A recorder takes the trajectories;
    endless flights lose nothing. In a wind all of it is in its air mass, through which goals and
    routes drift. Areas are over the ground, object ``[N]``; None: none.
    """
    count, dt = len(encounters.goal_x), aircraft.dt
    thresholds = Thresholds.for_plans(options)
    asked = request_of(encounters, aircraft)._replace(drift=drift_of(wind))
    tally = Tally(count, aircraft, endless=endless)
    replans, backup = np.zeros(count, np.int32), np.zeros(count, np.int32)
    rows, reached = np.arange(count), np.zeros(count, dtype=bool)
    ends = np.full(count, aircraft.t_max)
    air = Air(begin(encounters, np, history_dt=dt), np.zeros(count), ends, asked.drift)
    first = Traffic.straight(
        perceive_intruders(air.state, None if noise is None else noise(0), dt, np), encounters.mask
    )._replace(separation=encounters.separation)
    monitor = assurance.start(count, encounters.mask.shape[1], thresholds)
    made = plans.proposals
    monitor = assurance.activate(monitor, rows, made.plan_states, made.safe, 0.0, first, thresholds)
    tracks: Tracks | None = None
    # Whether what is flown passes over the goal, or gets there too late.
    short = made.goal > _GOAL
    for number in range(tally.steps):
        time, state, known = number * dt, air.state, dict[str, Any]()
        seen = perceive_intruders(state, None if noise is None else noise(number)[:, rows], dt, np)
        if noise is not None:
            tracks = follow(tracks, seen, state.sensor.position_std, state.sensor.velocity_std, dt)
            seen, known = tracks.state, tracks.errors
        amid = None if areas is None else in_air_at(areas[rows], take(wind, rows), time)
        if amid is not None:
            known["areas"] = _areas_met(amid, state, monitor, time, thresholds)
        known["separation"] = state.separation
        given = assurance.inputs(time, state.own, seen, state.mask, **known)
        monitor, decision = assurance.step(monitor, given, thresholds)
        make = _planner((asked, amid), decision, state, time, aircraft, policy)
        left = aircraft.t_max - time
        monitor, short[rows], new = renew(
            monitor, decision, short[rows], reached[rows], left, make, thresholds
        )
        replans[rows] += new
        backup[rows] += monitor.on_backup
        references = assurance.references(monitor, time, PERIOD * dt, SUBSTEPS)
        air, flown = fly_step(air, references, aircraft, options.limits)
        tally.add(rows, flown, number + 1)
        reached[rows] |= ~np.isnan(flown.reached)
        if recorder is not None:
            recorder.append(rows, air.state.own, air.state.intruders.vehicle, flown.separation)
        on = flown.separation >= (0.0 if endless else aircraft.separation)
        if not on.all():
            rows, air, monitor, asked, tracks = take((rows, air, monitor, asked, tracks), on)
        if rows.size == 0:
            break
    return Assured(tally.judge(), replans, backup * dt)


def _areas_met(
    areas: Any, state: State, monitor: Monitor, time: float, thresholds: Thresholds
) -> Any:
    """Return the areas that flights ``[M]`` may meet, of those in their air masses now, object
    ``[M]``.
    """
    found = np.empty(len(areas), dtype=object)
    for n, some in enumerate(areas):
        own = VehicleState(*(float(field[n]) for field in state.own))
        ends = float(monitor.plan.plan_states.time[n, -1] + monitor.started[n]) - time
        found[n] = may_be_met(some, own, None, ends, thresholds)
    return found


def _planner(
    around: tuple[Request, Any],
    decision: Decision,
    state: State,
    time: float,
    aircraft: Aircraft,
    policy: Policy,
) -> Planner:
    """Return what plans from the middle of flights, at a time, s: to the goal from where they are,
    or along the route; ``around``: the requests at the start, and the areas now or None.
    """
    asked, areas = around

    def plans(rows: Any, options: Options, kind: int) -> Proposals:
        own, traffic = take((decision.own, decision.traffic), rows)
        route = take(asked, rows)
        drift = route.drift
        if kind == ALONG:
            x, y = drift_points((route.route_x, route.route_y), drift, time)
            request = route._replace(own=own, traffic=traffic, route_x=x, route_y=y)
        else:
            goal = drift_points((state.goal_x[rows], state.goal_y[rows]), drift, time)
            request = Request(own, traffic, *route_of(own, *goal, aircraft), drift)
        if areas is None:
            return plan_many(request, policy, options, floats=True).proposals
        return plan_among(request, areas[rows], policy, options, floats=True).proposals

    return plans
