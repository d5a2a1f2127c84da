"""The starts that a training draws: its mixture of encounters, and the separation that each requires."""

import jax
import jax.numpy as jnp

from envs import surrogate
from envs.encounters import Encounter, Scenario
from rlcas_jax.config import TrainConfig
from rlcas_jax.fleet import fleet, of_fleet


def draw(
    key: jax.Array,
    config: TrainConfig,
    scenarios: list[Scenario],
    rows: int,
) -> surrogate.State:
    """Return encounters at their start, ``[rows, environments]``.

    Args:
        scenarios: those of the configuration.
        rows: encounters of each environment.
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
    aircraft = config.aircraft.aircraft()
    required, history_dt = required_separation(pool, config), aircraft.dt if late(scenarios) else None
    # The axis of the rows is mapped over; None, where the rules' separation holds for all, has none.
    return jax.vmap(lambda row, by: surrogate.reset(row, history_dt=history_dt, required_separation=by))(pool, required)


def required_separation(starts: Encounter, config: TrainConfig) -> jax.Array | None:
    """Return the separation that encounters ``[rows, N]`` require, m; None where it is that of the rules.

    Args:
        starts: a column is flown by the same environment.
    """
    world, separation = config.world, config.aircraft.separation_m
    if world.separation_spread == 0.0:
        return None
    rows, environments = starts.goal_x.shape
    return jnp.broadcast_to(jnp.asarray(world.required_separation(environments, separation)), (rows, environments))


def noisy(scenarios: list[Scenario]) -> bool:
    """Return whether reports are noisy or come late in any of the scenarios."""
    return late(scenarios) or any(s.position_std > 0.0 or s.velocity_std > 0.0 for s in scenarios)


def late(scenarios: list[Scenario]) -> bool:
    """Return whether reports come late in any of the scenarios."""
    return any(scenario.latency[1] > 0.0 for scenario in scenarios)
