"""Scenarios of a geometry and modifiers: which names there are, what is refused, and that no part
changes what another draws.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs.aircraft import PAPER
from envs.encounters import Encounter, EncounterError, Sampler
from envs.scenarios import (
    MODIFIERS,
    SAMPLERS,
    SCENARIOS,
    canonical,
    expected,
    register,
    resolve,
    sample,
    scenario,
)
from envs.scenarios.geometry import conflict_point
from envs.starts import EVERY_FIELD, check_encounter, encounters_of_seed
from envs.trees import map_leaves

ALONE = {"turns", "giving_way", "turning_into", "reacting"}
"""Modifiers of which a scenario has only one: all say how intruders turn."""

PAIRS = [
    pair
    for pair in itertools.combinations(MODIFIERS, 2)
    if not (set(pair) <= ALONE or set(pair) == {"noise", "late"})
]


def draw(name: str, count: int = 60, **changes: object) -> Encounter:
    return encounters_of_seed(scenario(name, PAPER, **changes), 3, 0, count, heeds=EVERY_FIELD)


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Forget the user's own samplers of this test."""
    monkeypatch.setattr(SAMPLERS, "own", {})
    yield


def test_spaces_and_order_do_not_matter():
    assert canonical("circle+partly_seen  +standing") == "circle + standing + partly_seen"
    assert scenario("circle+partly_seen+standing", PAPER) == scenario(
        "circle + standing + partly_seen", PAPER
    )
    assert scenario(" circle ", PAPER).name == "circle"


def test_every_name_that_is_offered_is_one():
    for name in (*SCENARIOS, *(f"circle + {word}" for word in MODIFIERS)):
        assert canonical(name) == name
        assert name.rpartition(" ")[2] in expected()
        assert draw(name, 4).mask.any()


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "cirle",
            f"scenario 'cirle' is unknown; expected one of {', '.join(SCENARIOS)}, or module:name "
            "of your own; did you mean circle?",
        ),
        (
            "circle + partly_sen",
            f"modifier 'partly_sen' is unknown; expected one of {', '.join(MODIFIERS)}; did you "
            "mean partly_seen?",
        ),
        (
            "circle + ",
            f"modifier '' is unknown; expected one of {', '.join(MODIFIERS)}",
        ),
        (
            "standing + partly_seen",
            "scenario 'standing + partly_seen' begins with a modifier; expected a geometry before "
            "it, such as circle + standing",
        ),
        (
            "circle + standing + standing",
            "scenario 'circle + standing + standing' has modifier standing twice; expected it once",
        ),
        (
            "maneuvering + turns",
            "scenario 'maneuvering + turns' has modifier turns twice; expected it once",
        ),
        (
            "circle + late + noise",
            "scenario 'circle + late + noise' has modifiers late and noise, which both say how old "
            "reports are; expected one of them",
        ),
        (
            "maneuvering + reacting",
            "scenario 'maneuvering + reacting' has modifiers turns and reacting, which both say "
            "how intruders turn; expected one of them",
        ),
        (
            "circle + multi",
            "scenario 'circle + multi' names two geometries, circle and multi; expected one of "
            f"them, and modifiers: {', '.join(MODIFIERS)}",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(own: None, name: str, sentence: str):
    with pytest.raises(EncounterError) as caught:
        scenario(name, PAPER)
    assert str(caught.value) == sentence


def test_modifiers_that_decide_the_same_are_refused_by_name():
    refused = [pair for pair in itertools.combinations(MODIFIERS, 2) if pair not in PAIRS]
    assert len(refused) == 7
    for first, second in refused:
        with pytest.raises(EncounterError, match=rf"modifiers {first} and {second}, which both"):
            canonical(f"circle + {first} + {second}")


FIELDS = "coverage", "separation", "reaction", "sensor", "intruders", "intent"


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_two_modifiers_do_together_what_each_does_alone(pair: tuple[str, str]):
    """Field by field and bit for bit, in encounters of which none was drawn again."""
    names = "multi", f"multi + {pair[0]}", f"multi + {pair[1]}", f"multi + {pair[0]} + {pair[1]}"
    drawn = [draw(name) for name in names]
    check_encounter(drawn[-1], PAPER, drawn[-1].goal_x.shape)
    unchanged = np.all([encounters.own.x == drawn[0].own.x for encounters in drawn], axis=0)
    assert unchanged.mean() > 0.4
    for field in FIELDS:
        plain, first, second, together = (
            part(encounters, field, unchanged) for encounters in drawn
        )
        if field == "intent" and pair == ("turns", "standing"):
            continue  # a turn begins before the closest approach to where an intruder flies
        assert same(first, plain) or same(second, plain)
        assert same(together, second if same(first, plain) else first)


def part(drawn: Encounter, field: str, rows: np.ndarray) -> Any:
    return map_leaves(lambda values: values[rows], getattr(drawn, field))


def same(first: Any, second: Any) -> bool:
    """Return whether two fields of encounters are equal, bit for bit."""
    if first is None or second is None:
        return first is second
    return all(map(np.array_equal, jax.tree.leaves(first), jax.tree.leaves(second)))


def test_a_modifier_changes_nothing_else_of_an_encounter():
    """What flies flies as without those that stand, unless the encounter is drawn again."""
    plain, modified = draw("circle", 400), draw("circle + standing + partly_seen + noise", 400)
    flies = (modified.intruders.speed > 0.1 * PAPER.limits.speed_max)[:, 0]
    unchanged = flies & (modified.own.x == plain.own.x)
    assert 0.4 < unchanged.mean() < 0.6
    assert unchanged.sum() > 0.9 * flies.sum()
    np.testing.assert_array_equal(modified.intruders.x[unchanged], plain.intruders.x[unchanged])
    np.testing.assert_array_equal(modified.goal_x[unchanged], plain.goal_x[unchanged])


def test_turns_and_noise_are_those_of_the_names_that_ship():
    for short, name in (("maneuvering", "circle + turns"), ("noisy", "circle + noise")):
        map_leaves(np.testing.assert_array_equal, draw(short), draw(name))


def test_an_encounter_is_the_same_in_any_company():
    name = "multi + standing + own_separations + partly_seen"
    together, alone = (
        draw(name, 50),
        encounters_of_seed(scenario(name, PAPER), 3, 17, 1, heeds=EVERY_FIELD),
    )
    map_leaves(lambda a, b: np.testing.assert_array_equal(a[17:18], b), together, alone)


def test_numpy_and_jax_draw_the_same():
    chosen = scenario("circle + standing + own_separations + partly_seen + turns", PAPER)
    draws = np.random.default_rng(1).random((2, 200, chosen.dimensions)).astype(np.float32)
    ours, accepted = sample(chosen, draws, np)
    theirs, also = jax.jit(lambda drawn: sample(chosen, drawn, jnp))(draws)
    alike = accepted == also
    assert alike.mean() > 0.98  # a condition that rounding decides
    map_leaves(
        lambda a, b: np.testing.assert_allclose(
            a[alike], np.asarray(b)[alike], rtol=2e-3, atol=0.1
        ),
        ours,
        theirs,
    )


def test_a_sampler_of_the_users_own_takes_modifiers(own: None):
    register("mine", Sampler(conflict_point_of_mine, 7, 7))
    drawn = draw("mine + standing + partly_seen + noise", 20)
    assert drawn.coverage is not None
    assert (drawn.sensor.position_std > 0.0).all()
    with pytest.raises(EncounterError, match=r"'mine \+ turns': its sampler does not heed"):
        draw("mine + turns", 4)
    with pytest.raises(EncounterError, match="scenario 'yours' is unknown"):
        resolve("yours + noise")
    register("turning", Sampler(conflict_point_of_mine, 7, 7, modifiers=("noise",)))
    with pytest.raises(EncounterError, match="modifier noise twice"):
        draw("turning + noise")


def conflict_point_of_mine(chosen, draws, xp):
    """Return encounters of the toolkit's geometry that never turn."""
    encounter, accepted = conflict_point(chosen, draws, xp)
    return encounter._replace(
        intent=encounter.intent._replace(heading_change=0.0 * encounter.mask)
    ), accepted


def test_a_modifier_does_not_replace_what_a_sampler_says_itself(own: None):
    def encounters(chosen, draws, xp):
        encounter, accepted = conflict_point(chosen, draws, xp)
        return encounter._replace(separation=2e3 + 0.0 * encounter.mask), accepted

    register("mine", Sampler(encounters, 7, 7))
    with pytest.raises(
        EncounterError, match="both its sampler and modifier own_separations set separation"
    ):
        draw("mine + own_separations", 4)


@pytest.mark.parametrize("name", ["a + b", "standing"])
def test_names_that_would_mean_something_else_are_refused(own: None, name: str):
    with pytest.raises(EncounterError, match="expected a"):
        register(name, Sampler(conflict_point, 7, 7))
