"""The surrogate environment in JAX: thousands of encounters advance in one compiled, batched step.

Algorithm 1 of the paper, in its order: intruder controller and motion, ownship control and motion, then
conflict, termination, score. Encounters that end start anew from a pool of pre-sampled starts that the caller
redraws; a row of the pool is used per step, so that a reset costs no random access.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from envs import encounters, intruder, observation, outcome
from envs.encounters import Encounter, Scenario
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.outcome import Outcome, Rules
from envs.perception import Sensor, carried_back, perceive
from envs.relative import distance, leg_separation

__all__ = ["State", "StepResult", "World", "observe", "redraw_pool", "reset", "restart", "step", "step_autoreset"]


class World(NamedTuple):
    """Parameters of the surrogate, all of them data."""

    rules: Rules
    limits: Limits
    """Of the ownship."""


class State(NamedTuple):
    """Encounters in progress; fields ``[N]``, those of intruders ``[N, K]``."""

    own: VehicleState
    goal_x: jax.Array
    goal_y: jax.Array
    intruders: intruder.IntruderState
    mask: jax.Array
    intent: intruder.Intent
    sensor: Sensor
    previous: tuple[VehicleState, VehicleState] | None
    """Intruders one and two steps ago, kept only where reports are late."""
    time: jax.Array
    """s since the start of each encounter."""
    ended: jax.Array
    """Whether the encounter's last step has been taken, bool."""
    demanded: jax.Array | None = None
    """Separation by which each encounter is judged, m; None: that of the rules."""


class StepResult(NamedTuple):
    """What a step yields; fields ``[N]``."""

    outcome: Outcome
    reward: jax.Array
    separation: jax.Array
    """Smallest distance to any intruder during the step, m."""
    goal_distance: jax.Array
    """At the end of the step, m."""


def reset(encounter: Encounter, *, late_reports: bool = False, demanded: jax.Array | None = None) -> State:
    """Begin encounters ``[N]``.

    Args:
        encounter: the starts.
        late_reports: keep the history of the intruders that reports with latency need.
        demanded: separation by which each is judged instead of the rules', m, ``[N]``.
    """
    flown = intruder.start(encounter.intruders, jnp)
    previous = None
    if late_reports:
        # The rules' time step is 1 s wherever reports are late; see perception.perceive.
        previous = (carried_back(encounter.intruders, 1.0, jnp), carried_back(encounter.intruders, 2.0, jnp))
    return State(
        encounter.own,
        encounter.goal_x,
        encounter.goal_y,
        flown,
        encounter.mask,
        encounter.intent,
        encounter.sensor,
        previous,
        jnp.zeros_like(encounter.goal_x),
        jnp.zeros(jnp.shape(encounter.goal_x), bool),
        demanded,
    )


def observe(state: State, noise: jax.Array | None = None) -> jax.Array:
    """Return the observation of the most critical intruder, ``[N, 8]``.

    Args:
        state: ``[N]``.
        noise: standard normal draws ``[4, N, K]`` of the reports; None for perfect knowledge.
    """
    seen = state.intruders.vehicle
    if noise is not None:
        before = state.previous if state.previous is not None else (seen, seen)
        seen = perceive(seen, *before, state.sensor, noise, 1.0, jnp)
    chosen = observation.most_critical(state.own, seen, state.mask, observation.CRITICAL_RADIUS, jnp)
    return observation.observe(state.own, chosen, state.goal_x, state.goal_y, jnp)


def step(state: State, action: tuple[jax.Array, jax.Array], world: World) -> tuple[State, StepResult]:
    """Advance every encounter by one time step, without any reset.

    Args:
        state: ``[N]``.
        action: acceleration and yaw rate as fractions of the limits, ``[N]`` each, clipped to [-1, 1].
        world: parameters.
    """
    rules = world.rules
    if state.demanded is not None:
        rules = rules._replace(separation=state.demanded)
    dt = rules.dt
    traffic = intruder.step(state.intruders, state.intent, state.time[:, None], dt, jnp)
    acceleration, yaw_rate = commands(action, world.limits, jnp)
    own = advance(state.own, acceleration, yaw_rate, dt, world.limits, jnp)

    def columns(vehicle: VehicleState) -> VehicleState:
        return VehicleState(*(field[:, None] for field in vehicle))

    separations = leg_separation(columns(state.own), columns(own), state.intruders.vehicle, traffic.vehicle, dt, jnp)
    separation = jnp.min(jnp.where(state.mask, separations, jnp.inf), axis=-1)
    goal_distance = distance(state.goal_x - own.x, state.goal_y - own.y, jnp)
    time = state.time + dt
    judged = outcome.judge(separation, goal_distance, time, rules, jnp)
    previous = None if state.previous is None else (state.intruders.vehicle, state.previous[0])
    moved = state._replace(own=own, intruders=traffic, previous=previous, time=time, ended=judged.ended(jnp))
    return moved, StepResult(judged, outcome.reward(judged, rules, jnp), separation, goal_distance)


def restart(state: State, fresh: State) -> State:
    """Return the encounters ``[N]`` with a fresh one in place of each that has ended.

    Called at the beginning of a loop's body, where ``ended`` is an input, it costs one choice per field; at its end
    the compiler would evaluate the whole step again for every field that is chosen.
    """

    def select(new: jax.Array, old: jax.Array) -> jax.Array:
        return jnp.where(state.ended.reshape(state.ended.shape + (1,) * (old.ndim - 1)), new, old)

    return jax.tree.map(select, fresh, state)


def step_autoreset(
    state: State, action: tuple[jax.Array, jax.Array], fresh: State, world: World
) -> tuple[State, State, StepResult]:
    """Advance every encounter and begin a fresh one wherever one has ended, in the same step.

    Args:
        state: ``[N]``.
        action: as in :func:`step`.
        fresh: states to begin with, ``[N]``, used where an encounter ends.
        world: parameters.

    Returns:
        The state to go on with, the state at the end of the step (the final one of encounters that ended), and
        the result of the step.
    """
    final, result = step(state, action, world)
    return restart(final, fresh), final, result


def redraw_pool(key: jax.Array, scenarios: list[Scenario], weights: list[float], rows: int, count: int) -> Encounter:
    """Sample a pool of starts from a mixture of scenarios, ``[rows, count]``.

    Args:
        key: of the draw.
        scenarios: the mixture's components; those with fewer intruders get absent ones.
        weights: their probabilities, summing to 1.
        rows: rows of the pool, one used per step.
        count: encounters a row.
    """
    total = rows * count
    most = max(scenario.intruders[1] for scenario in scenarios)
    keys = jax.random.split(key, len(scenarios) + 1)
    choice = jax.random.uniform(keys[0], (total,))
    mixed: Any = None
    threshold = 0.0
    for scenario, weight, component_key in zip(scenarios, weights, keys[1:], strict=True):
        draws = jax.random.uniform(component_key, (1, total, scenario.dimensions))
        drawn, accepted = encounters.sample(scenario, draws, jnp)
        drawn = encounters.padded(_accepted_only(drawn, accepted), most, jnp)
        mixed = drawn if mixed is None else encounters.choose(choice < threshold, mixed, drawn, jnp)
        threshold += weight
    return jax.tree.map(lambda field: field.reshape(rows, count, *field.shape[1:]), mixed)


def _accepted_only(drawn: Encounter, accepted: jax.Array) -> Encounter:
    """Replace encounters ``[N]`` that do not meet their conditions by the nearest one before that does.

    A pool may hold a start twice, but never one outside the scenario; redrawing each until it is accepted would
    cost several times the random numbers.
    """
    index = jnp.arange(accepted.shape[0])
    latest = jax.lax.cummax(jnp.where(accepted, index, -1))
    source = jnp.where(latest >= 0, latest, jnp.argmax(accepted))
    return jax.tree.map(lambda field: field[source], drawn)
