"""The monitor of the input: quiet in nominal flights, alarmed by every shift, alike for mirrored
and scaled scenes.
"""

import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from agents.assurance.inputs import believed
from agents.assurance.monitor import step
from agents.assurance.single import reasons
from agents.assurance.state import State
from agents.assurance.thresholds import Cause
from agents.planner import AdvisoryCode, plan
from agents.planner.request.options import Options
from agents.policy import novelty
from agents.policy.inference import Policy
from envs.aircraft import PAPER, new_aircraft
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.tracking.tracker import Reports, observe
from envs.trees import map_leaves
from envs.waypoints import RoutePoint
from eval.evidence.outside import SHIFTS, Flights, flag, fly_reported, inside, main
from tests.agents.scenes import (
    NAN,
    PATIENT,
    SPEED,
    THRESHOLDS,
    causes_of,
    far,
    flying,
    intruder_at,
    on_plan,
    state_of,
    tell,
)
from tests.support import mirror_state

COUNT, STEPS = 20, 90
HIDDEN = "a constant delay of 5 s, not declared"
HELD = "each repeated for 5 s, with new stamps"
"""The tracker takes such a report for as old as its position: nothing is wrong with it."""

ROUTE = [RoutePoint(n, 5_000.0 * n, 0.0) for n in range(8)]


@cache
def policy() -> Policy:
    return Policy.load()


@cache
def nominal(name: str = "maneuvering") -> Flights:
    turns = {"turn_rate": PAPER.limits.yaw_rate_max}
    flights = fly_reported(
        encounters_of_seed(scenario(name, PAPER, **turns), 3, 0, COUNT), policy(), PAPER, 3
    )
    part = map_leaves(lambda field: field[:STEPS], flights[:3])
    return flights._replace(own=part[0], reported=part[1], true=part[2])


def shift_flights(name: str) -> Flights:
    base = nominal("noisy" if name.startswith("noise") else "maneuvering")
    return base._replace(reported=SHIFTS[name](base.reported, np.random.default_rng(1), PAPER))


def judge(flights: Flights, aircraft: Any = PAPER) -> np.ndarray:
    flags = flag(flights, policy(), aircraft)
    return np.stack([flags[name] for name in ("range", "consistency", "novelty")])


@pytest.mark.parametrize("name", ["maneuvering", "noisy"])
def test_nominal_flights_are_quiet(name: str) -> None:
    assert inside(nominal(name), PAPER).all()
    # Late reports of a turn do contradict themselves.
    assert judge(nominal(name)).any(axis=0).mean() <= (0.1 if name == "noisy" else 0.0)


@pytest.mark.parametrize("name", [name for name in SHIFTS if name not in (HIDDEN, HELD)])
def test_each_shift_is_caught(name: str) -> None:
    assert judge(shift_flights(name)).any(axis=0).mean() >= 0.95


def test_a_delay_that_nothing_contradicts_is_not_seen() -> None:
    """What the documentation says of it: no test of reports alone can find it."""
    assert judge(shift_flights(HIDDEN))[:3].mean() < 0.1


@pytest.mark.parametrize(
    "name",
    ["intruders at 1.5 to 2.5 of the greatest speed", "turns at 2 to 4 times the greatest rate"],
)
def test_a_scene_and_its_image_in_other_units_get_the_same_verdict(name: str) -> None:
    flights, length = shift_flights(name), 2.0
    limits = PAPER.limits
    twice = new_aircraft(
        limits._replace(
            acceleration_min=limits.acceleration_min / length,
            acceleration_max=limits.acceleration_max / length,
            yaw_rate_max=limits.yaw_rate_max / length,
        ),
        length * PAPER.separation,
        dt=length * PAPER.dt,
    )

    def image(state: VehicleState) -> VehicleState:
        state = mirror_state(state)
        return state._replace(x=length * state.x, y=length * state.y)

    goal = length * flights.goal[0], -length * flights.goal[1]
    scaled_flights = flights._replace(
        own=image(flights.own), reported=image(flights.reported), goal=goal
    )
    np.testing.assert_array_equal(judge(scaled_flights, twice), judge(flights))


def test_nothing_that_is_no_number_passes() -> None:
    box = novelty.shipped_box(policy().sha256)
    assert box is not None, (
        "the box is of the policy that ships: python -m eval.evidence.outside --box"
    )
    own = VehicleState(*(np.array([value]) for value in (0.0, 0.0, 0.0, NAN)))
    reported = intruder_at(5_000.0, 0.0, math.pi)
    inputs = novelty.inputs_of(
        own, reported, np.ones((1, 1), bool), (np.array([9e3]), np.zeros(1)), PAPER
    )
    assert np.isinf(novelty.excess(box, inputs)[0]).any()
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 1.0, intruders=map_leaves(lambda field: field + NAN, far(1.0)))
    assert causes_of(monitor) & Cause.INTRUDER_MISSING


def tell_reports(reports: list[VehicleState]) -> tuple[list[State], list[bool]]:
    """Return the monitor's states, and whether it asks for a plan, where it is given what the
    tracker makes of an intruder's reports, second by second.
    """
    monitor, sightings, mask = flying(), None, np.ones((1, 1), bool)
    states, asks = [], []
    for second, report in enumerate(reports):
        sightings = observe(sightings, Reports(report, 0.0, 0.0), float(second), mask)
        time, own = float(second), on_plan(float(second))
        monitor_inputs = believed(time, own, sightings, mask)
        monitor, decision = step(monitor, monitor_inputs, THRESHOLDS)
        states.append(state_of(monitor))
        asks.append(bool(decision.replan[0]))
    return states, asks


def test_places_that_stand_still_deny_assurance_until_they_move_again() -> None:
    hold_time = 10
    states, _ = tell_reports([far(float(max(0, time - hold_time))) for time in range(60)])
    assert State.DENIED in states[:hold_time] and states[-1] is State.MONITORING


def test_reports_that_nobody_can_believe_deny_assurance() -> None:
    turned = [
        far(float(time))._replace(heading=np.full((1, 1), 0.5 * math.pi)) for time in range(20)
    ]
    states, asks = tell_reports(turned)
    assert states[-1] is State.DENIED and any(asks)


def test_a_velocity_that_differs_a_little_is_taken_from_places_and_denies_nothing() -> None:
    turned = [
        far(float(time))._replace(heading=np.full((1, 1), math.radians(25.0))) for time in range(30)
    ]
    states, _ = tell_reports(turned)
    assert State.DENIED not in states and states[-1] is State.MONITORING


def test_traffic_out_of_range_is_said_and_changes_nothing_else() -> None:
    fast = 1.5 * PAPER.limits.speed_max
    monitor, decision = tell(
        flying(intruder_at(0.0, 50_000.0, speed=fast)),
        0.0,
        intruders=intruder_at(0.0, 50_000.0, speed=fast),
    )
    for time in range(1, 3):
        monitor, decision = tell(
            monitor, float(time), intruders=intruder_at(fast * time, 50_000.0, speed=fast)
        )
    assert causes_of(monitor) == Cause.OUTSIDE_RANGE and state_of(monitor) is State.MONITORING
    assert "outside_domain" in reasons(decision, THRESHOLDS)[0].message


def test_a_plan_says_what_training_has_not_seen() -> None:
    own, intruder = (
        VehicleState(0.0, 0.0, 0.0, SPEED),
        VehicleState(6_000.0, 1_500.0, math.pi, 75.0),
    )
    calm = plan(own, [intruder], ROUTE, policy(), PATIENT)
    assert calm.advisories == ()
    answer = plan(own, [intruder._replace(speed=200.0)], ROUTE, policy(), PATIENT)
    assert any(str(advisory.field).startswith("novelty: ") for advisory in answer.advisories)
    slow = new_aircraft(PAPER.limits._replace(speed_min=30.0), PAPER.separation)
    options = Options.for_aircraft(slow, exhaustive=False, deadline_s=math.inf)
    outside = plan(own, [intruder], ROUTE, policy().for_aircraft(slow, outside="allow"), options)
    assert (AdvisoryCode.OUTSIDE_DOMAIN, "speed_min") in [
        advisory[:2] for advisory in outside.advisories
    ]


@pytest.mark.slow
def test_the_command_prints_a_rate_for_every_kind_of_traffic(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--encounters", "2", "--seed", "1"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed["shifts"]) == set(SHIFTS)
    assert all(rates["flagged"]["total"] for rates in printed["shifts"].values())
