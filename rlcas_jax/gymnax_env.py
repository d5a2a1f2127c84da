# pyright: reportMissingImports=false, reportIncompatibleMethodOverride=false
"""The surrogate under gymnax's interface; importing this module registers it
(docs/howto/gymnasium.md).

Everything is a pure function of keys, state and parameters, so that a learner compiles the
environment with itself.
"""

from collections.abc import Mapping
from typing import Any

import gymnax
import jax
import jax.numpy as jnp
from flax import struct
from gymnax.environments import spaces
from gymnax.environments.environment import Environment
from gymnax.environments.environment import EnvParams as AnyParams
from gymnax.environments.environment import EnvState as AnyState

from envs import scenarios, surrogate
from envs.aircraft import PAPER, Aircraft
from envs.encounters import MOST_INTRUDERS, Encounter, EncounterError, Scenario
from envs.observation import ROW, SIZE
from envs.rewards import Transition, learning_reward, table, with_scores

ENV_ID = "rlcas/Deconfliction-v0"


@struct.dataclass
class EnvState(AnyState):
    """An encounter in progress; ``time`` counts its steps."""

    encounter: surrogate.State


@struct.dataclass(kw_only=True)
class EnvParams(AnyParams):
    """Parameters, all of them data: the ownship may differ from environment to environment of a
    batch.
    """

    aircraft: Aircraft
    """The ownship and its task; its time limit is ``max_steps_in_episode`` time steps."""


class Deconfliction(Environment[EnvState, EnvParams]):
    """One encounter: rejoin the route and keep the required separation from every intruder.

    Observation, action and reward are those of :class:`envs.gym.gymnasium_env.DeconflictionEnv`:
    float32 ``[8]`` of the most critical intruder, or with K > 1 intruders a dict of ``own``
    ``[4]``, ``traffic`` ``[K, 4]`` and ``mask`` ``[K]``; float32 ``[2]`` in [-1, 1], acceleration
    and yaw rate as parts of the limits; -100 at a loss of separation, +100 at the goal, -10 at the
    time limit, else 0, or the points of ``rewards``. ``terminated`` at a loss of separation and at
    the goal; the time limit truncates.
    ``info``: ``separation`` (smallest in the step, m), ``goal_distance`` (m), ``violation`` and
    ``reached``.

    Args:
        scenario: name, ``module:name`` of your own, or Scenario; encounters are drawn from it.
        aircraft: the ownship that scales scenario and default parameters; None: the scenario's, or
            the paper's.
        intruders: K that an observation shows.
        rewards: weights in points by the names of terms, ``module:name`` of your own
            (:mod:`envs.rewards`); None: the task's alone.
        discount: of potentials among them, per time step.

    Raises:
        EncounterError: the scenario or the number of intruders is impossible.
    """

    name: str = ENV_ID
    num_actions: int = 2

    def __init__(
        self,
        scenario: str | Scenario = "circle",
        aircraft: Aircraft | None = None,
        intruders: int = 1,
        rewards: Mapping[str, float] | None = None,
        discount: float = 1.0,
    ) -> None:
        if not 1 <= intruders <= MOST_INTRUDERS:
            raise EncounterError(
                f"intruders is {intruders}; expected a whole number from 1 to {MOST_INTRUDERS}"
            )
        if isinstance(scenario, str):
            scenarios.resolve(scenario)
            scenario = scenarios.scenario(scenario, aircraft or PAPER)
        elif aircraft not in (None, scenario.aircraft):
            raise EncounterError(
                f"scenario {scenario.name!r} is another aircraft's; expected one of the given "
                "aircraft"
            )
        self.scenario, self.intruders = scenario, intruders
        self.weights, self.rewards, self.discount = rewards or {}, table(rewards or {}), discount

    @property
    def default_params(self) -> EnvParams:
        """The scenario's aircraft and its time limit."""
        aircraft = self.scenario.aircraft
        return EnvParams(
            max_steps_in_episode=round(aircraft.t_max / aircraft.dt), aircraft=aircraft
        )

    def reset_env(self, key: jax.Array, params: EnvParams) -> tuple[Any, EnvState]:
        """Draw an encounter and begin it."""
        key_start, key_seen = jax.random.split(key)
        draws = jax.random.uniform(key_start, (1, self.scenario.attempts, self.scenario.dimensions))
        drawn, accepted = scenarios.sample(self.scenario, draws, jnp)
        start = jax.tree.map(lambda field: field[jnp.argmax(accepted)], drawn)
        # The ownship may be slower than the one that the scenario was made for.
        limits = params.aircraft.limits
        speed = jnp.clip(start.own.speed, limits.speed_min, limits.speed_max)
        return self.begin(key_seen, start._replace(own=start.own._replace(speed=speed)), params)

    def begin(
        self, key: jax.Array, encounter: Encounter, params: EnvParams
    ) -> tuple[Any, EnvState]:
        """Begin a given encounter, fields ``[]`` and of intruders ``[K]``; the key is that of the
        reports' noise.
        """
        history_dt = params.aircraft.dt if self.scenario.latency[1] > 0.0 else None
        state = EnvState(
            time=jnp.int32(0), encounter=surrogate.reset(encounter, history_dt=history_dt)
        )
        return self.observe(key, state, None, params), state

    def step_env(
        self, key: jax.Array, state: EnvState, action: Any, params: EnvParams
    ) -> tuple[Any, EnvState, jax.Array, jax.Array, dict[Any, Any]]:
        """Advance by one time step, without a reset."""
        aircraft = params.aircraft
        rules = aircraft.rules()._replace(t_max=params.max_steps_in_episode * aircraft.dt)
        world = surrogate.World(with_scores(rules, self.weights), aircraft)
        before, command = state.encounter, (action[0], action[1])
        moved, result = surrogate.step(before, command, world)
        transition = Transition(before, moved, command, result, aircraft)
        reward, _ = learning_reward(self.rewards, transition, self.discount, jnp)
        state = EnvState(time=state.time + 1, encounter=moved)
        violation, reached, _ = result.outcome
        info = {"separation": result.separation, "goal_distance": result.goal_distance}
        info |= {"violation": violation, "reached": reached}
        return (
            self.observe(key, state, action, params),
            state,
            jnp.asarray(reward, jnp.float32),
            violation | reached,
            info,
        )

    def observe(self, key: jax.Array, state: EnvState, action: Any, params: EnvParams) -> Any:
        """Return what the scenario's sensor reports: ``[8]``, or a dict for several intruders."""
        seen_by, mine = params.aircraft, self.scenario
        noisy = max(mine.position_std, mine.velocity_std, mine.latency[1]) > 0.0
        noise = jax.random.normal(key, (4, *state.encounter.mask.shape)) if noisy else None
        if self.intruders == 1:
            return surrogate.observe(state.encounter, seen_by, noise)
        own, traffic, mask = surrogate.observe_set(state.encounter, seen_by, noise, self.intruders)
        return {"own": own, "traffic": traffic, "mask": mask.astype(jnp.float32)}

    def action_space(self, params: EnvParams | None = None) -> spaces.Box:
        """Return the space of an action."""
        return spaces.Box(-1.0, 1.0, (2,))

    def observation_space(self, params: EnvParams | None = None) -> Any:
        """Return the space of an observation."""
        if self.intruders == 1:
            return spaces.Box(-1.0, 1.0, (SIZE,))
        rows = self.intruders
        shapes = {"own": (-1.0, (ROW,)), "traffic": (-1.0, (rows, ROW)), "mask": (0.0, (rows,))}
        return spaces.Dict(
            {name: spaces.Box(low, 1.0, shape) for name, (low, shape) in shapes.items()}
        )


# Kept if it stands already: a module may be loaded twice.
if ENV_ID not in gymnax.registered_envs:
    gymnax.register(ENV_ID, Deconfliction)
