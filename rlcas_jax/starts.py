"""The starts that a training draws: its mixture of encounters, and what separation each is asked for."""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from agents.config.load import ConfigError
from envs import surrogate
from envs.encounters import Encounter, EncounterError, Scenario, choose, padded, sample, scenario
from envs.formats import encounter_file
from envs.relative import distance
from envs.starts import cast, joined
from envs.trees import mapped
from rlcas_jax.config import TrainConfig, WorldConfig
from rlcas_jax.escape_margin import best, each, one_by_one, undecided

__all__ = [
    "EARLIER",
    "Own",
    "anywhere",
    "asked",
    "displaced",
    "draw",
    "edges",
    "intricate",
    "late",
    "noisy",
    "practised",
]

_BLOCK = 50_000
"""Encounters drawn at a time to find edges among."""

_SHORT = 20.0
"""By how much no simple manoeuvre keeps enough in what is intricate, m; one in 58 of them can be resolved."""

_SECONDS, _FLOWN = 60, 256
"""How long one manoeuvre after another is looked for, s, and of how many encounters at once."""

EARLIER = 5.0
"""How many times as many metres are little to who has two sides to choose from, and does not choose."""

_ENOUGH = 5.0
"""Encounters to expect before it is said that there are hardly any."""

_EDGES = (
    scenario("same_course", attempts=1),
    scenario("circle", attempts=1, course_difference=(-math.radians(60.0), math.radians(60.0))),
)
"""Where edges are not rare."""

_ANYWHERE = (
    *_EDGES,
    scenario("head_on", attempts=1, radius=(800.0, 2_500.0)),
    scenario("crossing_left", attempts=1, radius=(500.0, 2_500.0)),
    scenario("crossing_right", attempts=1, radius=(500.0, 2_500.0)),
    scenario("circle", attempts=1, radius=(500.0, 4_000.0), displacement=3_000.0),
)
"""Where they are not rare on other courses, nor where the goal lies aside."""


class Own(NamedTuple):
    """Encounters that are practised beside those of the scenarios, ``[M]`` each."""

    file: Encounter | None = None
    """Of ``practice.encounters``."""
    edges: Encounter | None = None
    """Of ``practice.edges``."""
    intricate: Encounter | None = None
    """Of ``practice.intricate``."""
    anywhere: Encounter | None = None
    """Of ``practice.anywhere``."""

    @classmethod
    def of(cls, config: TrainConfig) -> "Own":
        """Return those of a configuration.

        Raises:
            ConfigError: they cannot be had; see :func:`practised`, :func:`edges`, :func:`intricate` and
                :func:`anywhere`.
        """
        return cls(practised(config), edges(config), intricate(config), anywhere(config))


def practised(config: TrainConfig) -> Encounter | None:
    """Return the encounters of its own that a training practises, float32 ``[M]``; None where there are none.

    Raises:
        ConfigError: the file cannot be used, or one of them begins too close or has noisy or late reports.
    """
    if config.practice.encounters is None:
        return None
    try:
        starts, names = encounter_file.read(config.practice.encounters, config.world.limits())
    except EncounterError as problem:
        raise ConfigError(f"practice.encounters: {problem}") from None
    noisy = (starts.sensor.position_std > 0.0) | (starts.sensor.velocity_std > 0.0)
    for unfit, what in (
        (_closest(starts, np) < config.world.separation, f"begins closer than {config.world.separation:g} m"),
        (noisy[:, 0], "has noisy reports, expected perfect ones"),
        (starts.sensor.latency[:, 0] > 0.0, "has reports that come late, expected perfect ones"),
    ):
        if unfit.any():
            name = names[int(np.argmax(unfit))]
            raise ConfigError(f"practice.encounters: encounter {name!r} of {config.practice.encounters} {what}")
    return cast(starts, np.float32)


def edges(config: TrainConfig) -> Encounter | None:
    """Return encounters in which little is left to lose, float32 ``[M]``; None where none are asked for.

    They are the same for every run of a seed.

    Raises:
        ConfigError: there are hardly any for this separation and edge.
    """
    practice, separation = config.practice, config.world.separation
    what = f"practice.edge is {practice.edge:g} m with world.separation {separation:g} m"
    random = np.random.default_rng(config.seed)
    return _near_the_limit(practice.edges, _little(practice.edge), _EDGES, separation, random, what, 1e-4)


def anywhere(config: TrainConfig) -> Encounter | None:
    """Return encounters on any course in which little is left to lose, float32 ``[M]``; None where none are asked for.

    Where turns to either side are as good little is :data:`EARLIER` times as much. They are the same for every run of
    a seed.

    Raises:
        ConfigError: there are hardly any for this separation.
    """
    practice, separation = config.practice, config.world.separation
    little = _little(practice.leave)

    def chosen(spare: np.ndarray, starts: Encounter) -> np.ndarray:
        found = little(spare, starts)
        some = np.flatnonzero(_little(EARLIER * practice.leave)(spare, starts) & ~found)
        at = mapped(lambda field: field[some], starts)
        kept = each(at.own, at.goal_x, at.goal_y, at.intruders, at.mask, np)
        left, right = (reduce(np.maximum, kept[side : side + 3]) for side in (0, 3))
        found[some] = undecided(left, right, np) > 0.0
        return found

    what = f"practice.leave is {practice.leave:g} m with world.separation {separation:g} m"
    random = np.random.default_rng((config.seed, 2))
    return _near_the_limit(practice.anywhere, chosen, _ANYWHERE, separation, random, what, 1e-4)


def _little(most: float) -> Callable[[np.ndarray, Encounter], np.ndarray]:
    """Return which encounters have something, but no more than so many metres, to lose."""

    def chosen(spare: np.ndarray, _: Encounter) -> np.ndarray:
        return (spare > 0.0) & (spare <= most)

    return chosen


def intricate(config: TrainConfig) -> Encounter | None:
    """Return encounters that no simple manoeuvre resolves but one after another does, float32 ``[M]``; or None.

    They are the same for every run of a seed.

    Raises:
        ConfigError: there are hardly any for this separation.
    """
    practice, separation = config.practice, config.world.separation

    def resolvable(spare: np.ndarray, starts: Encounter) -> np.ndarray:
        chosen = np.zeros(spare.shape, dtype=bool)
        short = np.flatnonzero((spare > -_SHORT) & (spare <= 0.0))
        # As many each time, so that it is compiled once.
        for first in range(0, short.size, _FLOWN):
            some = short[np.arange(first, first + _FLOWN) % short.size]
            at = cast(mapped(lambda field, some=some: field[some], starts), np.float32)
            kept = one_by_one(at.own, at.goal_x, at.goal_y, at.intruders, at.mask, _SECONDS)
            chosen[some] = np.asarray(kept) >= separation
        return chosen

    what = f"practice.intricate is {practice.intricate} with world.separation {separation:g} m"
    random = np.random.default_rng((config.seed, 1))
    return _near_the_limit(practice.intricate, resolvable, _EDGES, separation, random, what, 1e-5)


def _near_the_limit(
    wanted: int,
    chosen: Callable[[np.ndarray, Encounter], np.ndarray],
    families: tuple[Scenario, ...],
    separation: float,
    random: np.random.Generator,
    what: str,
    rarest: float,
) -> Encounter | None:
    """Return so many encounters of some families, float32 ``[wanted]``; None of 0.

    Args:
        wanted: how many.
        chosen: (what the best manoeuvre keeps beyond the separation, m, infinite where an encounter is none, ``[N]``,
            encounters ``[N]``) -> which, ``[N]``.
        families: drawn from in turn, as many of each.
        separation: m.
        random: what they are drawn with.
        what: is asked for, in words.
        rarest: share of those drawn that must be such.

    Raises:
        ConfigError: fewer are.
    """
    found: list[Encounter] = []
    have = drawn = 0
    while have < wanted:
        family = families[len(found) % len(families)]
        starts, accepted = sample(family, random.random((1, _BLOCK, family.dimensions)), np)
        spare = best(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, np) - separation
        rows = np.flatnonzero(chosen(np.where(accepted, spare, np.inf), starts))
        found.append(mapped(lambda field, rows=rows: field[rows], starts))
        have, drawn = have + rows.size, drawn + _BLOCK
        if rarest * drawn >= _ENOUGH and have < rarest * drawn:
            raise ConfigError(f"{what}: {have} of {drawn} encounters are such, expected {rarest * drawn:.0f} at least")
    if not wanted:
        return None
    together = reduce(joined, found)
    return cast(mapped(lambda field: field[:wanted], together), np.float32)


def draw(key: jax.Array, config: TrainConfig, scenarios: list[Scenario], rows: int, own: Own) -> surrogate.State:
    """Return encounters at their start, ``[rows, environments]``.

    Args:
        key: of the draw.
        config: of the training.
        scenarios: those of the configuration.
        rows: encounters of each environment.
        own: encounters that are practised besides.
    """
    total = sum(entry.weight for entry in config.scenarios)
    weights = [entry.weight / total for entry in config.scenarios]
    count = config.ppo.environments
    pool = surrogate.redraw_pool(key, scenarios, weights, rows, count)
    practice = config.practice
    kinds = (
        (own.file, practice.share, practice.displacement),
        (own.edges, practice.edge_share, 0.0),
        (own.intricate, practice.intricate_share, 0.0),
        (own.anywhere, practice.anywhere_share, 0.0),
    )
    for number, (starts, share, reach) in enumerate(kinds, start=len(scenarios)):
        if starts is not None:
            pool = _mixed(jax.random.fold_in(key, number), pool, starts, share, reach, config.world.separation)
    demanded = asked(pool, config.world)
    # The axis of the rows is mapped over; None, where all are judged alike, has none.
    return jax.vmap(lambda row, by: surrogate.reset(row, late_reports=late(scenarios), required_separation=by))(
        pool, demanded
    )


def _mixed(key: jax.Array, pool: Encounter, own: Encounter, share: float, reach: float, separation: float) -> Encounter:
    """Return the pool ``[rows, N]`` with a share of it replaced by encounters of one's own."""
    share_key, pick_key, move_key = jax.random.split(key, 3)
    rows, count = pool.goal_x.shape
    most = max(pool.mask.shape[-1], own.mask.shape[-1])
    number = jax.random.randint(pick_key, (rows * count,), 0, own.goal_x.shape[0])
    picked = padded(jax.tree.map(lambda field: jnp.asarray(field)[number], own), most, jnp)
    if reach:
        picked = displaced(move_key, picked, reach, separation)
    flat = jax.tree.map(lambda field: field.reshape(rows * count, *field.shape[2:]), pool)
    chosen = jax.random.uniform(share_key, (rows * count,)) < share
    mixed = choose(chosen, picked, padded(flat, most, jnp), jnp)
    return jax.tree.map(lambda field: field.reshape(rows, count, *field.shape[1:]), mixed)


def displaced(key: jax.Array, starts: Encounter, reach: float, separation: float) -> Encounter:
    """Return encounters ``[N]`` with their aircraft moved by up to ``reach`` m in x and y; who came too close stays."""
    own, other = starts.own, starts.intruders
    moves = jax.random.uniform(key, (2, *other.x.shape[:-1], 1 + other.x.shape[-1]), minval=-reach, maxval=reach)
    moved = starts._replace(
        own=own._replace(x=own.x + moves[0, :, 0], y=own.y + moves[1, :, 0]),
        intruders=other._replace(x=other.x + moves[0, :, 1:], y=other.y + moves[1, :, 1:]),
    )
    return choose(_closest(moved, jnp) >= separation, moved, starts, jnp)


def _closest(starts: Encounter, xp: Any) -> Any:
    """Return the distance from each ownship to the nearest intruder at the start, m, ``[...]``."""
    other = starts.intruders
    apart = distance(other.x - starts.own.x[..., None], other.y - starts.own.y[..., None], xp)
    return xp.min(xp.where(starts.mask, apart, xp.inf), axis=-1)


def asked(starts: Encounter, world: WorldConfig) -> jax.Array | None:
    """Return the separation that encounters ``[rows, N]`` are asked for, m; None where it is that of the rules.

    Args:
        starts: a column is flown by the same environment.
        world: of the training.
    """
    if world.separation_spread == 0.0:
        return None
    rows, environments = starts.goal_x.shape
    demanded = jnp.broadcast_to(jnp.asarray(world.demanded(environments)), (rows, environments))
    if world.separation_headroom is None:
        return demanded
    kept = best(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, jnp)
    spare = jnp.maximum(kept - (world.separation + world.separation_headroom), 0.0)
    return jnp.minimum(demanded, world.separation + spare)


def noisy(scenarios: list[Scenario]) -> bool:
    """Return whether reports are noisy or come late in any of the scenarios."""
    return late(scenarios) or any(s.position_std > 0.0 or s.velocity_std > 0.0 for s in scenarios)


def late(scenarios: list[Scenario]) -> bool:
    """Return whether reports come late in any of the scenarios."""
    return any(scenario.latency[1] > 0.0 for scenario in scenarios)
