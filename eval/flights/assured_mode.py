"""The assured loop: a plan, a monitor that watches it every second, new plans, and a backup at
hand.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents import assurance
from agents.assurance.areas import may_be_met
from agents.assurance.asking import ALONG, Planner, renew
from agents.assurance.inputs import believed
from agents.assurance.monitor import Decision, Thresholds
from agents.assurance.state import Monitor
from agents.kernel.traffic import Traffic
from agents.planner.planner import Plans, plan_among, plan_many
from agents.planner.request.encounters import request_of, route_of
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.request import Request, drift_points
from agents.planner.search.candidates import Candidates
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.perception import declared_errors
from envs.tracking.tracker import Reports, Sightings, observe
from envs.trees import take
from envs.wind import NO_WIND, Wind
from envs.world import State, begin, perceive_intruders
from eval.flights.among_areas import in_air_at
from eval.flights.in_wind import drift_of
from eval.flights.plan_flight import SUBSTEPS, Active, PlanFlights, Step, Tally, fly_step
from eval.flights.trajectories import TrajectoryRecorder

_GOAL = 1  # number of the goal among the route's points


class Assured(NamedTuple):
    """How encounters went; fields ``[N]``."""

    flown: PlanFlights
    replans: np.ndarray  # new plans asked for, int32
    backup: np.ndarray  # time on the backup, s


class _Flights(NamedTuple):
    """Flights in progress; fields ``[M]``."""

    rows: np.ndarray  # number of each among the encounters
    air: Active
    asked: Request  # of the planner at the start
    monitor: Monitor
    sightings: Sightings[Air] | None  # of the intruders; None: there was none yet
    short: np.ndarray  # whether what is flown passes over the goal, or gets there too late
    reached: np.ndarray  # whether the goal was reached


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
    areas: np.ndarray | None = None,
) -> Assured:
    """Fly encounters ``[N]``, float64, planned at their start, with the monitor until the time
    limit or a violation.

    Monitor and planner see what the tracker makes of the reports, with the noise of the sensors by
    step, ``[4, N, K]``. The limits of the options are those of the vehicle. A recorder takes the
    trajectories; endless flights lose nothing. In a wind all of it is in its air mass, through
    which goals and routes drift. Areas are over the ground, object ``[N]``; None: none.
    """
    count, dt = len(encounters.goal_x), aircraft.dt
    # The wind is known exactly, and takes nothing off the limits.
    thresholds = Thresholds.for_plans(options).in_wind(NO_WIND)
    required = 0.0 if endless else aircraft.separation
    tally = Tally(count, aircraft, endless=endless)
    replans, backup = np.zeros(count, np.int32), np.zeros(count, np.int32)
    first = None if noise is None else noise(0)
    flights = _begin(encounters, plans, first, wind, aircraft, thresholds)
    for number in range(tally.steps):
        time, rows = number * dt, flights.rows
        draws = None if noise is None else noise(number)[:, rows]
        amid = None if areas is None else in_air_at(areas[rows], take(wind, rows), time)
        flights, decision = _watch(flights, draws, amid, time, dt, thresholds)
        make = _MidFlightPlanner(flights, decision, amid, time, policy, aircraft)
        flights, asked = _plan_anew(flights, decision, make, aircraft.t_max - time, thresholds)
        replans[rows] += asked
        backup[rows] += flights.monitor.on_backup
        flights, step = _fly_on(flights, time, aircraft, options.limits)
        tally.add(rows, step, number + 1)
        if recorder is not None:
            state = flights.air.state
            recorder.append(rows, state.own, state.intruders.vehicle, step.separation)
        on = step.separation >= required
        if not on.all():
            flights = take(flights, on)
        if flights.rows.size == 0:
            break
    return Assured(tally.judge(), replans, backup * dt)


def _begin(
    encounters: Encounter,
    plans: Plans,
    draws: np.ndarray | None,
    wind: Wind | None,
    aircraft: Aircraft,
    thresholds: Thresholds[Narrowed],
) -> _Flights:
    """Return the flights ``[N]`` at their start, with the monitors of their plans; the draws are
    those of the first reports, ``[4, N, K]``.
    """
    count = len(encounters.goal_x)
    asked = request_of(encounters, aircraft)._replace(drift=drift_of(wind))
    ends = np.full(count, aircraft.t_max)
    air = Active(begin(encounters, np, history_dt=aircraft.dt), np.zeros(count), ends, asked.drift)
    reported = perceive_intruders(air.state, draws, aircraft.dt, np)
    traffic = Traffic.straight(reported, encounters.mask)
    traffic = traffic._replace(separation=encounters.separation)
    rows, made = np.arange(count), plans.candidates
    monitor = assurance.start(count, encounters.mask.shape[1], thresholds)
    monitor = assurance.activate(
        monitor, rows, made.plan_states, made.safe, 0.0, traffic, thresholds
    )
    return _Flights(
        rows=rows,
        air=air,
        asked=asked,
        monitor=monitor,
        sightings=None,
        short=made.goal > _GOAL,
        reached=np.zeros(count, dtype=bool),
    )


def _watch(
    flights: _Flights,
    draws: np.ndarray | None,
    areas: np.ndarray | None,
    time: float,
    dt: float,
    thresholds: Thresholds[Narrowed],
) -> tuple[_Flights, Decision]:
    """Let the monitors see the reports of a time, s, and the areas as they are then, and decide;
    dt: since the reports before, s.
    """
    state = flights.air.state
    reported = perceive_intruders(state, draws, dt, np)
    noise = declared_errors(None if draws is None else state.sensor)
    sightings = observe(flights.sightings, Reports(reported, *noise), time, state.mask)
    known: dict[str, Any] = {"separation": state.separation}
    if areas is not None:
        known["areas"] = _areas_met(areas, state, flights.monitor, time, thresholds)
    given = believed(time, state.own, sightings, state.mask, thresholds.turn_time, **known)
    monitor, decision = assurance.step(flights.monitor, given, thresholds)
    return flights._replace(monitor=monitor, sightings=sightings), decision


def _areas_met(
    areas: np.ndarray, state: State, monitor: Monitor, time: float, thresholds: Thresholds[Narrowed]
) -> np.ndarray:
    """Return the areas that flights ``[M]`` may meet, of those in their air masses at a time, s,
    object ``[M]``.
    """
    found = np.empty(len(areas), dtype=object)
    for n, some in enumerate(areas):
        own: VehicleState[Air] = VehicleState(*(float(field[n]) for field in state.own))
        ends = float(monitor.plan.end[n] + monitor.started[n]) - time
        found[n] = may_be_met(some, own, (), ends, thresholds)
    return found


def _plan_anew(
    flights: _Flights,
    decision: Decision,
    make: Planner,
    left: float,
    thresholds: Thresholds[Narrowed],
) -> tuple[_Flights, np.ndarray]:
    """Plan where the monitors ask for it, or where a better plan may be had, with ``left`` seconds
    until the time limit; return also which flights asked, bool ``[M]``.
    """
    monitor, short, asked = renew(
        flights.monitor, decision, flights.short, flights.reached, left, make, thresholds
    )
    return flights._replace(monitor=monitor, short=short), asked


def _fly_on(
    flights: _Flights, time: float, aircraft: Aircraft, limits: Limits
) -> tuple[_Flights, Step]:
    """Fly a time step from a time, s, on, along what the monitors have decided; the limits are the
    vehicle's.
    """
    references = assurance.references(flights.monitor, time, PERIOD * aircraft.dt, SUBSTEPS)
    air, step = fly_step(flights.air, references, aircraft, limits)
    reached = flights.reached | ~np.isnan(step.reached)
    return flights._replace(air=air, reached=reached), step


class _MidFlightPlanner(NamedTuple):
    """Plans from the middle of flights ``[M]``: to the goal from where they are, or along the
    route.
    """

    flights: _Flights
    decision: Decision
    areas: np.ndarray | None  # in the air masses, as they are now, object [M]
    time: float  # now, s after the start
    policy: Policy
    aircraft: Aircraft

    def __call__(self, rows: np.ndarray, options: Options[Narrowed], kind: int) -> Candidates:
        """Return the plans of some flights, numbers ``[m]``, of a kind of
        :mod:`agents.assurance.asking`.
        """
        own, traffic = take((self.decision.own, self.decision.traffic), rows)
        asked, state = take(self.flights.asked, rows), self.flights.air.state
        if kind == ALONG:
            x, y = drift_points((asked.route_x, asked.route_y), asked.drift, self.time)
            request = asked._replace(own=own, traffic=traffic, route_x=x, route_y=y)
        else:
            goal = (state.goal_x[rows], state.goal_y[rows])
            goal_x, goal_y = drift_points(goal, asked.drift, self.time)
            route = route_of(own, goal_x, goal_y, self.aircraft)
            request = Request(own, traffic, *route, asked.drift)
        if self.areas is None:
            return plan_many(request, self.policy, options, floats=True).candidates
        amid = self.areas[rows]
        return plan_among(request, amid, self.policy, options, floats=True).candidates
