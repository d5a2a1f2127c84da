"""The configuration of a training run: the models behind ``configs/*.yaml`` and ``--set``."""

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, model_validator

from agents.config.load import ConfigError, Strict
from agents.config.world import RulesConfig, ScenarioConfig, VehicleConfig, check_own_speed
from envs.kinematics import Limits
from envs.outcome import RULES, Rules

__all__ = [
    "SEED_END",
    "CheckpointConfig",
    "EvaluationConfig",
    "NearLimitConfig",
    "NetworkConfig",
    "PpoConfig",
    "ShapingConfig",
    "TrainConfig",
    "WorldConfig",
]

SEED_END = 2**31
"""Seeds are below this."""


class NetworkConfig(Strict):
    """Actor and critic; they share the shape and no weights."""

    hidden: tuple[Annotated[int, Field(ge=1, le=4096)], ...] = Field(default=(256, 256), min_length=1, max_length=8)
    """Widths of the hidden layers of actor and of critic (paper: two of 256)."""
    feature_set: Literal["advised", "cpa", "foresight", "mirror", "none", "pressed"] = "cpa"
    """What the first layer sees: the bare observation (none), geometry and closest point of approach derived from it
    inside the network (cpa), those with the intruder always left of the line to the goal, so that the policy is
    exactly symmetric (mirror), these and the separations that twelve simple manoeuvres would keep (foresight), these
    and what those do that keep most (advised), or these and what the best one alone does where metres decide
    (pressed)."""
    log_std_initial: float = Field(default=-0.5, ge=-5.0, le=2.0)
    """Natural logarithm of the initial standard deviation of both actions (full deflection is 1)."""


class PpoConfig(Strict):
    """Proximal policy optimisation."""

    environments: int = Field(default=1024, ge=1)
    """Encounters that are flown at the same time."""
    rollout: int = Field(default=32, ge=1)
    """Time steps that each of them is flown between two updates, 1 s each; short ones learn more from a step."""
    epochs: int = Field(default=4, ge=1, le=100)
    """Passes over a rollout in an update."""
    minibatch: int = Field(default=2048, ge=2)
    """Samples a gradient step; a divisor of environments times rollout."""
    segment: int = Field(default=16, ge=1)
    """Consecutive samples of one environment that stay together in a shuffle (shuffling single samples is slow on a
    CPU), time steps; a divisor of rollout and of minibatch."""
    learning_rate: float = Field(default=7e-4, gt=0.0, le=1.0)
    """Step size of Adam at the start."""
    learning_rate_final: float = Field(default=0.0, ge=0.0, le=1.0)
    """Step size at the end; it changes linearly with the steps."""
    noise_memory: float = Field(default=0.0, ge=0.0)
    """Time constant with which the noise of the actions forgets, s (Hollenstein et al. 2024); 0: drawn anew each step.
    What lasts leads further from the path that is flown anyway. Its spread at any step stays the same."""
    discount: float = Field(default=0.995, gt=0.0, le=1.0)
    """Worth of a reward one time step (1 s) later."""
    gae_lambda: float = Field(default=0.95, ge=0.0, le=1.0)
    """Decay of the generalised advantage estimate: 0 trusts the critic alone, 1 the returns alone."""
    clip: float = Field(default=0.2, gt=0.0, le=1.0)
    """How far an update may move the ratio of new to old action probability from 1 before its gradient stops."""
    entropy: float = Field(default=0.0, ge=0.0)
    """Weight of the entropy bonus in the loss."""
    value: float = Field(default=0.5, gt=0.0)
    """Weight of the critic's squared error in the loss."""
    max_grad_norm: float = Field(default=0.5, gt=0.0)
    """The gradients of actor and critic are each scaled down to this norm."""
    adam_epsilon: float = Field(default=1e-5, gt=0.0)
    """Adam's guard against a division by zero."""
    reward_scale: float = Field(default=0.01, gt=0.0)
    """Factor on the task's reward before learning; logged scores are unscaled."""
    normalize_advantage: bool = True
    """Shift and scale the advantages of each minibatch to mean 0 and deviation 1."""
    smoothness: tuple[NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0)
    """Weights, in the loss, of the mean change of acceleration and turn rate (1: full deflection) from one time step to
    the next, within a `segment`."""
    critic_first: int = Field(default=0, ge=0)
    """Environment steps at the beginning in which the actor stays as it is, so that a fresh critic comes to know it
    (`start_from` of a policy)."""

    @property
    def samples(self) -> int:
        """Samples of an update."""
        return self.environments * self.rollout

    @property
    def minibatches(self) -> int:
        """Gradient steps of an epoch."""
        return self.samples // self.minibatch

    @model_validator(mode="after")
    def _check(self) -> "PpoConfig":
        for name, whole_name, whole in (
            ("minibatch", "environments times rollout", self.samples),
            ("segment", "rollout", self.rollout),
            ("segment", "minibatch", self.minibatch),
        ):
            part = getattr(self, name)
            if whole % part:
                raise ConfigError(
                    f"{name} is {part}; expected a divisor of {whole_name}, {whole}, such as {_divisor(whole, part)}"
                )
        if any(self.smoothness) and self.segment == 1:
            raise ConfigError(
                "segment is 1; expected 2 or more, as smoothness compares neighbouring steps of a segment"
            )
        return self


class WorldConfig(RulesConfig):
    """The task and the vehicle; training may ask for more separation than the evaluation."""

    vehicle: VehicleConfig = Field(
        default=VehicleConfig(), json_schema_extra={"expected": "the path of a YAML file, or a group of keys"}
    )
    """Limits of the ownship. A path is looked for beside the configuration file, then in the working directory."""
    separation_spread: float = Field(default=0.0, ge=0.0)
    """The environments require separations spread evenly from `separation` to this much more, m, which the observation
    does not show: the closer an encounter comes, the more often it is lost."""
    separation_headroom: float | None = Field(default=None, ge=0.0)
    """An encounter requires no more than the best of twelve simple manoeuvres keeps less this, m, and never less than
    `separation`; null: the spread alone decides."""

    def required_separation(self, environments: int) -> np.ndarray:
        """Return the separation that each environment requires, m, ``[environments]``, mixed over their numbers."""
        # By the golden ratio, so that any few neighbours cover the spread.
        share = np.modf(np.arange(environments) * (0.5 * (math.sqrt(5.0) - 1.0)))[0]
        return (self.separation + self.separation_spread * share).astype(np.float32)

    def limits(self) -> Limits:
        """Return the ownship's limits as the world's functions take them."""
        return self.vehicle.limits()


class ShapingConfig(Strict):
    """What learning is paid besides the task's reward, in units of the scaled reward; scores never contain it.

    The potentials (goal, conflict, escape, delay) leave the optimal policy as it is; the prices (turn, swing,
    rejoin, detour) do not.
    """

    goal: float = Field(default=0.0, ge=0.0)
    """Worth of 10 km less to the goal."""
    conflict: float = Field(default=0.0, ge=0.0)
    """Worth of a predicted closest approach at the required separation instead of at 0 m."""
    escape: float = Field(default=0.0, ge=0.0)
    """Worth of 50 m more of the separation that the best of twelve simple manoeuvres would keep, from 50 m less than
    required to 50 m more."""
    delay: float = Field(default=0.0, ge=0.0)
    """Worth of a speed at which the goal is reached 30 s before the time limit instead of 30 s after it."""
    turn: float = Field(default=0.0, ge=0.0)
    """Price of a time step (1 s) of full turn; half a turn rate costs a quarter of it."""
    swing: float = Field(default=0.0, ge=0.0)
    """Price of 90 degrees of turning, to whichever side and however sharp."""
    rejoin: float = Field(default=0.0, ge=0.0)
    """Price of 90 degrees of turning towards the goal at the full rate; slower turns cost less, and up to 0.35 degrees
    a second nothing."""
    detour: float = Field(default=0.0, ge=0.0)
    """Price of 10 km flown that bring the goal no nearer."""


class NearLimitConfig(Strict):
    """Hard examples: encounters that begin near the limit of what can be resolved."""

    encounters: int = Field(default=0, ge=0, le=1_000_000)
    """How many are drawn before training begins, to be flown again and again; 0: none."""
    share: float = Field(default=0.1, gt=0.0, lt=1.0)
    """Share of all encounters that are taken from them; the scenarios have the rest."""
    margin: float = Field(default=50.0, gt=0.0)
    """The best of twelve simple manoeuvres keeps up to this much more than `world.separation` in them, m. Courses are
    within 60 degrees of each other, and intruders fly straight on."""


class EvaluationConfig(Strict):
    """Evaluations of the deterministic policy on encounters that training never sees."""

    every_steps: int = Field(default=2_000_000, ge=1)
    """Environment steps between evaluations during training."""
    encounters: int = Field(default=1_000, ge=1)
    """Encounters of each of them."""
    final_encounters: int = Field(default=10_000, ge=1)
    """Encounters of the evaluation after training."""
    seed: int = Field(default=1_000_003, ge=0, lt=2**63)
    """Of the encounters; the same whatever the seed of the training, so that runs are compared on equal terms."""
    separation: float = Field(default=RULES.separation, gt=0.0)
    """Distance to an intruder below which an encounter is lost, m, whatever the training asks for."""
    t_max: float | None = Field(default=None, ge=1.0, le=3600.0, multiple_of=1.0)
    """Time limit, s, a whole number of seconds, whatever the training gives; that of the training where null."""
    goal_radius: float | None = Field(default=None, gt=0.0)
    """Distance from the goal at which it counts as reached, m, whatever the training asks for; that of the training
    where null."""

    def rules(self, world: WorldConfig) -> Rules:
        """Return the task by which policies are judged."""
        rules = world.rules()
        t_max = rules.t_max if self.t_max is None else self.t_max
        goal_radius = rules.goal_radius if self.goal_radius is None else self.goal_radius
        return rules._replace(separation=self.separation, t_max=t_max, goal_radius=goal_radius)


class CheckpointConfig(Strict):
    """Checkpoints, from which ``--resume`` goes on."""

    every_seconds: float = Field(default=60.0, ge=0.0)
    """Least time between checkpoints, s; 0: after every update."""
    keep: int = Field(default=2, ge=1)
    """How many are kept."""


class TrainConfig(Strict):
    """A training run; the defaults train the paper's circle encounters."""

    name: str = Field(
        default="train",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$",
        json_schema_extra={"expected": "a text of at most 64 letters, digits, dots, dashes and underscores"},
    )
    """What the run is called; part of the default name of its folder."""
    seed: int = Field(default=0, ge=0, lt=SEED_END)
    """Everything random in the run follows from it."""
    steps: int = Field(default=10_000_000, ge=1)
    """Length of the training, environment steps; rounded down to whole updates, of which there is at least one."""
    start_from: Path | None = None
    """Directory of an earlier run, or one of its checkpoints: its networks, with the optimiser's state, are what this
    training begins with (a path as seen from the working directory). Or a policy file: its actor, beside a fresh critic
    (see `ppo.critic_first`). null begins with fresh ones."""
    network: NetworkConfig = NetworkConfig()
    ppo: PpoConfig = PpoConfig()
    world: WorldConfig = WorldConfig()
    scenarios: tuple[ScenarioConfig, ...] = Field(default=(ScenarioConfig(name="circle"),), min_length=1)
    """The mixture of encounters that training draws from."""
    pool_rows: int = Field(default=16, ge=1)
    """Encounters that are drawn per environment and update; an encounter that ends goes on with the next of them."""
    near_limit: NearLimitConfig = NearLimitConfig()
    shaping: ShapingConfig = ShapingConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()

    @model_validator(mode="after")
    def _fits(self) -> "TrainConfig":
        for number, entry in enumerate(self.scenarios):
            check_own_speed(entry.scenario(), self.world.vehicle.limits(), f"scenarios.{number}.own_speed")
        return self


def _divisor(whole: int, near: int) -> int:
    """Return the divisor of a number that is nearest to another number."""
    divisors = {d for small in range(1, int(whole**0.5) + 1) if whole % small == 0 for d in (small, whole // small)}
    return min(divisors, key=lambda d: (abs(d - near), d))
