"""A small closed loop: encounters flown with the monitor, the planner and the follower, for tests and figures.

python -m tests.agents.closed_loop maneuvering 300
"""

import sys
import time as clock
from collections import Counter
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents import assurance
from agents.assurance import Thresholds
from agents.inference import Policy
from agents.planner import plan_many
from agents.proposals import Proposals, nothing, put
from agents.request import Options, Request
from agents.traffic import Traffic
from envs import intruder
from envs.encounters import Encounter, scenario
from envs.follower import PERIOD, KinematicVehicle, steer
from envs.intruder import INTRUDER_LIMITS
from envs.kinematics import C208_PUBLISHED, VehicleState, advance
from envs.relative import distance, leg_separation
from envs.starts import numbered
from envs.trees import take

PARTS = round(1.0 / PERIOD)


class Closed(NamedTuple):
    violated: Any
    reached: Any
    min_separation: Any
    duration: Any
    replans: Any
    backup_s: Any
    states: Any  # [T, N] codes; IDLE after the end
    causes: Counter


def route(encounters: Encounter) -> tuple[Any, Any]:
    dx, dy = encounters.goal_x - encounters.own.x, encounters.goal_y - encounters.own.y
    far = distance(dx, dy, np)
    beyond = np.arange(10) * 5_000.0
    return (
        encounters.goal_x[:, None] + beyond * (dx / far)[:, None],
        encounters.goal_y[:, None] + beyond * (dy / far)[:, None],
    )


def plans_at(request: Request, policy: Policy, options: Options, margins: tuple[float, ...], until: float) -> Proposals:
    """Plan to the goal with the widest of the margins that gives a safe plan in time; else as the options say."""
    steps = [(margin, 1, False) for margin in margins] + [(margins[-1], options.goals, options.thorough)]
    best = nothing(request.points.size)
    rows = np.arange(request.points.size)
    for margin, goals, thorough in steps:
        asked = replace(
            options,
            requirement=options.requirement._replace(margin=margin),
            goals=goals,
            rejoin_by=until if goals == 1 else options.rejoin_by,
            thorough=thorough,
        )
        if asked.rejoin_by < 1.0:
            continue
        put(best, rows, plan_many(take(request, rows), policy, asked).proposals)
        rows = rows[~best.safe[rows]]
        if rows.size == 0:
            break
    return best


def fly(
    encounters: Encounter,
    policy: Policy,
    options: Options,
    thresholds: Thresholds,
    margins: tuple[float, ...] = (100.0, 0.1),
    seconds: int = 300,
) -> Closed:
    count = encounters.goal_x.size
    x, y = route(encounters)
    points = np.full(count, x.shape[1])
    vehicle = KinematicVehicle(encounters.own, C208_PUBLISHED)
    traffic = intruder.start(encounters.intruders, np)
    first = Traffic.straight(encounters.intruders, encounters.mask)
    monitor = assurance.start(count, encounters.mask.shape[1])
    proposals = plans_at(Request(encounters.own, first, x, y, points), policy, options, margins, float(seconds))
    everyone = np.arange(count)
    monitor = assurance.activate(monitor, everyone, proposals.knots, proposals.safe, 0.0, first, thresholds)
    flying = np.ones(count, dtype=bool)
    least, duration = np.full(count, np.inf), np.full(count, float(seconds))
    reached, replans, backup = flying & False, np.zeros(count, int), np.zeros(count, int)
    states, causes = [], Counter()
    for second in range(seconds):
        told = assurance.inputs(float(second), vehicle.state, traffic.vehicle, encounters.mask)
        monitor, decision = assurance.step(monitor, told, thresholds)
        rows = np.flatnonzero(decision.replan)
        if rows.size:
            replans[rows] += 1
            request = Request(*take((decision.own, decision.traffic, x, y, points), rows))
            found = plans_at(request, policy, options, margins, float(seconds - second))
            for code in decision.causes[rows]:
                causes.update(c.name for c in assurance.Cause(int(code)))
            monitor, _ = assurance.answer(monitor, rows, decision.number[rows], found.knots, found.safe, thresholds)
        states.append(monitor.state.copy())
        backup += monitor.on_backup
        after = intruder.step(traffic, encounters.intent, float(second), 1.0, np)
        rate = np.angle(np.exp(1j * (after.vehicle.heading - traffic.vehicle.heading)))
        references = assurance.references(monitor, float(second), PERIOD, PARTS)
        seen = traffic.vehicle
        for part in range(PARTS):
            before = vehicle.state
            now, then = (VehicleState(*(field[part + i] for field in references)) for i in (0, 1))
            vehicle.step(*steer(now, then, before), PERIOD)
            later = advance(traffic.vehicle, 0.0 * rate, rate, (part + 1) * PERIOD, INTRUDER_LIMITS, np)
            gap = leg_separation(_column(before), _column(vehicle.state), seen, later, PERIOD, np)
            gap = np.min(np.where(encounters.mask, gap, np.inf), axis=-1)
            least = np.where(flying, np.minimum(least, gap), least)
            seen = later
        traffic = after
        own = vehicle.state
        there = flying & (distance(encounters.goal_x - own.x, encounters.goal_y - own.y, np) <= 500.0)
        lost = flying & (least < 1000.0)
        reached |= there & ~lost
        ended = there | lost
        duration[ended] = second + 1.0
        flying &= ~ended
        monitor = assurance.deactivate(monitor, np.flatnonzero(ended))
        if not flying.any():
            break
    return Closed(least < 1000.0, reached, least, duration, replans, backup, np.stack(states), causes)


def _column(state: VehicleState) -> VehicleState:
    return VehicleState(*(field[:, None] for field in state))


def main() -> None:
    name, count = sys.argv[1], int(sys.argv[2])
    changes, margins = {}, (100.0, 0.1)
    for item in sys.argv[3:]:
        key, value = item.split("=")
        if key == "margins":
            margins = tuple(float(part) for part in value.split(","))
        else:
            changes[key] = float(value)
    begun = clock.perf_counter()
    encounters = numbered(scenario(name), 0, int(changes.pop("first", 0)), count)
    options = Options(thorough=bool(changes.pop("thorough", 1)))
    result = fly(encounters, Policy.load(), options, Thresholds(**changes), margins)
    print(
        f"{name} {count} {changes} {margins}: violated {result.violated.sum()} not reached "
        f"{(~result.reached & ~result.violated).sum()} reached {result.reached.sum()} "
        f"replans {result.replans.mean():.2f} backup_s {result.backup_s.sum()} "
        f"mean duration {result.duration.mean():.1f}; {clock.perf_counter() - begun:.0f} s"
    )
    print("violated", np.flatnonzero(result.violated).tolist(), np.round(result.min_separation[result.violated], 1))
    print("late", np.flatnonzero(~result.reached & ~result.violated).tolist(), dict(result.causes))


if __name__ == "__main__":
    main()
