"""Plans among traffic whose reports have one wrong field: ``python -m benchmarks.wrong_fields``.

In every scene an intruder of the scenario ``circle`` flies straight in a wind of its own, of up to
20 m/s. It is reported once a second, with errors of 10 m and 1 m/s, one sigma per axis, and with
the field of its kind wrong:

- *right*: nothing;
- *heading for track*, *airspeed for ground speed*: as the wind makes them differ;
- *knots for m/s*, *m/s for knots*: the speed;
- *late*: all of it is 0.5 to 3 s older than its time says;
- *held*: the position is a new one only every 2 to 5 s;
- *two clocks*: every second report comes through a receiver whose clock is 0.5 to 3 s late.

The reports go through the tracker. After some of them a plan is made, from the scene's start, and
held against the intruder's true flight. Of each kind are told:

- ``safe``: share of scenes whose plan is SAFE;
- ``violated``: plans that are SAFE, and come nearer to the intruder than the required separation;
  ``deepest``: by how much at most;
- ``covered``: share of scenes in which something wrong is shown, nothing is believed, or the true
  position, in the 60 s after it, is within the sigmas that hold 99 % of plane normal errors;
  ``settled_covered``: the same of all seconds from 20 on.

``declared``: the reports declare their errors. ``unknown``: they do not, and count as of the
defaults of the ROS nodes.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.inputs import Memory, believed, blank, update
from agents.assurance.thresholds import Cause, Thresholds
from agents.kernel.traffic import Traffic, predict, uncertainty
from agents.planner.judge.validator import CHECKS, validate
from agents.planner.planner import plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.request import in_wind
from agents.policy.inference import Policy
from benchmarks.measure import report, show
from commands.command import Parser, run_cli, whole
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import VehicleState, velocity
from envs.perception import carry_back
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.tracking.tracker import Reports, Sightings, observe
from envs.traffic.track_units import KNOT
from envs.trees import map_leaves, take
from envs.wind import NO_WIND
from eval.evidence.outside import contradict
from ros_bridge.core.reports import USUAL

ERRORS = 10.0, 1.0
"""One sigma per axis of reported positions, m, and velocities, m/s."""

_WIND = 20.0  # m/s, the strongest
_OFFSETS = 0.5, 3.0  # s by which times are wrong
_HELD = 2, 5  # s for which a position is held
_ASKED = 3, 10, 21, 40  # reports after which plans are made
_SETTLED = 20  # s, from which on scenes should be covered
_AHEAD = 0.0, 30.0, 60.0  # s, for which a prediction is judged
_SIGMAS = math.sqrt(-2.0 * math.log(0.01))  # within which 99 % of plane normal errors are
_ROWS = 500  # scenes that are planned together


class Scenes(NamedTuple):
    """Scenes, of an intruder each; fields ``[N]``."""

    encounters: Encounter
    wind_x: np.ndarray  # in which the intruder flies, m/s
    wind_y: np.ndarray
    offset: np.ndarray  # by which times are wrong, s
    hold_time: np.ndarray  # for how long a position is, s

    @property
    def intruder(self) -> VehicleState[Air]:
        """The true state at the start, ``[N]``."""
        return take(self.encounters.intruders, np.s_[:, 0])

    def true(self, time: Any) -> VehicleState[Air]:
        """Return the true state at times of each, s, ``[N]``."""
        return carry_back(self.intruder, -time, np)


Reported = Callable[[Scenes, int], VehicleState[Air]]
"""What is reported of scenes ``[N]`` at a second, without random errors."""


def _right(scenes: Scenes, second: int) -> VehicleState[Air]:
    return scenes.true(float(second))


def _through_air(scenes: Scenes, second: int) -> VehicleState[Air]:
    """Return the position with the velocity through the air."""
    state = _right(scenes, second)
    vx, vy = velocity(state, np)
    vx, vy = vx - scenes.wind_x, vy - scenes.wind_y
    return state._replace(heading=np.arctan2(vy, vx), speed=np.hypot(vx, vy))


def _heading_for_track(scenes: Scenes, second: int) -> VehicleState[Air]:
    return _right(scenes, second)._replace(heading=_through_air(scenes, second).heading)


def _airspeed_for_ground_speed(scenes: Scenes, second: int) -> VehicleState[Air]:
    return _right(scenes, second)._replace(speed=_through_air(scenes, second).speed)


def _speed_in_knots(scenes: Scenes, second: int) -> VehicleState[Air]:
    return _right(scenes, second)._replace(speed=scenes.intruder.speed / KNOT)


def _speed_in_metres_a_second(scenes: Scenes, second: int) -> VehicleState[Air]:
    return _right(scenes, second)._replace(speed=scenes.intruder.speed * KNOT)


def _late(scenes: Scenes, second: int) -> VehicleState[Air]:
    return scenes.true(second - scenes.offset)


def _two_clocks(scenes: Scenes, second: int) -> VehicleState[Air]:
    return _late(scenes, second) if second % 2 else _right(scenes, second)


KINDS: dict[str, Reported] = {
    "right": _right,
    "heading for track": _heading_for_track,
    "airspeed for ground speed": _airspeed_for_ground_speed,
    "knots for m/s": _speed_in_knots,
    "m/s for knots": _speed_in_metres_a_second,
    "late": _late,
    "held": _right,  # with its errors, in reports
    "two clocks": _two_clocks,
}


def draw(count: int, seed: int, policy: Policy) -> Scenes:
    """Return random scenes ``[count]``."""
    rng = np.random.default_rng([seed, 69])
    encounters = encounters_of_seed(scenario("circle", policy.aircraft), seed, 0, count)
    wind = _WIND * np.sqrt(rng.uniform(size=count))
    blows = rng.uniform(-math.pi, math.pi, count)
    return Scenes(
        encounters,
        wind * np.cos(blows),
        wind * np.sin(blows),
        rng.uniform(*_OFFSETS, count),
        rng.integers(_HELD[0], _HELD[1] + 1, count),
    )


def reports(scenes: Scenes, kind: str, seed: int) -> list[VehicleState[Air]]:
    """Return what is reported of the intruders ``[N, 1]``, each second."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    shape, received = scenes.wind_x.shape, []
    last = None
    for second in range(max(_ASKED)):
        state = KINDS[kind](scenes, second)
        vx, vy = (part + ERRORS[1] * rng.normal(size=shape) for part in velocity(state, np))
        x, y = (part + ERRORS[0] * rng.normal(size=shape) for part in (state.x, state.y))
        if last is not None and kind == "held":
            new = second % scenes.hold_time == 0
            x, y = np.where(new, x, last.x), np.where(new, y, last.y)
        last = VehicleState(x, y, np.arctan2(vy, vx), np.hypot(vx, vy))
        received.append(map_leaves(lambda field: field[:, None], last))
    return received


class Moment(NamedTuple):
    """What is believed of intruders after a report; fields ``[N, 1]``."""

    traffic: Traffic
    refused: np.ndarray  # whether nothing may be planned with it, bool
    wrong: np.ndarray  # whether something wrong is shown, bool


def follow(
    scenes: Scenes,
    received: Sequence[VehicleState[Air]],
    declared: bool,
    thresholds: Thresholds[Narrowed],
) -> Iterator[Moment]:
    """Yield what is believed after each report, as the monitor of the assured loop sees it."""
    own, count = scenes.encounters.own, len(scenes.wind_x)
    mask = np.ones((count, 1), dtype=bool)
    memory: Memory = blank(count, 1, own.speed)
    sightings: Sightings[Air] | None = None
    declared_std = ERRORS if declared else (0.0, 0.0)
    for second, state in enumerate(received):
        sightings = observe(sightings, Reports(state, *declared_std, declared), float(second), mask)
        inputs = believed(float(second), own, sightings, mask)
        if not declared:
            inputs = inputs._replace(
                position_std=np.maximum(inputs.position_std, USUAL.position_std),
                velocity_std=np.maximum(inputs.velocity_std, USUAL.velocity_std),
            )
        memory, _own, traffic, _causes, causes = update(memory, inputs, thresholds)
        refused = (causes & int(Cause.INTRUDER_MISSING | Cause.INTRUDER_STALE)) != 0
        wrong = contradict(sightings, float(second), thresholds.intruder_age)
        yield Moment(traffic, refused, wrong)


def covers(scenes: Scenes, moment: Moment, time: float) -> np.ndarray:
    """Return where the true flight is within what is believed at a time, s, bool ``[N]``."""
    inside = np.ones(len(scenes.wind_x), dtype=bool)
    for ahead in _AHEAD:
        there, true = predict(moment.traffic, np.float64(ahead)), scenes.true(time + ahead)
        off = np.hypot(there.x[:, 0] - true.x, there.y[:, 0] - true.y)
        inside &= off <= _SIGMAS * uncertainty(moment.traffic, ahead)[:, 0]
    return inside


class Planned(NamedTuple):
    """Plans of scenes; fields ``[N]``."""

    safe: np.ndarray  # bool
    below: np.ndarray  # m by which it comes nearer than required; 0: it does not


def plan(
    scenes: Scenes, moment: Moment, time: float, policy: Policy, options: Options[Narrowed]
) -> Planned:
    """Plan scenes from their start, with what is believed at a time, s, and hold the plans against
    the true flights.
    """
    # What is believed is as far from the truth at the start as it is from the truth then.
    vx, vy = velocity(scenes.intruder, np)
    state = moment.traffic.state
    state = state._replace(x=state.x - (vx * time)[:, None], y=state.y - (vy * time)[:, None])
    traffic = moment.traffic._replace(state=state, window=None, separation=None)
    request = request_of(scenes.encounters, options.aircraft)._replace(traffic=traffic)
    count, accepted = len(scenes.wind_x), np.flatnonzero(~moment.refused[:, 0])
    safe, below = np.zeros(count, dtype=bool), np.zeros(count)
    exact = replace(options, requirement=options.requirement._replace(margin=0.0, sigmas=0.0))
    for rows in np.array_split(accepted, math.ceil(max(accepted.size, 1) / _ROWS)):
        if rows.size == 0:
            continue
        candidates = plan_many(take(request, rows), policy, options).candidates
        true = Traffic.straight(take(scenes.encounters.intruders, rows))
        judged = validate(candidates.plan_states, true, exact.requirement, exact.limits)
        violated = candidates.safe & judged.wrong[:, CHECKS.index("separation")]
        safe[rows], below[rows] = candidates.safe, np.where(violated, -judged.clearance, 0.0)
    return Planned(safe, below)


def figures(
    scenes: Scenes, kind: str, declared: bool, seed: int, policy: Policy
) -> dict[str, float]:
    """Return the figures of scenes of a kind."""
    usual = Options.for_aircraft(policy.aircraft)
    options, thresholds = in_wind(usual, None), Thresholds.for_plans(usual).in_wind(NO_WIND)
    settled, result = [], dict[str, float]()
    for second, moment in enumerate(
        follow(scenes, reports(scenes, kind, seed), declared, thresholds)
    ):
        covered = covers(scenes, moment, float(second))
        covered |= moment.refused[:, 0] | moment.wrong[:, 0]
        if second >= _SETTLED:
            settled.append(covered)
        if second + 1 not in _ASKED:
            continue
        planned = plan(scenes, moment, float(second), policy, options)
        result |= {
            f"safe_{second + 1}": float(planned.safe.mean()),
            f"violated_{second + 1}": int(np.count_nonzero(planned.below)),
            f"deepest_{second + 1}_m": float(planned.below.max()),
            f"covered_{second + 1}": float(covered.mean()),
        }
    return result | {"settled_covered": float(np.mean(settled))}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    add = parser.add_argument
    help_text = "scenes, of all kinds alike (default 1000)"
    add("--scenes", type=whole(len(KINDS)), default=1000, metavar="N", help=help_text)
    add("--seed", type=whole(0), default=100, help="seed of scenes and errors (default 100)")
    options = parser.parse_args(arguments)
    policy = Policy.load()
    count = math.ceil(options.scenes / len(KINDS))
    summary: dict[str, Any] = {"benchmark": "wrong_fields", "scenes_of_a_kind": count}
    for number, kind in enumerate(KINDS):
        scenes = draw(count, options.seed + number, policy)
        for declared in (True, False):
            name = f"{kind}, {'declared' if declared else 'unknown'}"
            summary[name] = figures(scenes, kind, declared, options.seed, policy)
            show({"kind": name} | summary[name])
    report(summary, ("numpy",))


if __name__ == "__main__":
    run_cli(main)
