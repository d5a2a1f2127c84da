"""The flight keeps the limits to the tolerances of the theorem, and is that of the legs' curve."""

import math

import numpy as np
import pytest

from agents.check import leg
from agents.check.balls import TWO, ZERO, ball, cis, to_float
from agents.check.certificate import PlanState
from agents.check.curve import curve_controls, turn_between
from agents.check.leg import check_joint, fly, fly_leg
from agents.check.limits import AirLimits, air_limits, narrowed
from agents.check.motion import AirState
from agents.check.reading import read
from agents.check.refusal import RefusedError
from agents.check.tolerances import JOINT
from envs import waypoints
from envs.kinematics import Limits
from envs.wind import narrow
from tests.agents.check.certificates import (
    accepted,
    edited,
    flight,
    in_wind,
    refusal,
    straight,
)


def test_controls_are_the_legs() -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        row = rng.uniform([0.0, 0.0, -3.0, 60.0, 0.0], [1e5, 1e5, 3.0, 100.0, 300.0])
        after = [
            *(row[:2] + 20.0 * row[3] * np.array([np.cos(row[2]), np.sin(row[2])])),
            row[2] + 0.3,
            row[3] + 1.0,
        ]
        plan_states = np.array([row, [*after, row[4] + 20.0]])
        curve = waypoints.legs(waypoints.PlanStates(*plan_states.T))
        expected = np.concatenate([curve.yaw_rate[0], curve.acceleration[0]])
        controls = curve_controls(*(PlanState(*row) for row in plan_states.tolist()))
        assert controls == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("start", [-0.8923062638605757, -1.0292885300099641, 0.0])
@pytest.mark.parametrize(
    "turn", [math.pi, math.nextafter(math.pi, 0.0), -math.pi, math.nextafter(-math.pi, -4.0)]
)
def test_half_circles_turn_the_same_way_in_checker_and_legs(start: float, turn: float) -> None:
    rows = [[1_960.0, -2_483.0, start, 92.0, 0.0], [1_128.0, -3_207.0, start + turn, 81.0, 20.0]]
    curve = waypoints.legs(waypoints.PlanStates(*np.array(rows).T))
    controls = curve_controls(*(PlanState(*row) for row in rows))
    assert sum(controls[:10]) * 2.0 == pytest.approx(curve.yaw_rate.sum() * 2.0)
    assert abs(sum(controls[:10]) * 2.0) == pytest.approx(math.pi)


@pytest.mark.parametrize("after", [0.0, -25_713.935869632456, 1e6, -math.pi, math.pi, 3.2])
def test_a_turn_is_half_a_circle_at_most(after: float) -> None:
    turn = turn_between(0.0, after)
    assert -math.pi - 1e-8 <= turn < math.pi
    assert math.cos(turn - after) == pytest.approx(1.0, abs=1e-9)


def test_limits_are_narrowed_as_the_toolkit_does() -> None:
    rng = np.random.default_rng(12)
    for _ in range(200):
        slow, fast, weak, strong, turn, error = rng.uniform(
            [0.0, 60.0, -2.0, 0.1, 0.02, 0.01], [50.0, 200.0, -0.1, 2.0, 0.3, 9.0]
        ).tolist()
        ours = narrowed(AirLimits(*map(ball, (slow, fast, weak, strong, turn))), ball(error))
        expected = narrow(Limits(slow, fast, weak, strong, turn), error)
        assert [to_float(limit.x) for limit in ours] == pytest.approx(expected)


def test_limits_are_narrowed_by_the_sigmas_of_the_wind() -> None:
    data = straight(wind={"east": 0.0, "north": 0.0, "std": 0.5})
    assert to_float(air_limits(read(data)).speed_max.x) == 100.0
    data["requirement"]["sigmas"] = 3.0
    assert to_float(air_limits(read(data)).speed_max.x) == 98.5
    weak = edited(data, ("limits", "acceleration_max"), 0.0)
    assert "too uncertain for the aircraft to turn" in refusal(weak)


@pytest.mark.parametrize(
    ("gains", "speed", "passes"),
    [
        ((0.5 + 1e-6, 0.0), 80.0, True),  # limits of acceleration
        ((0.5 + 4e-6, 0.0), 80.0, False),
        ((-0.8 - 1e-6, 0.0), 80.0, True),
        ((-0.8 - 4e-6, 0.0), 80.0, False),
        ((0.5, 0.5), 80.0 + 1e-6, True),  # of speed
        ((0.5, 0.5), 80.0 + 4e-6, False),
        ((-0.7, -0.7), 59.0 - 1e-6, True),
        ((-0.7, -0.7), 59.0 - 4e-6, False),
        ((0.0, 0.0), 110.0, True),  # that the plan begins beyond
        ((0.1, 0.0), 110.0, False),
        ((5e-7, 0.0), 110.0, False),  # nor by less than may be passed in each arc
        ((-0.1, 0.1), 110.0, False),
        ((-0.1, -0.1), 110.0, True),
        ((0.0, 0.0), 25.0, True),
        ((-0.1, 0.0), 25.0, False),
        ((-5e-7, 0.0), 25.0, False),
        ((0.1, -0.1), 25.0, False),
        ((0.1, 0.1), 25.0, True),
    ],
)
def test_speeds_and_accelerations_are_kept(
    gains: tuple[float, float], speed: float, passes: bool
) -> None:
    data = flight(*((0.0, gain) for gain in gains), speed=speed)
    assert accepted(data) == passes
    assert passes or "leaves the" in refusal(data)


@pytest.mark.parametrize(("speed", "gain"), [(0.0, 0.1), (1.0, -0.1), (2.0, -0.1)])
def test_a_plan_flies_forwards(speed: float, gain: float) -> None:
    data = edited(flight((0.0, gain), speed=speed), ("limits", "speed_min"), -9.0)
    assert "leaves the speed limits" in refusal(data)
    assert accepted(edited(flight((0.0, 0.1), speed=1.0), ("limits", "speed_min"), -9.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_turn_rates_are_kept_on_both_sides(side: float) -> None:
    limit = 0.02
    for more, passes in ((0.0, True), (1e-9, True), (1e-8, False)):
        data = flight((side * (limit + more), 0.0))
        data["limits"]["yaw_rate_max"] = limit
        assert accepted(data) == passes
    assert "turns too fast" in refusal(data)


def test_stated_controls_are_those_of_the_curve() -> None:
    assert accepted(edited(straight(), ("controls", 0, 3), 8e-9))
    for place in (3, 13):
        for change in (2e-8, -2e-8):
            moved = edited(straight(), ("controls", 1, place), change)
            assert "the leg to waypoint 1 is not flown along its curve" in refusal(moved)


def test_a_leg_takes_time() -> None:
    assert accepted(flight((0.0, 0.0), seconds=1.1e-3))
    assert "takes no time" in refusal(flight((0.0, 0.0), seconds=0.9e-3))
    assert "takes no time" in refusal(edited(straight(), ("waypoints", 1, 4), 20.0))


def state(x: float = 0.0, speed: float = 80.0, heading: float = 0.0) -> AirState:
    return AirState(ball(x, 3.0), cis(ball(heading)), ball(speed))


@pytest.mark.parametrize(
    ("reached", "passes"),
    [
        (state(), True),
        (state(x=1e-3), True),
        (state(x=-1e-3), True),
        (state(x=1.01e-3), False),
        (state(x=-1.01e-3), False),
        (state(speed=80.000_001), True),
        (state(speed=80.000_004), False),
        (state(speed=79.999_996), False),
        (state(heading=1e-6), True),
        (state(heading=4e-6), False),
        (state(heading=math.pi), False),
    ],
)
def test_a_leg_ends_at_its_waypoint(reached: AirState, passes: bool) -> None:
    if passes:
        check_joint("a leg", reached, state())
    else:
        with pytest.raises(RefusedError, match="misses its waypoint"):
            check_joint("a leg", reached, state())


def test_each_joint_is_checked_whatever_the_curve(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leg, "check_curve", lambda *_: None)
    assert accepted(straight())
    assert "misses its waypoint" in refusal(edited(straight(), ("waypoints", 1, 0), 3_200.002))


@pytest.mark.parametrize("wind", [(10.0, 5.0), (-20.0, 0.0), (0.0, 15.0)])
def test_legs_are_curves_through_the_air(wind: tuple[float, float]) -> None:
    in_still_air = flight((0.01, 0.0), (0.0, 0.1), (-0.02, 0.0))
    assert accepted(in_still_air)
    assert accepted(in_wind(in_still_air, *wind))
    assert refusal(in_wind(in_still_air, *wind) | {"wind": in_still_air["wind"]})


def test_an_arcs_acceleration_is_that_along_and_across_its_path() -> None:
    controls = [-0.02] * 10 + [1.2] * 10
    arcs, _ = fly_leg(state(), 5.0, ball(2.0), controls)
    expected = [math.hypot(1.2, 0.02 * (82.4 + 2.4 * number)) for number in range(10)]
    assert [to_float(arc.own_acceleration.x) for arc in arcs] == pytest.approx(expected)


def test_arcs_state_times_and_bounds_of_speed_and_acceleration() -> None:
    data = flight((0.0, 0.4), (0.01, 0.0), (0.0, -0.5))
    flown = fly(read(data))
    lengths, paths, sagittas = [], [], []
    for number, arc in enumerate(flown.arcs):
        rate, gain = ((0.0, 0.4), (0.01, 0.0), (0.0, -0.5))[number // 10]
        first = to_float(arc.speed.x)
        fastest = max(first, first + 2.0 * gain)
        assert to_float(arc.begin.x) == pytest.approx(2.0 * number)
        assert to_float(arc.top_speed.x) == pytest.approx(fastest)
        bound = math.hypot(gain, fastest * rate)
        assert to_float(arc.own_acceleration.x) == pytest.approx(bound)
        assert (arc.position_after(arc.length) - arc.end).magnitude().hi < ball(1e-9).hi
        half = arc.position_after(arc.length / TWO)
        assert (arc.position_at_part(1, 2) - half).magnitude().hi < ball(1e-9).hi
        assert arc.position_at_part(0, 4) is arc.start and arc.position_at_part(4, 4) is arc.end
        assert arc.position_after(ZERO).x == pytest.approx(arc.start.x)
        sagittas.append(0.5 * bound)
        paths.append(2.0 * fastest + JOINT + 0.5 * bound)
        lengths.append(to_float(arc.length.x))
    assert to_float(flown.sagitta) == pytest.approx(max(sagittas), rel=1e-9)
    assert to_float(flown.path) == pytest.approx(sum(paths), abs=1e-6)
    assert to_float(flown.until.x) == pytest.approx(60.0) and max(lengths) == pytest.approx(2.0)
