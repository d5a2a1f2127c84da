"""The starts that a training draws: its mixture of encounters, and the separation that each
requires.
"""

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from envs import surrogate
from envs.encounters import Scenario
from rlcas_jax.config import TrainConfig
from rlcas_jax.ownships import ownships, scenarios_for


def draw(
    key: PRNGKeyArray, config: TrainConfig, scenarios: list[Scenario], rows: int
) -> surrogate.State:
    """Return encounters of a configuration's scenarios at their start, ``[rows, environments]``."""
    total = sum(entry.weight for entry in config.scenarios)
    weights = [entry.weight / total for entry in config.scenarios]
    flying, count = ownships(config), config.environments
    fitting = scenarios_for(flying, scenarios, config, rows)
    pool = surrogate.redraw_pool(key, fitting, weights, rows, count)
    if flying.of_family.any():
        # A start that took another's place may be of another aircraft.
        limits = flying.limits
        flyable = jnp.clip(pool.own.speed, limits.speed_min, limits.speed_max)
        pool = pool._replace(own=pool.own._replace(speed=flyable))
    required = None  # that of the rules
    if config.world.separation_spread > 0.0:
        # A column is flown by the same environment.
        by = config.world.required_separation(count, config.aircraft.separation_m)
        required = jnp.broadcast_to(jnp.asarray(by), (rows, count))
    history_dt = config.aircraft.aircraft().dt if late(scenarios) else None
    # The axis of the rows is mapped over; None has none.
    return jax.vmap(
        lambda row, by: surrogate.reset(row, history_dt=history_dt, required_separation=by)
    )(pool, required)


def noisy(scenarios: list[Scenario]) -> bool:
    """Return whether reports are noisy or come late in any of the scenarios."""
    return late(scenarios) or any(s.position_std > 0.0 or s.velocity_std > 0.0 for s in scenarios)


def late(scenarios: list[Scenario]) -> bool:
    """Return whether reports come late in any of the scenarios."""
    return any(scenario.latency[1] > 0.0 for scenario in scenarios)
