"""What is flown, and its clearance from intruders, by compiled code are those by numpy."""

import numpy as np
import pytest

from agents.kernel import separation as kernel_separation
from agents.kernel.arcs import FILL_BOUNDS
from agents.kernel.clearance import Clearance, Constraint, clearance
from agents.kernel.separation import Separation, separation
from agents.kernel.traffic import Requirement, Traffic, Window
from agents.kernel.trajectory import Trajectory, straight_on, trajectory
from envs import compiled
from envs.kinematics import VehicleState
from tests.agents.kernel.test_clearance import FLOWN, aircraft
from tests.agents.planner.test_validator import traffic

pytestmark = pytest.mark.usefixtures("compiled_code")

KINDS = {**FLOWN, "straight": lambda _, count: straight_on(aircraft(count), 120.0)}


def both(
    monkeypatch: pytest.MonkeyPatch,
    flown: Trajectory,
    keeping: Constraint,
    level: float = 0.0,
    *,
    closest: bool = False,
) -> tuple[Clearance, Clearance]:
    """Return what is kept by compiled code, and by numpy."""
    assert kernel_separation.FILL_CLEARANCE.ready
    by_loops = clearance(flown, keeping, level, closest=closest)
    with monkeypatch.context() as patch:
        patch.setattr(compiled.Entry, "ready", False)
        return by_loops, clearance(flown, keeping, level, closest=closest)


def mixture(rng: np.random.Generator, rows: int, count: int) -> Traffic:
    """Return intruders, some of which turn, are known inexactly, count for some time only, have a
    separation of their own, or are not there.
    """
    intruders = traffic(rows, count, int(rng.integers(1_000_000)), turning=bool(rng.random() < 0.7))
    shape = intruders.mask.shape
    if rng.random() < 0.6:
        intruders = intruders._replace(
            position_std=rng.choice([0.0, 30.0], shape),
            velocity_std=rng.choice([0.0, 1.5], shape),
            age=rng.choice([0.0, 3.0], shape),
        )
    if rng.random() < 0.5:
        begin = rng.choice([-np.inf, 20.0, 70.0], shape)
        end = np.maximum(begin, 0.0) + rng.choice([np.inf, 25.0], shape)
        intruders = intruders._replace(window=Window(begin, end))
    if rng.random() < 0.5:
        intruders = intruders._replace(separation=rng.choice([np.nan, 300.0, 2_000.0], shape))
    if rng.random() < 0.5:
        intruders = intruders._replace(mask=rng.random(shape) < 0.8)
    return intruders


def random_flight(rng: np.random.Generator, kind: str) -> Trajectory:
    """Return one to three trajectories of a kind, some widened and some from a later time on."""
    rows = int(rng.integers(1, 4))
    flown = KINDS[kind](int(rng.integers(1_000_000)), rows)
    if rng.random() < 0.4:
        flown = flown.widened(rng.uniform(0.0, 1.0, rows), rng.uniform(0.0, 50.0, rows))
    if rng.random() < 0.4:
        flown = flown.since(rng.uniform(0.0, 100.0, rows))
    return flown


def question(
    rng: np.random.Generator, kind: str, count: int
) -> tuple[Trajectory, Separation, float]:
    """Return what is flown, what is kept from so many intruders, and the level of interest, m."""
    flown = random_flight(rng, kind)
    rows = len(flown.states.time)
    own: VehicleState = VehicleState(*(field[:, 0] for field in flown.states[:4]))
    least, margin = float(rng.choice([300.0, 1_000.0])), float(rng.choice([0.0, 50.0]))
    requirement = Requirement(least, margin, float(rng.choice([0.0, 2.0])))
    keeping = separation(mixture(rng, rows, count), own, requirement)
    if rng.random() < 0.3:
        keeping = keeping._replace(least=None)
    return flown, keeping, float(rng.choice([0.0, 500.0, np.inf, -200.0]))


def assert_same(by_loops: Clearance, by_numpy: Clearance) -> None:
    """Assert that margins, losses, legs and distances are the same, but for rounding."""
    np.testing.assert_array_equal(by_loops.margin < 0.0, by_numpy.margin < 0.0)
    np.testing.assert_array_equal(by_loops.leg, by_numpy.leg)
    for name in set(Clearance._fields) - {"leg"}:
        np.testing.assert_allclose(
            getattr(by_loops, name), getattr(by_numpy, name), rtol=0.0, atol=1e-9, err_msg=name
        )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [0, 1, 4, 5, 12, 40])
def test_compiled_code_keeps_what_numpy_keeps(
    monkeypatch: pytest.MonkeyPatch, kind: str, count: int
) -> None:
    rng, lost, count_kept = np.random.default_rng([7, count, len(kind)]), 0, 0
    for _ in range(15):
        flown, keeping, level = question(rng, kind, count)
        closest = bool(rng.random() < 0.5)
        by_loops, by_numpy = both(monkeypatch, flown, keeping, level, closest=closest)
        assert_same(by_loops, by_numpy)
        lost += np.count_nonzero(by_numpy.margin < 0.0)
        count_kept += np.count_nonzero(by_numpy.margin >= 0.0)
    assert count < 4 or (lost > 0 and count_kept > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_compiled_bounds_of_trajectories_are_those_by_numpy(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    flown = KINDS[kind](8, 20)
    assert FILL_BOUNDS.ready
    by_loops = trajectory(flown.states, flown.legs)
    monkeypatch.setattr(compiled.Entry, "ready", False)
    by_numpy = trajectory(flown.states, flown.legs)
    for compiled_field, numpy_field in zip(by_loops[2:], by_numpy[2:], strict=True):
        np.testing.assert_allclose(compiled_field, numpy_field, rtol=0.0, atol=1e-9)


def test_many_trajectories_are_split_and_all_are_filled_in(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    flown, intruders = KINDS["plan"](4, 7), mixture(rng, 7, 12)
    keeping = Separation(intruders, np.full((7, 12), 1_000.0), None, 2.0)
    whole, by_numpy = both(monkeypatch, flown, keeping, closest=True)
    monkeypatch.setattr(kernel_separation, "_PAIRS", 360)  # three trajectories
    split, _ = both(monkeypatch, flown, keeping, closest=True)
    assert_same(whole, by_numpy)
    for field, split_field in zip(whole, split, strict=True):
        np.testing.assert_array_equal(field, split_field)


def test_arrays_of_any_layout_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read-only ones, and those that are a part or the transpose of another."""
    rng = np.random.default_rng(5)
    flown, keeping, _ = question(rng, "straight", 6)
    required = np.broadcast_to(1_000.0, keeping.required.shape)
    heading = np.asfortranarray(keeping.traffic.state.heading)
    traffic = keeping.traffic._replace(state=keeping.traffic.state._replace(heading=heading))
    assert_same(*both(monkeypatch, flown, keeping._replace(traffic=traffic, required=required)))


def test_arrays_of_another_shape_are_refused() -> None:
    flown, intruders = KINDS["plan"](1, 2), traffic(2, 5, 3)
    keeping = Separation(intruders, np.full((2, 5), 1_000.0), None, 2.0)
    fewer = intruders._replace(age=intruders.age[:, :2])
    wrong = (
        keeping._replace(required=keeping.required[:1]),
        keeping._replace(traffic=fewer),
        keeping._replace(traffic=intruders._replace(window=Window(fewer.age, intruders.age))),
        keeping._replace(least=np.zeros((1, 5))),
    )
    for keeping_wrong in wrong:
        with pytest.raises(ValueError, match="same shape"):
            clearance(flown, keeping_wrong)
    shorter = flown._replace(bend=flown.bend[:, 1:])
    with pytest.raises(ValueError, match="same shape"):
        clearance(shorter, keeping)
