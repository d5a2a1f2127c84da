"""The surrogate environment in JAX: thousands of encounters advance in one compiled, batched step.

The update is :func:`envs.world.step`. Encounters that end start anew from a pool of pre-sampled
starts that the caller redraws; a row of the pool is used per step, so that a reset costs no random
access.
"""

from functools import partial

import jax
import jax.numpy as jnp

from envs import world
from envs.aircraft import Aircraft
from envs.encounters import Encounter, Scenario, pad
from envs.perception import EVERYTHING
from envs.reaction import NONE
from envs.scenarios import sample
from envs.trees import choose
from envs.world import State, StepResult, World

__all__ = [
    "State",
    "StepResult",
    "World",
    "observe",
    "observe_set",
    "redraw_pool",
    "reset",
    "restart",
    "step",
]

reset = partial(world.begin, xp=jnp)
step = partial(world.step, xp=jnp)
observe = partial(world.observe, xp=jnp)
observe_set = partial(world.observe_set, xp=jnp)


def restart(state: State, fresh: State) -> State:
    """Return the encounters ``[N]`` with a fresh one in place of each that has ended.

    Called at the beginning of a loop's body, where ``ended`` is an input, it costs one choice per
    field; at its end the compiler would evaluate the whole step again for every field that is
    chosen.
    """
    return choose(state.ended, fresh, state, jnp)


def redraw_pool(
    key: jax.Array, scenarios: list[Scenario], weights: list[float], rows: int, count: int
) -> Encounter:
    """Sample a pool of starts, ``[rows, count]``, from a mixture of scenarios by their
    probabilities.

    Encounters of scenarios with fewer intruders than others are filled up with some that do not
    exist. A row is used per step.
    """
    total = rows * count
    columns = max(scenario.intruders[1] for scenario in scenarios)
    choice_key, draws_key = jax.random.split(key)
    choice = jax.random.uniform(choice_key, (total,))
    # One scenario of each start is chosen, so that all may share its draws.
    dimensions = max(scenario.dimensions for scenario in scenarios)
    draws = jax.random.uniform(draws_key, (1, total, dimensions))
    parts = []
    for scenario in scenarios:
        drawn, accepted = sample(scenario, draws[..., : scenario.dimensions], jnp)
        parts.append(pad(_accepted_only(drawn, accepted), columns, jnp))
    mixed: Encounter | None = None
    threshold = 0.0
    for drawn, weight in zip(_alike(parts, scenarios[0].aircraft), weights, strict=True):
        mixed = drawn if mixed is None else choose(choice < threshold, mixed, drawn, jnp)
        threshold += weight
    return jax.tree.map(lambda field: field.reshape(rows, count, *field.shape[1:]), mixed)


def _alike(parts: list[Encounter], aircraft: Aircraft) -> list[Encounter]:
    """Return encounters ``[N]`` with K intruders each with the same optional fields: what some of
    them have, the others have with its usual values.
    """
    usual = {"coverage": EVERYTHING, "separation": aircraft.separation, "reaction": NONE}
    names = [name for name in usual if any(getattr(part, name) is not None for part in parts)]

    def fill(encounter: Encounter) -> Encounter:
        place = encounter.intruders.x
        missing = {name: usual[name] for name in names if getattr(encounter, name) is None}
        values = jax.tree.map(lambda value: jnp.full_like(place, value), missing)
        return encounter._replace(**values)

    return [fill(part) for part in parts]


def _accepted_only(drawn: Encounter, accepted: jax.Array) -> Encounter:
    """Replace encounters ``[N]`` that do not meet their conditions by the nearest one before that
    does.

    A pool may hold a start twice, but never one outside the scenario; redrawing each until it is
    accepted would cost several times the random numbers.
    """
    index = jnp.arange(accepted.shape[0])
    latest = jax.lax.cummax(jnp.where(accepted, index, -1))
    source = jnp.where(latest >= 0, latest, jnp.argmax(accepted))
    return jax.tree.map(lambda field: field[source], drawn)
