"""The starts that a training draws: its mixture of encounters, and the separation that each requires."""

import math
from functools import lru_cache, reduce

import jax
import jax.numpy as jnp
import numpy as np

from agents.config.load import ConfigError
from envs import surrogate
from envs.aircraft import Aircraft
from envs.encounters import Encounter, Scenario, choose, padded, sample, scenario
from envs.starts import cast, joined
from envs.trees import mapped
from rlcas_jax.config import TrainConfig
from rlcas_jax.escape_margin import best
from rlcas_jax.fleet import fleet, of_fleet

__all__ = ["NEAR_LIMIT", "draw", "late", "near_limit", "noisy", "required_separation"]

NEAR_LIMIT = 20_000
"""Near-limit starts of a training."""

_BLOCK = 50_000
"""Encounters drawn at a time when near-limit starts are looked for."""

_RAREST, _ENOUGH = 1e-4, 5.0
"""The search for near-limit starts ends with an error when their share is below the first, and so many were to be
expected by then."""

_COURSES = (-math.radians(60.0), math.radians(60.0))
"""Converging courses, where near-limit starts are not rare."""


def near_limit(config: TrainConfig) -> Encounter | None:
    """Return near-limit starts, float32 ``[M]``, the same for every run of a seed; None where none are asked for.

    Raises:
        ConfigError: there are hardly any for this separation and margin.
    """
    if not config.near_limit.share:
        return None
    return _near_limit(config.seed, config.near_limit.margin, config.aircraft.aircraft())


@lru_cache(maxsize=2)
def _near_limit(seed: int, margin: float, aircraft: Aircraft) -> Encounter:
    """Return them; the phases of a training share them."""
    separation = aircraft.separation
    families = (
        scenario("same_course", aircraft, attempts=1),
        scenario("circle", aircraft, attempts=1, course_difference=_COURSES),
    )
    random = np.random.default_rng(seed)
    found: list[Encounter] = []
    have = drawn = 0
    while have < NEAR_LIMIT:
        family = families[len(found) % len(families)]
        starts, accepted = sample(family, random.random((1, _BLOCK, family.dimensions)), np)
        spare = best(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, np) - separation
        rows = np.flatnonzero(accepted & (spare > 0.0) & (spare <= margin * separation))
        found.append(mapped(lambda field, rows=rows: field[rows], starts))
        have, drawn = have + rows.size, drawn + _BLOCK
        expected = _RAREST * drawn
        if expected >= _ENOUGH and have < expected:
            raise ConfigError(
                f"near_limit.margin is {margin:g} of the separation, {separation:g} m: {have} of {drawn} encounters "
                f"are such, expected {expected:.0f} at least"
            )
    together = reduce(joined, found)
    return cast(mapped(lambda field: field[:NEAR_LIMIT], together), np.float32)


def draw(
    key: jax.Array,
    config: TrainConfig,
    scenarios: list[Scenario],
    rows: int,
    hard: Encounter | None = None,
) -> surrogate.State:
    """Return encounters at their start, ``[rows, environments]``.

    Args:
        key: of the draw.
        config: of the training.
        scenarios: those of the configuration.
        rows: encounters of each environment.
        hard: near-limit starts ``[M]``, which replace a share of the scenarios'.
    """
    total = sum(entry.weight for entry in config.scenarios)
    weights = [entry.weight / total for entry in config.scenarios]
    flown_by = fleet(config)
    families = of_fleet(scenarios, flown_by, config, rows)
    pool = surrogate.redraw_pool(key, families, weights, rows, config.ppo.environments)
    if flown_by.other.any():
        # A start that took another's place may be of another aircraft.
        limits = flown_by.limits
        flyable = jnp.clip(pool.own.speed, limits.speed_min, limits.speed_max)
        pool = pool._replace(own=pool.own._replace(speed=flyable))
    if hard is not None:
        pool = _mixed(jax.random.fold_in(key, len(scenarios)), pool, hard, config.near_limit.share)
    aircraft = config.aircraft.aircraft()
    required, history_dt = required_separation(pool, config), aircraft.dt if late(scenarios) else None
    # The axis of the rows is mapped over; None, where the rules' separation holds for all, has none.
    return jax.vmap(lambda row, by: surrogate.reset(row, history_dt=history_dt, required_separation=by))(pool, required)


def _mixed(key: jax.Array, pool: Encounter, hard: Encounter, share: float) -> Encounter:
    """Return the pool ``[rows, N]`` with a share of it replaced by near-limit starts."""
    share_key, pick_key = jax.random.split(key)
    rows, count = pool.goal_x.shape
    most = max(pool.mask.shape[-1], hard.mask.shape[-1])
    number = jax.random.randint(pick_key, (rows * count,), 0, hard.goal_x.shape[0])
    picked = padded(jax.tree.map(lambda field: jnp.asarray(field)[number], hard), most, jnp)
    flat = jax.tree.map(lambda field: field.reshape(rows * count, *field.shape[2:]), pool)
    chosen = jax.random.uniform(share_key, (rows * count,)) < share
    mixed = choose(chosen, picked, padded(flat, most, jnp), jnp)
    return jax.tree.map(lambda field: field.reshape(rows, count, *field.shape[1:]), mixed)


def required_separation(starts: Encounter, config: TrainConfig) -> jax.Array | None:
    """Return the separation that encounters ``[rows, N]`` require, m; None where it is that of the rules.

    Args:
        starts: a column is flown by the same environment.
        config: of the training.
    """
    world, separation = config.world, config.aircraft.separation_m
    if world.separation_spread == 0.0:
        return None
    rows, environments = starts.goal_x.shape
    required = jnp.broadcast_to(jnp.asarray(world.required_separation(environments, separation)), (rows, environments))
    if world.separation_headroom is None:
        return required
    kept = best(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, jnp)
    spare = jnp.maximum(kept - (separation + world.separation_headroom * separation), 0.0)
    return jnp.minimum(required, separation + spare)


def noisy(scenarios: list[Scenario]) -> bool:
    """Return whether reports are noisy or come late in any of the scenarios."""
    return late(scenarios) or any(s.position_std > 0.0 or s.velocity_std > 0.0 for s in scenarios)


def late(scenarios: list[Scenario]) -> bool:
    """Return whether reports come late in any of the scenarios."""
    return any(scenario.latency[1] > 0.0 for scenario in scenarios)
