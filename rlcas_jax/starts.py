"""The starts that a training draws: its mixture of encounters, and what separation each is asked for."""

import jax
import jax.numpy as jnp

from envs import surrogate
from envs.encounters import Encounter, Scenario
from envs.relative import distance
from rlcas_jax.config import TrainConfig, WorldConfig

__all__ = ["asked", "draw", "late"]


def draw(key: jax.Array, config: TrainConfig, scenarios: list[Scenario], rows: int) -> surrogate.State:
    """Return encounters at their start, ``[rows, environments]``.

    Args:
        key: of the draw.
        config: of the training.
        scenarios: those of the configuration.
        rows: encounters of each environment.
    """
    total = sum(entry.weight for entry in config.scenarios)
    weights = [entry.weight / total for entry in config.scenarios]
    pool = surrogate.redraw_pool(key, scenarios, weights, rows, config.ppo.environments)
    demanded = asked(pool, config.world)
    # The axis of the rows is mapped over; None, where all are judged alike, has none.
    return jax.vmap(lambda row, by: surrogate.reset(row, late_reports=late(scenarios), demanded=by))(pool, demanded)


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
    other = starts.intruders
    apart = distance(other.x - starts.own.x[..., None], other.y - starts.own.y[..., None], jnp)
    begins = jnp.min(jnp.where(starts.mask, apart, jnp.inf), axis=-1)
    spare = jnp.maximum(begins - (world.separation + world.separation_headroom), 0.0)
    return jnp.minimum(demanded, world.separation + spare)


def late(scenarios: list[Scenario]) -> bool:
    """Return whether reports come late in any of the scenarios."""
    return any(scenario.latency[1] > 0.0 for scenario in scenarios)
