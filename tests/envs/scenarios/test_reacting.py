"""Intruders that answer the ownship: who gives way and to what, who turns into its way, and how
far; parity of numpy and jax, symmetry and similarity.
"""

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import surrogate, world
from envs.aircraft import PAPER
from envs.encounters import Encounter, EncounterError
from envs.kinematics import VehicleState
from envs.outcome import RULES
from envs.reaction import GIVES_WAY, TURNS_INTO, Reaction, answer, sight_rate
from envs.scenarios import scenario
from envs.starts import EVERY_FIELD, cast, check_encounter, encounters_of_seed
from envs.surrogate import World
from envs.trees import map_leaves
from tests.support import pool_of

NAMES = "giving_way", "turning_into", "reacting"
WORLD = World(RULES._replace(separation=0.0), PAPER)  # flights go on after a loss


@pytest.fixture(scope="module")
def drawn() -> dict[str, Encounter]:
    return {
        name: encounters_of_seed(
            scenario(f"circle + {name}", PAPER, intruders=(1, 2)), 3, 0, 300, heeds=EVERY_FIELD
        )
        for name in NAMES
    }


def fly(start: Encounter, xp: Any, steps: int = 80) -> tuple[np.ndarray, np.ndarray]:
    """Return headings of the intruders ``[T, N, K]`` and separations, m, ``[T, N, K]``, of
    an ownship that flies straight on.
    """
    state = world.begin(map_leaves(xp.asarray, start), xp)
    nothing = xp.zeros_like(start.goal_x)
    headings, separations = [], []
    step: Any = jax.jit(surrogate.step) if xp is jnp else partial(world.step, xp=np)
    for _ in range(steps):
        state, result = step(state, (nothing, nothing), WORLD)
        headings.append(np.asarray(state.intruders.vehicle.heading))
        separations.append(np.asarray(result.separations))
    return np.array(headings), np.array(separations)


def closest(start: Encounter) -> np.ndarray:
    """Return the smallest separations of the first intruders, m, ``[N]``."""
    return fly(start, np)[1][:, :, 0].min(axis=0)


def answer_to(own_at: complex, own_heading: float, manner: float) -> Any:
    """Return the answer of an intruder at the origin that flies north at 80 m/s to an ownship of
    the same speed.
    """
    vehicle = VehicleState(*np.array([[0.0], [0.0], [math.pi / 2], [80.0]]))
    own = VehicleState(*np.array([[own_at.real], [own_at.imag], [own_heading], [80.0]]))
    reaction = Reaction(*np.array([[manner], [60.0], [1500.0], [1.0], [0.05]]))
    return answer(vehicle, np.zeros(1), own, reaction, np)


@pytest.mark.parametrize(
    ("own_at", "own_heading", "turns"),
    [
        (3000.0 + 3000.0j, math.pi, True),  # from its right
        (-3000.0 + 3000.0j, 0.0, False),  # from its left: the ownship gives way
        (0.0 + 6000.0j, -math.pi / 2, True),  # head-on
        (3000.0 + 3000.0j, 0.0, False),  # from its right, but flies away
        (3000.0 + 30_000.0j, math.pi, False),  # too far away
    ],
)
def test_who_has_to_give_way_to_what_it_would_meet_turns_to_the_right(
    own_at: complex, own_heading: float, turns: bool
):
    reaction = answer_to(own_at, own_heading, GIVES_WAY)
    assert reaction.reacts.item() == turns
    if turns:
        assert reaction.yaw_rate.item() == -0.05


def test_an_ownship_that_overtakes_is_left_to_keep_clear():
    vehicle = VehicleState(*np.array([[0.0], [0.0], [math.pi / 2], [40.0]]))
    reaction = Reaction(*np.array([[GIVES_WAY], [60.0], [1500.0], [1.0], [0.05]]))
    behind = VehicleState(*np.array([[300.0], [-1500.0], [math.pi / 2], [90.0]]))
    assert not answer(vehicle, np.zeros(1), behind, reaction, np).reacts.any()


def test_who_turns_into_the_way_turns_towards_where_the_ownship_evades():
    """The ownship passes to the right of it, then to the left: mirrored answers."""
    right = answer_to(1000.0 + 6000.0j, -math.pi / 2, TURNS_INTO)
    left = answer_to(-1000.0 + 6000.0j, -math.pi / 2, TURNS_INTO)
    assert right.reacts.item()
    assert right.yaw_rate.item() < 0.0
    assert right.yaw_rate.item() == pytest.approx(-left.yaw_rate.item())


def test_the_line_of_sight_turns_as_its_direction_does():
    rng = np.random.default_rng(0)
    own, vehicle = (
        VehicleState(
            rng.uniform(-5e3, 5e3, 50),
            rng.uniform(-5e3, 5e3, 50),
            rng.uniform(-3.0, 3.0, 50),
            rng.uniform(50.0, 100.0, 50),
        )
        for _ in range(2)
    )
    second = 1e-3

    def direction(time: float) -> np.ndarray:
        x, y = (
            np.array(
                [state.x + time * state.speed * np.cos(state.heading) for state in (own, vehicle)]
            ),
            np.array(
                [state.y + time * state.speed * np.sin(state.heading) for state in (own, vehicle)]
            ),
        )
        return np.arctan2(y[0] - y[1], x[0] - x[1])

    turned = np.angle(np.exp(1j * (direction(second) - direction(-second)))) / (2.0 * second)
    np.testing.assert_allclose(sight_rate(vehicle, own, np), turned, rtol=1e-4, atol=1e-9)


def test_giving_way_opens_what_it_may_and_turning_in_closes_it(drawn: dict[str, Encounter]):
    """Beside the same encounters with traffic that takes no notice."""
    for name, sign in (("giving_way", 1.0), ("turning_into", -1.0)):
        start = drawn[name]
        change = sign * (closest(start) - closest(start._replace(reaction=None)))
        assert np.median(change[np.abs(change) > 1.0]) > 50.0
        assert (change > 1.0).mean() > 0.3
        assert (change > 50.0).mean() > 2.5 * (change < -50.0).mean()


def test_no_one_turns_farther_than_its_greatest_and_all_return(drawn: dict[str, Encounter]):
    start = drawn["reacting"]
    assert start.reaction is not None
    headings, _ = fly(start, np, steps=250)
    off = np.abs(np.angle(np.exp(1j * (headings - start.intruders.heading))))
    step = PAPER.limits.yaw_rate_max * PAPER.dt
    assert (off.max(axis=0) <= start.reaction.heading_change + step).all()
    assert (off.max(axis=0)[start.reaction.manner != 0.0] > 0.01).mean() > 0.3
    assert off[:, start.reaction.manner == 0.0].max() < 1e-6
    assert off[-1].max() < 0.02


def test_numpy_and_jax_fly_the_same(drawn: dict[str, Encounter]):
    single = cast(drawn["reacting"], np.float32)
    (ours, near), (theirs, theirs_near) = (fly(single, xp, steps=60) for xp in (np, jnp))
    # An answer may begin a step earlier by rounding, and what follows differs.
    alike = np.abs(near - theirs_near).max(axis=(0, 2)) < 5.0
    assert alike.mean() > 0.97
    np.testing.assert_allclose(ours[:, alike], theirs[:, alike], atol=0.06)


def test_the_shares_are_those_said_and_the_encounters_are_whole(drawn: dict[str, Encounter]):
    for name, shares in (
        ("giving_way", (1.0, 0.0)),
        ("turning_into", (0.0, 1.0)),
        ("reacting", (0.4, 0.3)),
    ):
        start = drawn[name]
        assert start.reaction is not None
        check_encounter(start, PAPER, start.goal_x.shape)
        manner = start.reaction.manner
        drawn_shares = ((manner == GIVES_WAY).mean(), (manner == TURNS_INTO).mean())
        assert drawn_shares == pytest.approx(shares, abs=0.06)


def test_a_pool_keeps_the_others_without_an_answer(drawn: dict[str, Encounter]):
    chosen = scenario("circle + giving_way", PAPER)
    pool = pool_of([scenario("circle", PAPER), chosen], [0.5, 0.5], 2, 200)
    assert pool.reaction is not None
    manner = np.asarray(pool.reaction.manner)
    assert (manner[..., 0] == GIVES_WAY).mean() == pytest.approx(0.5, abs=0.1)
    assert (manner == 0.0).any()


def test_who_would_take_them_for_passive_refuses_them(drawn: dict[str, Encounter]):
    with pytest.raises(EncounterError, match="answer the ownship; expected a training"):
        encounters_of_seed(scenario("circle + giving_way", PAPER), 3, 0, 4)
