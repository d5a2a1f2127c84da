"""The assured loop: a plan, a monitor that watches it every second, new plans, and a backup at hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.assurance import monitor as assurance
from agents.assurance.monitor import Decision, Thresholds
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
from eval.flights.plan_flight import SUBSTEPS, Flown, Tally, fly_step, request_of, route_of, takeoff
from eval.flights.plan_mode import perceived_at_start
from eval.flights.trajectories import TrajectoryRecorder

__all__ = ["Assured", "along", "fly_assured"]


_GOAL = 1  # number of the goal among the route's points
_BUFFER = 0.5  # separations that a plan keeps beyond what is required, where it can: intruders may turn
_AGAIN = 5  # time steps between two attempts to reach it in time after all


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
    noise: Callable[[int], np.ndarray] | None = None,
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
        noise: of the sensors by step, ``[4, N, K]``: monitor and planner then see tracks of such reports; None: the
            intruders are known perfectly.
        recorder: takes the trajectories.
        endless: whether a loss of separation is no violation.
    """
    count, dt = len(encounters.goal_x), aircraft.dt
    thresholds = Thresholds.for_plans(setting.options)
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
    # Whether what is flown passes over the goal, or gets there too late: it is asked for again.
    short = made.goal > _GOAL
    for number in range(tally.steps):
        time = number * dt
        seen, known = air.traffic.vehicle, dict[str, Any]()
        if noise is not None:
            seen = perceive(seen, *previous, sensor, noise(number)[:, rows], dt, np)
            quality = sensor.position_std, sensor.velocity_std
            tracks = begin(seen, *quality) if tracks is None else follow(tracks, seen, *quality, dt)
            seen = tracks.state
            known = {
                "position_std": np.sqrt(tracks.position_variance),
                "velocity_std": np.sqrt(tracks.velocity_variance),
            }
        given = assurance.inputs(time, air.own, seen, air.mask, **known)
        monitor, decision = assurance.step(monitor, given, thresholds)
        ask = _Ask(
            asked, air.goal_x, air.goal_y, aircraft, policy, along(thresholds.options, aircraft.t_max - time, dt)
        )
        wanting = np.flatnonzero(decision.replan)
        if wanting.size:
            replans[rows[wanting]] += 1
            found, late = ask.planned(decision, wanting, reached[rows[wanting]])
            monitor, taken = assurance.answer(
                monitor, wanting, decision.number[wanting], found.knots, found.safe, thresholds
            )
            short[rows[wanting[taken]]] = late[taken]
        lacking = np.flatnonzero(short[rows] & ~reached[rows] & ~monitor.on_backup & ~decision.replan)
        if lacking.size and number % _AGAIN == 0:
            found, late = ask.planned(decision, lacking, reached[rows[lacking]], in_time=True)
            chosen = lacking[found.safe]
            replans[rows[chosen]] += 1
            plan, traffic = take(found.knots, found.safe), take(decision.traffic, chosen)
            monitor = assurance.activate(monitor, chosen, plan, np.ones(chosen.size, bool), time, traffic, thresholds)
            short[rows[chosen]] = False
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
    """Return how to plan from the middle of a flight, what is tried first before the rest.

    To the goal in the time left, s, if there is any, with distance to spare; without; and then along the route.
    """
    # The refinement takes longer than a monitor can wait.
    whole = replace(options, exhaustive=False)
    if left < dt:
        return [whole]
    in_time = replace(whole, goals=1, rejoin_by=min(left, options.rejoin_by))
    required = options.requirement
    wide = required._replace(margin=required.margin + _BUFFER * options.aircraft.separation)
    return [replace(in_time, requirement=wide), in_time, whole]


class _Ask(NamedTuple):
    """How plans are made from the middle of flights, ``[M]``."""

    asked: Request
    """At the start."""
    goal_x: Any
    goal_y: Any
    aircraft: Aircraft
    policy: Policy
    tries: list[Options]
    """One after the other until one is safe; all but the last to the goal."""

    def planned(
        self, decision: Decision, rows: Any, reached: Any, *, in_time: bool = False
    ) -> tuple[Proposals, np.ndarray]:
        """Return plans of some rows, and which of them do not lead to a goal that is still to be reached, or too late.

        Args:
            decision: of the monitor, ``[M]``.
            rows: numbers, ``[m]``.
            reached: whether the goal was, ``[m]``.
            in_time: whether only plans to the goal count.
        """
        best, late = empty(reached.size, self.tries[0].waypoints), np.zeros(reached.size, dtype=bool)
        own, traffic, goal_x, goal_y = take((decision.own, decision.traffic, self.goal_x, self.goal_y), rows)
        direct = Request(own, traffic, *route_of(own, goal_x, goal_y, self.aircraft))
        onward = Request(own, traffic, *take(self.asked[2:], rows))
        for options in self.tries[:-1] if in_time else self.tries:
            last = options is self.tries[-1]
            wanted = np.flatnonzero(~best.safe & ~(reached & (not last)))
            late[wanted] = last
            if wanted.size:
                request = take(onward if last else direct, wanted)
                scatter(best, wanted, plan_many(request, self.policy, options, floats=True).proposals)
        return best, late & ~reached
