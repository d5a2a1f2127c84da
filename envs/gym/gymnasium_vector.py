"""Many encounters as one Gymnasium vector environment: the compiled surrogate behind a host-side
step.
"""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from gymnasium import error
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from envs import starts
from envs.aircraft import PAPER, Aircraft
from envs.encounters import Encounter, EncounterError, Scenario, pad
from envs.gym import batch_flight
from envs.gym.batch_flight import Columns, Setting
from envs.gym.gymnasium_contract import (
    OUTCOMES,
    action_space,
    as_dict,
    check_actions,
    check_options,
    observation_space,
    scenario_of,
    world_of,
)
from envs.outcome import Rules
from envs.rewards import table
from envs.surrogate import State

_LEAST = 1_024  # fewest starts drawn beyond those of one step, so that drawing is seldom


class DeconflictionVectorEnv(VectorEnv[Any, np.ndarray, np.ndarray]):
    """N encounters of :class:`envs.gym.gymnasium_env.DeconflictionEnv`, in single precision on
    jax's device.

    Spaces, reward, termination and the keys of ``infos`` are those of the single environment,
    batched; ``infos`` carries a mask ``_key`` for each key. An encounter that ends begins anew in
    the same step (``AutoresetMode.SAME_STEP``): the observation and the infos returned are then the
    new encounter's, the last ones of the old stand in ``infos["final_obs"]`` and
    ``infos["final_info"]``, present where ``infos["_final_obs"]`` holds.

    ``reset(seed=s)`` begins the encounters 0 .. N-1 of seed s; those that follow take the next
    numbers in the order in which they begin (in one step: by index). Starts are drawn on the host
    in advance. ``reset(options=...)`` takes ``scenario`` as the single environment does and
    ``encounter``: the first number, or an Encounter with N rows. Noise of reports comes from the
    device's own generator, so it is not the single environment's.

    ``num_envs`` is N; the other arguments are the single environment's, which also makes pictures.

    Raises:
        ValueError: ``num_envs`` is below 1; an EncounterError for an impossible scenario or
            encounter.
        gymnasium.error.Error: as of the single environment; ClosedEnvironmentError for a reset or
            step after close.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Scenario = "circle",
        *,
        aircraft: Aircraft = PAPER,
        intruders: int = 1,
        rules: Rules | None = None,
        rewards: Mapping[str, float] | None = None,
        discount: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; expected 1 or more")
        if render_mode is not None:
            raise error.UnsupportedMode(
                f"render_mode is {render_mode!r}; expected None (for pictures "
                'vectorization_mode="sync")'
            )
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}
        self.num_envs = num_envs
        self.single_observation_space = observation_space(intruders)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.scenario = scenario_of(scenario, aircraft)
        # Plain numbers, because the compiled step is chosen by their values.
        self.world = world_of(aircraft, rules, rewards)
        self._rows = intruders
        self._rewards = table(rewards or {})
        self._discount = discount
        self._seed: int | None = None
        self._next = self._ticks = 0
        self._state: State | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin all encounters anew."""
        self._check_open()
        chosen = check_options(options)
        if seed is not None and not isinstance(seed, (int, np.integer)):
            raise EncounterError(
                f"seed is {seed!r}; expected one integer for all encounters, or None"
            )
        super().reset(seed=seed)
        if seed is not None or self._seed is None:
            self._seed = int(self.np_random.integers(2**63)) if seed is None else int(seed)
            self._next = self._ticks = 0
        if "scenario" in chosen:
            self.scenario = scenario_of(chosen["scenario"], self.world.aircraft)
        encounter = self._take_encounters(chosen.get("encounter", self._next), self._seed)
        columns, most = encounter.mask.shape[-1], self.scenario.intruders[1]
        if most > columns:
            raise EncounterError(
                f"the encounters given have {columns} intruder columns; expected {most}, as "
                f"scenario {self.scenario.name!r} has, which follows them"
            )
        self._setting = self._setting_of(encounter)
        self._draw_pool(columns)
        return self._begin(encounter, self._seed)

    def _setting_of(self, encounter: Encounter) -> Setting:
        """Return what a step is compiled for with these encounters and those of the scenario."""
        errors = (
            self.scenario.position_std,
            self.scenario.velocity_std,
            self.scenario.latency[1],
            *encounter.sensor,
        )
        return Setting(
            self.world,
            noisy=any(np.any(np.asarray(values) > 0.0) for values in errors),
            intruders=self._rows,
            rewards=self._rewards,
            discount=self._discount,
        )

    def _begin(self, encounter: Encounter, seed: int) -> tuple[Any, dict[str, Any]]:
        """Begin encounters ``[N]``; return their observations and infos."""
        # Counted on through resets, so that no noise comes twice under a seed.
        self._ticks += 1
        self._key = jax.random.fold_in(jax.random.key(seed & 0xFFFFFFFF), seed >> 32)
        self._steps = np.zeros(self.num_envs, dtype=np.int64)
        single = starts.cast(encounter, np.float32)
        self._state, packed = batch_flight.begin(single, self._key, self._ticks, self._setting)
        host = np.asarray(packed)
        size = self._setting.size
        self._min_separation = host[:, size].astype(np.float64)
        return self._shape(host[:, :size]), self._infos(self._min_separation, host[:, size + 1])

    def _take_encounters(self, requested: Any, seed: int) -> Encounter:
        """Return the encounters that are given, or those of the seed from a number on.

        Their numbers are noted, -1 of given ones.
        """
        if isinstance(requested, Encounter):
            encounters = starts.check_encounter(requested, self.world.aircraft, (self.num_envs,))
            self._numbers = np.full(self.num_envs, -1)
            return encounters
        of_seed = starts.encounters_of_seed(self.scenario, seed, requested, self.num_envs)
        self._numbers = requested + np.arange(self.num_envs)
        self._next = requested + self.num_envs
        return of_seed

    def step(
        self, actions: np.ndarray
    ) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly on for one time step under actions ``[N, 2]`` and begin anew what has ended.

        Rewards are float64 ``[N]``, terminations and truncations bool ``[N]``.
        """
        self._check_open()
        if self._state is None:
            raise error.ResetNeeded(
                "step was called before reset; call reset to begin the encounters"
            )
        checked = check_actions(actions, (self.num_envs, 2))
        self._ticks += 1
        self._state, packed = batch_flight.step(
            self._state, self._pool, self._used, checked, self._key, self._ticks, self._setting
        )
        observation, final_observation, columns = batch_flight.unpack(packed, self._setting)
        ended = columns.code > 0.0
        self._steps += 1
        self._min_separation = np.minimum(self._min_separation, columns.separation)
        final: dict[str, Any] = {}
        separation, goal_distance = columns.separation, columns.goal_distance
        if ended.any():
            final = self._final(ended, final_observation, columns)
            separation = np.where(ended, columns.new_separation, separation)
            goal_distance = np.where(ended, columns.new_goal_distance, goal_distance)
            self._restart(ended, columns.new_separation)
        infos = final | self._infos(separation, goal_distance)
        terminated = (columns.code == 1.0) | (columns.code == 2.0)
        reward = columns.reward.astype(np.float64)
        return self._shape(observation), reward, terminated, columns.code == 3.0, infos

    def close_extras(self, **kwargs: Any) -> None:
        """Free the device's memory."""
        self._state = None

    def _shape(self, packed: np.ndarray) -> Any:
        """Return observations as the space has them, in memory of their own."""
        return packed.copy() if self._rows == 1 else as_dict(packed, self._rows)

    def _check_open(self) -> None:
        if self.closed:
            raise error.ClosedEnvironmentError("the environment is closed; make a new one")

    def _draw_pool(self, columns: int) -> None:
        """Draw the next starts, always equally many, so that the step is compiled once."""
        count = self.num_envs + max(self.num_envs, _LEAST)
        assert self._seed is not None
        encounters = starts.cast(
            starts.encounters_of_seed(self.scenario, self._seed, self._next, count), np.float32
        )
        self._pool = jax.device_put(pad(encounters, columns, np))
        self._used = 0

    def _restart(self, ended: np.ndarray, new_separation: np.ndarray) -> None:
        """Number the encounters that have begun, and draw starts before they could run out."""
        count_begun = int(np.count_nonzero(ended))
        self._numbers[ended] = self._next + np.arange(count_begun)
        self._next += count_begun
        self._steps[ended] = 0
        self._min_separation[ended] = new_separation[ended]
        self._used += count_begun
        count, columns = self._pool.mask.shape
        if count - self._used < self.num_envs:
            self._draw_pool(columns)

    def _final(
        self, ended: np.ndarray, observation: np.ndarray, columns: Columns
    ) -> dict[str, Any]:
        """Return the last observations and infos of encounters that have ended, in Gymnasium's
        form.
        """
        final_obs = np.full(self.num_envs, None, dtype=object)
        outcomes = np.full(self.num_envs, None, dtype=object)
        for index in np.flatnonzero(ended):
            final_obs[index] = self._shape(observation[index])
            outcomes[index] = OUTCOMES[int(columns.code[index])]
        infos = self._infos(columns.separation, columns.goal_distance)
        values = {key: np.where(ended, value, 0) for key, value in infos.items() if key[0] != "_"}
        values |= {"outcome": outcomes}
        final: dict[str, Any] = {"final_obs": final_obs}
        final["final_info"] = values | {f"_{key}": ended.copy() for key in values}
        return final | {f"_{key}": ended.copy() for key in final}

    def _infos(self, separation: np.ndarray, goal_distance: np.ndarray) -> dict[str, Any]:
        """Return the infos of all encounters, in Gymnasium's form, from distances in m, ``[N]``."""
        values = {
            "separation": separation.astype(np.float64),
            "min_separation": self._min_separation.copy(),
            "goal_distance": goal_distance.astype(np.float64),
            "time": self._steps * self.world.rules.dt,
            "outcome": np.full(self.num_envs, OUTCOMES[0], dtype=object),
            "encounter": self._numbers.copy(),
        }
        return values | {f"_{key}": np.ones(self.num_envs, dtype=bool) for key in values}
