"""The assured loop: a plan, a monitor that watches it every second, new plans, and a backup at
hand.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents import assurance
from agents.assurance.areas import may_be_met
from agents.assurance.asking import ALONG, renew
from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_profile
from agents.assurance.climbs import Met
from agents.assurance.inputs import believed
from agents.assurance.monitor import Decision, Thresholds
from agents.assurance.state import Monitor
from agents.kernel.levels import Altitude
from agents.kernel.traffic import Traffic
from agents.planner.planner import Plans, plan_among, plan_many
from agents.planner.request.encounters import request_of, route_of
from agents.planner.request.options import L, Narrowed, Options
from agents.planner.request.reports import Intruder
from agents.planner.request.request import Request, drift_points
from agents.planner.search.candidates import Candidates
from agents.planner.search.in_space import plan_each_in_space
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.perception import declared_errors
from envs.profile import Height
from envs.profile import level as straight_on
from envs.tracking.tracker import Reports, Sightings, observe
from envs.trees import take
from envs.wind import NO_WIND, Wind
from envs.world import State, begin, known_intruders, perceive_intruders
from eval.flights.among_areas import in_air_at
from eval.flights.believed import is_carried
from eval.flights.in_space import (
    climbers,
    find_backups_met,
    find_met_holding,
    find_met_on_profiles,
    heights_at,
    on_profiles,
    own_altitudes,
    reports,
    who_counts,
)
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
    request: Request  # of the planner at the start
    monitor: Monitor
    sightings: Sightings[Air] | None  # of the intruders; None: there was none yet
    short: np.ndarray  # whether what is flown passes over the goal, or gets there too late
    reached: np.ndarray  # whether the goal was reached
    # of altitude, what is flown: envs.profile.Profile, its times s after the start, object; None:
    # encounters in the plane
    profile: np.ndarray | None = None


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
    which goals and routes drift. Areas are over the ground, object ``[N]``; None: none. In space
    there are no areas.
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
        areas_in_air = None if areas is None else in_air_at(areas[rows], take(wind, rows), time)
        in_space = flights.profile is not None
        heights = _heights(flights, time, aircraft, options) if in_space else None
        flights, decision = _watch(
            flights, draws, areas_in_air, heights, time, aircraft, thresholds
        )
        make = _MidFlightPlanner(flights, decision, areas_in_air, heights, time, policy, aircraft)
        flights, renewed = _plan_anew(flights, decision, make, aircraft.t_max - time, thresholds)
        replans[rows] += renewed
        backup[rows] += flights.monitor.on_backup
        flights, step, altitudes = _fly_on(flights, time, aircraft, options)
        tally.add(rows, step, number + 1)
        if recorder is not None:
            state, reached = flights.air.state, None if altitudes is None else altitudes[-1]
            recorder.append(
                rows, state.own, state.intruders.vehicle, step.separation, own_altitude=reached
            )
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
    request = request_of(encounters, aircraft)._replace(drift=drift_of(wind))
    ends = np.full(count, aircraft.t_max)
    air = Active(
        begin(encounters, np, history_dt=aircraft.dt), np.zeros(count), ends, request.drift
    )
    reported = perceive_intruders(air.state, draws, aircraft.dt, np)
    traffic = Traffic.straight(reported, known_intruders(air.state, aircraft, np))
    traffic = traffic._replace(separation=encounters.separation)
    rows, candidates = np.arange(count), plans.candidates
    in_space: dict[str, Any] = {}
    if encounters.altitudes is not None:
        profiles = _first_profiles(encounters.altitudes.own, candidates.profile)
        in_space = {"profile": profiles}
        own = own_altitudes(_at_moment(profiles, 0.0, thresholds.options))
        intruders = reports(encounters.altitudes, 0, aircraft.dt)
        met = find_met_on_profiles(profiles, own, intruders, 0.0, thresholds.options)
        traffic = traffic._replace(window=met.all_times)
    monitor = assurance.start(count, encounters.mask.shape[1], thresholds)
    monitor = assurance.activate(
        monitor, rows, candidates.plan_states, candidates.safe, 0.0, traffic, thresholds
    )
    return _Flights(
        rows=rows,
        air=air,
        request=request,
        monitor=monitor,
        sightings=None,
        short=candidates.goal > _GOAL,
        reached=np.zeros(count, dtype=bool),
        **in_space,
    )


def _first_profiles(level: np.ndarray, planned_profiles: np.ndarray | None) -> np.ndarray:
    """Return the profiles of plans, object ``[N]``; level flight at altitudes, m, ``[N]``, where
    there is none.
    """
    profiles = np.full(level.size, None, dtype=object)
    for n, altitude in enumerate(level.tolist()):
        planned = None if planned_profiles is None else planned_profiles[n]
        profiles[n] = straight_on(altitude) if planned is None else planned
    return profiles


class _Heights(NamedTuple):
    """Where flights ``[M]`` in space and their intruders are up and down now."""

    own: list[Altitude]
    intruders: list[list[Intruder[Air]]]  # of each flight's K intruders
    level: np.ndarray  # altitudes of the routes, m

    def of(self, rows: np.ndarray) -> "_Heights":
        """Return those of some flights."""
        numbers = rows.tolist()
        return _Heights(
            [self.own[n] for n in numbers], [self.intruders[n] for n in numbers], self.level[rows]
        )


def _heights(flights: _Flights, time: float, aircraft: Aircraft, options: Options) -> _Heights:
    """Return where flights in space are up and down at a time, s."""
    altitudes, profiles = flights.air.state.altitudes, flights.profile
    assert altitudes is not None and profiles is not None
    own = _at_moment(profiles, time, options)
    step = round(time / aircraft.dt)
    return _Heights(own_altitudes(own), reports(altitudes, step, aircraft.dt), altitudes.own)


def _at_moment(profiles: np.ndarray, time: float, options: Options[L]) -> Height:
    """Return where profiles, object ``[M]``, are flown at a time, s, ``[M]``."""
    return take(heights_at(profiles, np.array([time]), options.vertical.acceleration), 0)


def _meetings(
    flights: _Flights, heights: _Heights, time: float, options: Options[L]
) -> dict[str, Any]:
    """Return when intruders count for the monitors at a time, s, as they are given it."""
    own, intruders = heights.own, heights.intruders
    inputs: dict[str, Any] = {"window": find_met_holding(own, intruders, options).all_times}
    if options.climbs and flights.profile is not None:
        inputs["backups"] = partial(find_backups_met, own, intruders, options)
        inputs["on_profile"] = on_profiles(flights.profile, own, intruders, time, options)
    return inputs


def _watch(
    flights: _Flights,
    draws: np.ndarray | None,
    areas: np.ndarray | None,
    heights: _Heights | None,
    time: float,
    aircraft: Aircraft,
    thresholds: Thresholds[Narrowed],
) -> tuple[_Flights, Decision]:
    """Let the monitors see the reports of a time, s, and the areas as they are then, and decide.

    Who is not reported any more is carried on as :mod:`eval.flights.believed` has it.
    """
    state = flights.air.state
    reported = perceive_intruders(state, draws, aircraft.dt, np)
    noise = declared_errors(None if draws is None else state.sensor)
    known = known_intruders(state, aircraft, np)
    sightings = observe(flights.sightings, Reports(reported, *noise), time, known)
    mask = state.mask & is_carried(sightings, time, aircraft)
    fields: dict[str, Any] = {"separation": state.separation}
    if areas is not None:
        fields["areas"] = _areas_met(areas, state, flights.monitor, time, thresholds)
    if heights is not None:
        fields |= _meetings(flights, heights, time, thresholds.options)
    inputs = believed(time, state.own, sightings, mask, **fields)
    monitor, decision = assurance.step(flights.monitor, inputs, thresholds)
    return flights._replace(monitor=monitor, sightings=sightings), decision


def _areas_met(
    areas: np.ndarray, state: State, monitor: Monitor, time: float, thresholds: Thresholds[Narrowed]
) -> np.ndarray:
    """Return the areas that flights ``[M]`` may meet, of those in their air masses at a time, s,
    object ``[M]``.
    """
    met = np.empty(len(areas), dtype=object)
    for n, areas_of_flight in enumerate(areas):
        own: VehicleState[Air] = VehicleState(*(float(field[n]) for field in state.own))
        ends = float(monitor.plan.end[n] + monitor.started[n]) - time
        met[n] = may_be_met(areas_of_flight, own, (), ends, thresholds)
    return met


def _plan_anew(
    flights: _Flights,
    decision: Decision,
    make: "_MidFlightPlanner",
    time_left: float,
    thresholds: Thresholds[Narrowed],
) -> tuple[_Flights, np.ndarray]:
    """Plan where the monitors ask for it, or where a better plan may be had, with ``time_left``
    seconds until the time limit; return also which flights asked, bool ``[M]``.
    """
    options = thresholds.options
    meets = partial(make.meets, options) if options.climbs else None
    monitor, short, requested, taken_up = renew(
        flights.monitor,
        decision,
        flights.short,
        flights.reached,
        time_left,
        make,
        thresholds,
        meets,
    )
    flights = flights._replace(monitor=monitor, short=short)
    if make.heights is None or taken_up is None:
        return flights, requested
    return _change_profiles(flights, taken_up, make.heights, make.time, options), requested


def _change_profiles(
    flights: _Flights, taken_up: np.ndarray, heights: _Heights, time: float, options: Options[L]
) -> _Flights:
    """Return flights that fly the profiles of plans that were taken up at a time, s, object
    ``[M]``, None: none was; and those of their backups.
    """
    assert flights.profile is not None
    profiles, backup = flights.profile.copy(), flights.monitor.backup
    for n, profile in enumerate(taken_up):
        flown = profile
        if flights.monitor.on_backup[n]:
            flown = backup_profile(Sense(int(backup.sense[n])), heights.own[n], options)
        if flown is not None:
            profiles[n] = flown.since(-time)
    return flights._replace(profile=profiles)


def _fly_on(
    flights: _Flights, time: float, aircraft: Aircraft, options: Options
) -> tuple[_Flights, Step, np.ndarray | None]:
    """Fly a time step from a time, s, on, along what the monitors have decided; return also the own
    altitudes at its beginning and after every period, m, None: in the plane.
    """
    period, altitudes = PERIOD * aircraft.dt, None
    references = assurance.references(flights.monitor, time, period, SUBSTEPS)
    if flights.profile is not None:
        times = time + np.arange(SUBSTEPS + 1) * period
        acceleration = options.vertical.acceleration
        altitudes = heights_at(flights.profile, times, acceleration).altitude
    air, step = fly_step(flights.air, references, aircraft, options.limits, altitudes)
    reached = flights.reached | ~np.isnan(step.reached)
    return flights._replace(air=air, reached=reached), step, altitudes


class _MidFlightPlanner(NamedTuple):
    """Plans from the middle of flights ``[M]``: to the goal from where they are, or along the
    route.
    """

    flights: _Flights
    decision: Decision
    areas: np.ndarray | None  # in the air masses, as they are now, object [M]
    heights: _Heights | None  # None: in the plane
    time: float  # now, s after the start
    policy: Policy
    aircraft: Aircraft

    def __call__(self, rows: np.ndarray, options: Options[Narrowed], kind: int) -> Candidates:
        """Return the plans of some flights, numbers ``[m]``, of a kind of
        :mod:`agents.assurance.asking`.
        """
        own, traffic = take((self.decision.own, self.decision.traffic), rows)
        original, state = take(self.flights.request, rows), self.flights.air.state
        if kind == ALONG:
            x, y = drift_points((original.route_x, original.route_y), original.drift, self.time)
            request = original._replace(own=own, traffic=traffic, route_x=x, route_y=y)
        else:
            goal = (state.goal_x[rows], state.goal_y[rows])
            goal_x, goal_y = drift_points(goal, original.drift, self.time)
            route = route_of(own, goal_x, goal_y, self.aircraft)
            request = Request(own, traffic, *route, original.drift)
        if self.heights is not None and options.climbs:
            own, reports, level = self.heights.of(rows)
            climbing = climbers(own, level, reports)
            return plan_each_in_space(request, climbing, self.policy, options).candidates
        if self.heights is not None and traffic.window is not None:
            request = request._replace(traffic=who_counts(traffic, traffic.window))
        if self.areas is None:
            return plan_many(request, self.policy, options, floats=True).candidates
        areas = self.areas[rows]
        return plan_among(request, areas, self.policy, options, floats=True).candidates

    def meets(self, options: Options[Narrowed], rows: np.ndarray, candidates: Candidates) -> Met:
        """Return what plans of some flights that climb or descend meet from now on."""
        assert self.heights is not None
        own, intruders, level = self.heights.of(rows)
        profiles = _first_profiles(level, candidates.profile)
        return find_met_on_profiles(profiles, own, intruders, 0.0, options)
