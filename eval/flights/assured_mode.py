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
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.outcome import Rules
from envs.perception import carried_back, perceive
from envs.trees import scatter, take
from eval.config import Setting
from eval.flights.plan_flight import SUBSTEPS, Flown, Tally, fly_second, request_of, takeoff
from eval.flights.plan_mode import perceived_at_start
from eval.flights.trajectories import TrajectoryRecorder

__all__ = ["Assured", "fly_assured"]

_LEAST_TIME = 1.0  # in which a route can still be rejoined, s


class Assured(NamedTuple):
    """How encounters went; fields ``[N]``."""

    flown: Flown
    replans: np.ndarray
    """New plans asked for, int32."""
    backup: np.ndarray
    """Seconds on the backup, int32."""


def fly_assured(
    encounters: Encounter,
    plans: Plans,
    policy: Policy,
    rules: Rules,
    setting: Setting,
    *,
    spread: tuple[float, float] = (0.0, 0.0),
    noise: Callable[[int], np.ndarray] | None = None,
    recorder: TrajectoryRecorder | None = None,
) -> Assured:
    """Fly encounters ``[N]`` with the monitor until ``rules.t_max`` or a violation.

    Args:
        encounters: ``[N]``, float64.
        plans: what was planned at the start, ``[N]``.
        policy: decides.
        rules: of the task, with a time step of 1 s.
        setting: how plans are made and flown.
        spread: one sigma of the reported positions, m, and velocities, m/s: what the monitor must bear.
        noise: of the sensors by second, ``[4, N, K]``; None for perfect knowledge of the intruders. What monitor and
            planner see after the start are tracks of these reports.
        recorder: takes the trajectories.
    """
    count = len(encounters.goal_x)
    usual = Thresholds(requirement=setting.options.requirement, limits=setting.limits)
    # Three sigmas of what noise makes of an intruder that flies as predicted.
    thresholds = replace(
        usual,
        intruder_position=usual.intruder_position + 3.0 * spread[0],
        intruder_velocity=usual.intruder_velocity + 3.0 * spread[1],
    )
    asked = request_of(encounters)
    tally = Tally(count)
    replans, backup = np.zeros(count, np.int32), np.zeros(count, np.int32)
    rows, reached = np.arange(count), np.zeros(count, dtype=bool)
    first = Traffic.straight(perceived_at_start(encounters, None if noise is None else noise(0)), encounters.mask)
    monitor = assurance.start(*encounters.mask.shape)
    made = plans.proposals
    monitor = assurance.activate(monitor, rows, made.knots, made.safe, 0.0, first, thresholds)
    air = takeoff(encounters, np.full(count, rules.t_max))
    seen = encounters.intruders
    previous, sensor = (carried_back(seen, 1.0, np), carried_back(seen, 2.0, np)), encounters.sensor
    tracks: Tracks | None = None
    for clock in range(round(rules.t_max)):
        seen = air.traffic.vehicle
        if noise is not None:
            seen = perceive(seen, *previous, sensor, noise(clock)[:, rows], 1.0, np)
            quality = sensor.position_std, sensor.velocity_std
            tracks = begin(seen, *quality) if tracks is None else follow(tracks, seen, *quality, 1.0)
            seen = tracks.state
        monitor, decision = assurance.step(monitor, assurance.inputs(float(clock), air.own, seen, air.mask), thresholds)
        wanting = np.flatnonzero(decision.replan)
        if wanting.size:
            replans[rows[wanting]] += 1
            request = Request(*take((decision.own, decision.traffic, *asked[2:]), wanting))
            left = rules.t_max - clock
            found = _planned_again(request, reached[rows[wanting]], left, policy, setting.options)
            monitor, _ = assurance.answer(
                monitor, wanting, decision.number[wanting], found.knots, found.safe, thresholds
            )
        backup[rows] += monitor.on_backup
        following = intruder.step(air.traffic, air.intent, clock * 1.0, 1.0, np)
        references = assurance.references(monitor, float(clock), PERIOD, SUBSTEPS)
        second = fly_second(air, following, references, float(clock), rules.goal_radius, setting.limits)
        tally.add(rows, second, clock + 1, rules)
        reached[rows] |= ~np.isnan(second.reached)
        if recorder is not None:
            recorder.append(rows, second.own, following.vehicle, second.separation)
        previous = (air.traffic.vehicle, previous[0])
        air = air._replace(own=second.own, traffic=following, side=second.side)
        on = second.separation >= rules.separation
        if not on.all():
            rows, air, monitor, asked, previous, sensor = take((rows, air, monitor, asked, previous, sensor), on)
            tracks = None if tracks is None else take(tracks, on)
        if rows.size == 0:
            break
    return Assured(tally.flown(rules), replans, backup)


def _planned_again(request: Request, reached: Any, left: float, policy: Policy, options: Options) -> Proposals:
    """Plan from the middle of a flight: to the goal in the time left if it is still ahead, else along the route."""
    best, rows = empty(reached.size), np.flatnonzero(~reached)
    # The refinement takes longer than a monitor can wait.
    along = replace(options, exhaustive=False)
    if rows.size and left >= _LEAST_TIME:
        in_time = replace(along, goals=1, rejoin_by=min(left, options.rejoin_by))
        scatter(best, rows, plan_many(take(request, rows), policy, in_time).proposals)
    rest = np.flatnonzero(~best.safe)
    if rest.size:
        scatter(best, rest, plan_many(take(request, rest), policy, along).proposals)
    return best
