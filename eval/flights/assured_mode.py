"""The assured loop: a plan, a monitor that watches it every second, new plans, and a backup at hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.assurance import monitor as assurance
from agents.assurance.monitor import Thresholds
from agents.assurance.tracker import Tracks, begin, follow
from agents.planner.candidates import Proposals, empty
from agents.planner.planner import Plans, plan_many
from agents.planner.request import Options, Request
from agents.planner.traffic import Traffic
from agents.policy.inference import Policy
from envs import intruder
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.perception import carried_back, perceive
from envs.trees import scatter, take
from eval.config import Setting
from eval.flights.plan_flight import SUBSTEPS, Flown, Tally, fly_step, request_of, takeoff
from eval.flights.plan_mode import perceived_at_start
from eval.flights.trajectories import TrajectoryRecorder

__all__ = ["Assured", "Reports", "along", "fly_assured"]


class Reports(NamedTuple):
    """How the intruders are known; the default is perfectly."""

    noise: Callable[[int], np.ndarray] | None = None
    """Of the sensors by step, ``[4, N, K]``; what monitor and planner see after the start are tracks of such reports.
    """
    spread: tuple[float, float] = (0.0, 0.0)
    """One sigma of the reported positions, m, and velocities, m/s: what the monitor must bear."""


_PERFECT = Reports()


class Assured(NamedTuple):
    """How encounters went; fields ``[N]``."""

    flown: Flown
    replans: np.ndarray
    """New plans asked for, int32."""
    backup: np.ndarray
    """Time on the backup, s."""


def fly_assured(
    encounters: Encounter,
    plans: Plans,
    policy: Policy,
    aircraft: Aircraft,
    setting: Setting,
    *,
    reports: Reports = _PERFECT,
    recorder: TrajectoryRecorder | None = None,
    endless: bool = False,
) -> Assured:
    """Fly encounters ``[N]`` with the monitor until the time limit or a violation.

    Args:
        encounters: ``[N]``, float64.
        plans: what was planned at the start, ``[N]``.
        policy: decides.
        aircraft: of the ownship.
        setting: how plans are made and flown.
        reports: of the intruders.
        recorder: takes the trajectories.
        endless: whether a loss of separation is no violation.
    """
    count, dt, (noise, spread) = len(encounters.goal_x), aircraft.dt, reports
    usual = Thresholds.for_plans(setting.options)
    # Three sigmas of what noise makes of an intruder that flies as predicted.
    thresholds = replace(
        usual,
        intruder_position=usual.intruder_position + 3.0 * spread[0],
        intruder_velocity=usual.intruder_velocity + 3.0 * spread[1],
    )
    asked = request_of(encounters, aircraft)
    tally = Tally(count, aircraft, endless=endless)
    replans, backup = np.zeros(count, np.int32), np.zeros(count, np.int32)
    rows, reached = np.arange(count), np.zeros(count, dtype=bool)
    first = Traffic.straight(perceived_at_start(encounters, dt, None if noise is None else noise(0)), encounters.mask)
    monitor = assurance.start(count, encounters.mask.shape[1], thresholds)
    made = plans.proposals
    monitor = assurance.activate(monitor, rows, made.knots, made.safe, 0.0, first, thresholds)
    air = takeoff(encounters, np.full(count, aircraft.t_max))
    seen = encounters.intruders
    previous, sensor = (carried_back(seen, dt, np), carried_back(seen, 2.0 * dt, np)), encounters.sensor
    tracks: Tracks | None = None
    for number in range(tally.steps):
        time = number * dt
        seen = air.traffic.vehicle
        if noise is not None:
            seen = perceive(seen, *previous, sensor, noise(number)[:, rows], dt, np)
            quality = sensor.position_std, sensor.velocity_std
            tracks = begin(seen, *quality) if tracks is None else follow(tracks, seen, *quality, dt)
            seen = tracks.state
        monitor, decision = assurance.step(monitor, assurance.inputs(time, air.own, seen, air.mask), thresholds)
        wanting = np.flatnonzero(decision.replan)
        if wanting.size:
            replans[rows[wanting]] += 1
            request = Request(*take((decision.own, decision.traffic, *asked[2:]), wanting))
            left = aircraft.t_max - time
            again = along(setting.options, left, dt)
            found = _planned_again(request, reached[rows[wanting]], policy, again)
            monitor, _ = assurance.answer(
                monitor, wanting, decision.number[wanting], found.knots, found.safe, thresholds
            )
        backup[rows] += monitor.on_backup
        following = intruder.step(air.traffic, air.intent, time, dt, np)
        references = assurance.references(monitor, time, PERIOD * dt, SUBSTEPS)
        flown = fly_step(air, following, references, number, aircraft, setting.limits)
        tally.add(rows, flown, number + 1)
        reached[rows] |= ~np.isnan(flown.reached)
        if recorder is not None:
            recorder.append(rows, flown.own, following.vehicle, flown.separation)
        previous = (air.traffic.vehicle, previous[0])
        air = air._replace(own=flown.own, traffic=following, side=flown.side)
        on = flown.separation >= (0.0 if endless else aircraft.separation)
        if not on.all():
            rows, air, monitor, asked, previous, sensor = take((rows, air, monitor, asked, previous, sensor), on)
            tracks = None if tracks is None else take(tracks, on)
        if rows.size == 0:
            break
    return Assured(tally.flown(), replans, backup * dt)


def along(options: Options, left: float, dt: float) -> list[Options]:
    """Return how to plan from the middle of a flight: to the goal in the time left, s, if there is any, else along."""
    # The refinement takes longer than a monitor can wait.
    whole = replace(options, exhaustive=False)
    in_time = replace(whole, goals=1, rejoin_by=min(left, options.rejoin_by))
    return [in_time, whole] if left >= dt else [whole]


def _planned_again(request: Request, reached: Any, policy: Policy, tries: list[Options]) -> Proposals:
    """Plan from the middle of a flight, to the goal first where it is still ahead."""
    best = empty(reached.size, tries[0].waypoints)
    for options in tries:
        wanted = ~best.safe & ~(reached & (options is not tries[-1]))
        rows = np.flatnonzero(wanted)
        if rows.size:
            scatter(best, rows, plan_many(take(request, rows), policy, options).proposals)
    return best
