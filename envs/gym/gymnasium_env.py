"""The encounter as a Gymnasium environment, ``rlcas/Deconfliction-v0``; importing this module
registers it.

The vectorised one is :class:`envs.gym.gymnasium_vector.DeconflictionVectorEnv`; usage:
docs/howto/gymnasium.md.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import error
from gymnasium.envs.registration import register, registry

from envs import starts
from envs.aircraft import PAPER, Aircraft
from envs.encounters import Encounter, Scenario
from envs.frames import Air
from envs.gym import flight
from envs.gym.gymnasium_contract import (
    OUTCOMES,
    action_space,
    as_dict,
    check_actions,
    check_options,
    has_display,
    observation_space,
    scenario_of,
    world_of,
)
from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.rewards import learning_reward, table
from envs.world import State, StepResult

if TYPE_CHECKING:
    from envs.gym.rendering import Drawing, Picture
    from envs.gym.window import Window

ENV_ID = "rlcas/Deconfliction-v0"


class _Frame(NamedTuple):
    """A moment of an encounter of K intruders, for pictures."""

    own: VehicleState[Air]
    intruders: list[VehicleState[Air]]  # K
    separations: tuple[float, ...]  # smallest distance to each during the step before, m, K


class DeconflictionEnv(gymnasium.Env[Any, np.ndarray]):
    """One encounter of the surrogate: rejoin the route and keep the required separation from every
    intruder.

    Observation: with ``intruders=1`` float32 ``[8]`` in [-1, 1], components in the order of
        :data:`envs.observation.NAMES`, of the most critical intruder as the scenario's sensor
        reports it; with K > 1 intruders a dict of ``own`` (float32 ``[4]``), ``traffic`` (float32
        ``[K, 4]``, the K most critical, the most critical first) and ``mask`` (int8 ``[K]``, 1 for
        a row that holds an intruder); see :class:`envs.observation.SetObservation`.
    Action: float32 ``[2]`` in [-1, 1], acceleration and yaw rate as parts of the aircraft's limits
        (the paper's: 0.5 m/s^2 and 3 deg/s), positive to the left; values beyond are clipped.
    Reward: sparse; -100 at a loss of separation, +100 at the goal, -10 at ``t_max``, else 0; with
        ``rewards`` that table, points.
    Termination: ``terminated`` at a loss of separation (closest approach within a step, by
        continuous motion) and at the goal; ``truncated`` at ``t_max``, because the observation
        holds no clock.
    Info: ``separation`` (smallest in the step, m), ``min_separation`` (since the start, m),
        ``goal_distance`` (m), ``time`` (s), ``outcome`` (one of
        :data:`envs.gym.gymnasium_contract.OUTCOMES`), ``encounter`` (its number; -1 for one given).

    Encounters are numbered: ``reset(seed=s)`` begins encounter 0 of seed s, each later ``reset()``
    the next one. They are, with the noise of the reports, those that the Monte Carlo evaluator
    flies. ``reset(options=...)`` takes ``scenario`` (a name or a Scenario, which stays until
    changed) and ``encounter`` (a number, or an :class:`envs.encounters.Encounter`).

    Args:
        scenario: name, ``module:name`` of your own, or Scenario.
        aircraft: the ownship; all else is scaled by it.
        intruders: K that an observation shows.
        rules: of the task; None: the aircraft's.
        rewards: weights in points by the names of terms, ``module:name`` of your own
            (:mod:`envs.rewards`); None: the rules' alone.
        discount: of potentials among them, per time step.
        render_mode: None, ``"rgb_array"`` or ``"human"``, which needs a display; ``metadata`` names
            it only with one.
        render_size: side of the picture, pixels.

    Raises:
        EncounterError: (a ValueError) the scenario or encounter is impossible.
        gymnasium.error.Error: UnsupportedMode for another render mode or where no window can be
            opened, ResetNeeded for a step or picture before the first reset or a step after the
            end, InvalidAction for an action of a wrong shape or that is not finite.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 20}  # noqa: RUF012 - Gymnasium's form

    def __init__(
        self,
        scenario: str | Scenario = "circle",
        *,
        aircraft: Aircraft = PAPER,
        intruders: int = 1,
        rules: Rules | None = None,
        rewards: Mapping[str, float] | None = None,
        discount: float = 1.0,
        render_mode: str | None = None,
        render_size: int = 600,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise error.UnsupportedMode(
                f"render_mode is {render_mode!r}; expected None, 'rgb_array' or 'human'"
            )
        if not has_display():
            # Gymnasium's check_env tries every mode that the environment names.
            self.metadata = self.metadata | {"render_modes": ["rgb_array"]}
        self.render_mode = render_mode
        self.render_size = render_size
        self.observation_space = observation_space(intruders)
        self.action_space = action_space()
        self.scenario = scenario_of(scenario, aircraft)
        self.world = world_of(aircraft, rules, rewards)
        self._rows = intruders
        self._rewards = table(rewards or {})
        self._discount = discount
        self._seed: int | None = None
        self._next = 0
        self._number = 0
        self._label = 0
        self._flight: State | None = None
        self._mask = np.zeros(0, dtype=bool)
        self._noisy = False
        self._min_separation = np.inf
        self._frames: list[_Frame] = []
        self._outcome = OUTCOMES[0]
        self._picture: Drawing | None = None
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next encounter, or the one that the options ask for."""
        chosen = check_options(options)
        super().reset(seed=seed)
        if seed is not None:
            self._seed, self._next = seed, 0
        elif self._seed is None:
            self._seed = int(self.np_random.integers(2**63))
        if "scenario" in chosen:
            self.scenario = scenario_of(chosen["scenario"], self.world.aircraft)
        requested = chosen.get("encounter", self._next)
        is_encounter = isinstance(requested, Encounter)
        number = self._next if is_encounter else requested
        encounters = (
            requested
            if is_encounter
            else starts.encounters_of_seed(self.scenario, self._seed, number, 1)
        )
        encounter = starts.check_encounter(encounters, self.world.aircraft)

        self._number, self._next = number, number + 1
        self._label = -1 if is_encounter else number
        self._flight = flight.begin(encounter, self.world.aircraft.dt)
        self._outcome = OUTCOMES[0]
        self._mask = encounter.mask
        self._noisy = any(np.any(field > 0.0) for field in encounter.sensor)
        separations = flight.separations(self._flight)
        self._min_separation = min(separations)
        self._frames = []
        self._record(separations)
        if self.render_mode == "human":
            if self._window is not None and self._window.closed:
                self._window = None
            self.render()
        goal_distance = float(
            np.hypot(encounter.goal_x - encounter.own.x, encounter.goal_y - encounter.own.y)
        )
        return self._observe(), self._info(min(separations), goal_distance)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly on for one time step."""
        if self._flight is None:
            raise error.ResetNeeded(
                "step was called before reset; call reset to begin an encounter"
            )
        if self._outcome != OUTCOMES[0]:
            raise error.ResetNeeded(
                f"the encounter has ended ({self._outcome}); call reset to begin another one"
            )
        acceleration, yaw_rate = check_actions(action, (2,)).tolist()
        before = self._flight
        command = acceleration, yaw_rate
        self._flight, result = self._advance(before, command)
        reward = result.reward
        if self._rewards.shaping:
            moved = flight.transition(before, self._flight, command, result, self.world.aircraft)
            reward, _ = learning_reward(self._rewards, moved, self._discount, np)
        self._min_separation = min(self._min_separation, result.separation)
        outcome = result.outcome
        holds = (name for name, value in outcome._asdict().items() if value)
        self._outcome = next(holds, OUTCOMES[0])
        self._record(result.separations)
        if self.render_mode == "human":
            self.render()
        info = self._info(result.separation, result.goal_distance)
        terminated, truncated = bool(outcome.violation or outcome.reached), bool(outcome.timeout)
        return self._observe(), float(reward), terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """Return the picture, uint8 ``[size, size, 3]``, show it in a window, or do nothing, by the
        render mode.
        """
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render draws nothing: give render_mode="rgb_array" or "human" to gymnasium.make'
            )
            return None
        if self._flight is None:
            raise error.ResetNeeded(
                "render was called before reset; call reset to begin an encounter"
            )
        # Matplotlib is loaded for drawing only.
        if self.render_mode == "rgb_array":
            from envs.gym.rendering import Drawing

            self._picture = self._picture or Drawing(self.render_size)
            return self._picture.frame(self.scene())
        if self._window is None:
            from envs.gym.window import Window

            self._window = Window(self.render_size, self.metadata["render_fps"])
        self._window.show(self.scene())
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
        self._window = self._picture = None

    def scene(self) -> "Picture":
        """Return what a picture shows: the encounter since its start where a render mode is set."""
        from envs.gym.rendering import Picture

        assert self._flight is not None
        label = f"{self.scenario.name}, encounter {self._label}"
        if self._label < 0:
            label = "an encounter of your own"
        return Picture(
            own=np.array([frame.own for frame in self._frames]),
            intruders=np.array([frame.intruders for frame in self._frames]),
            separations=np.array([frame.separations for frame in self._frames]),
            goal=(self._flight.goal_x, self._flight.goal_y),
            goal_radius=self.world.rules.goal_radius,
            required=self.world.rules.separation,
            time=self._flight.steps * self.world.rules.dt,
            outcome=self._outcome,
            title=label,
        )

    def _advance(self, before: State, action: tuple[float, float]) -> tuple[State, StepResult]:
        """Return the state one step later; environments of another vehicle replace this."""
        return flight.step(before, action, self.world)

    def _record(self, separations: tuple[float, ...]) -> None:
        if self.render_mode is not None and self._flight is not None:
            intruders = [state.vehicle for state in self._flight.intruders]
            self._frames.append(_Frame(self._flight.own, intruders, separations))

    def _observe(self) -> Any:
        assert self._flight is not None and self._seed is not None
        noise = None
        if self._noisy:
            # Absent intruders have draws too, as they have in the evaluator.
            draws = starts.report_noise(
                self._seed, self._number, int(self._flight.steps), len(self._mask)
            )
            noise = draws[:, self._mask]
        if self._rows == 1:
            return flight.observe(self._flight, self.world.aircraft, noise)
        observed = flight.observe_set(self._flight, self._rows, self.world.aircraft, noise)
        return as_dict(np.concatenate([part.ravel() for part in observed]), self._rows)

    def _info(self, separation: float, goal_distance: float) -> dict[str, Any]:
        assert self._flight is not None
        return {
            "separation": separation,
            "min_separation": self._min_separation,
            "goal_distance": goal_distance,
            "time": self._flight.steps * self.world.rules.dt,
            "outcome": self._outcome,
            "encounter": self._label,
        }


# Kept if it stands already: a module may be loaded twice under different test runners.
if ENV_ID not in registry:
    register(
        ENV_ID,
        entry_point="envs.gym.gymnasium_env:DeconflictionEnv",
        vector_entry_point="envs.gym.gymnasium_vector:DeconflictionVectorEnv",
    )
