"""The configuration of a training: the models behind ``configs/*.yaml`` and ``--set``."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, create_model, model_validator

from agents.config.load import ConfigError, Strict, validate
from agents.config.world import PAPER_AIRCRAFT, AircraftConfig, ScenarioConfig
from agents.policy.inputs import resolve
from agents.policy.set_features import InputTable, table
from commands.command import InputError
from commands.extension import is_extension
from commands.yaml import YamlError, read
from envs.aircraft import PAPER
from envs.encounters import EncounterError, Scenario
from envs.outcome import Rules
from envs.rewards import REWARD_TERMS, TASK, TERMS, RewardError, Rewards, Term, with_scores
from envs.rewards import table as reward_table
from envs.scenarios import is_loaded
from envs.scenarios import resolve as resolve_scenario

SEED_END = 2**31
"""Seeds are below this."""

PPO = "ppo"
"""The algorithm that ships."""

Weight = Annotated[float, Field(ge=0.0, le=1e6)]


class NetworkConfig(Strict):
    """Actor and critic; they share the shape and no weights."""

    hidden: tuple[Annotated[int, Field(ge=1, le=4096)], ...] = Field(
        default=(256, 256), min_length=1, max_length=8
    )
    """Widths of the hidden layers of actor and of critic (paper: two of 256)."""
    feature_set: Literal["mirror", "none", "set"] = "set"
    """Inputs of the first layer: any number of intruders, how each will pass, and the least
    separation from any of them that 22 simple manoeuvres keep, for any aircraft and exactly
    symmetric (set); or, of the most critical intruder alone, the bare observation (none), or
    geometry and closest point of approach derived from it inside the network, with the intruder
    always left of the line to the goal, so that the policy is exactly symmetric (mirror)."""
    encoder: tuple[Annotated[int, Field(ge=1, le=1024)], ...] = Field(
        default=(64, 64), min_length=1, max_length=4
    )
    """Widths of the layers that every intruder of a set passes, before the maximum of each number
    is taken.
    """
    inputs: tuple[str, ...] = Field(default=(), max_length=64)
    """Inputs of your own beside those of a set: `module:name` of an
    `agents.policy.inputs.Input`, or the name of one that your program has registered."""

    def input_table(self) -> InputTable:
        """Return the inputs of the network, with the user's own, whose code is loaded.

        Raises:
            ConfigError: one of them is not there, or cannot be used.
        """
        try:
            return table(resolve(self.inputs))
        except InputError as problem:
            raise ConfigError(f"network.inputs: {problem}") from None


class PpoConfig(Strict):
    """Proximal policy optimisation."""

    MOVED: ClassVar[Mapping[str, str]] = {
        name: name
        for name in (
            "environments",
            "rollout",
            "learning_rate",
            "learning_rate_final",
            "discount",
            "reward_scale",
        )
    }

    epochs: int = Field(default=4, ge=1, le=100)
    """Passes over a rollout in an update."""
    minibatch: int = Field(default=2048, ge=2, le=10_000_000)
    """Samples a gradient step; a divisor of environments times rollout."""
    segment: int = Field(default=16, ge=1, le=10_000)
    """Consecutive samples of one environment that stay together in a shuffle (shuffling single
    samples is slow on a CPU), time steps; a divisor of rollout and of minibatch."""
    gae_lambda: float = Field(default=0.95, ge=0.0, le=1.0)
    """Decay of the generalised advantage estimate: 0 trusts the critic alone, 1 the returns alone.
    """
    clip: float = Field(default=0.2, gt=0.0, le=1.0)
    """How far an update may move the ratio of new to old action probability from 1 before its
    gradient stops.
    """
    value: Weight = 0.5
    """Weight of the value loss in the loss."""
    entropy: Weight = 0.0
    """Weight of the entropy bonus in the loss."""
    action_bound_coef: Weight = 0.0
    """Weight in the loss of the square of what the mean action is beyond its limits, where it is
    clipped and noise around it teaches nothing."""
    max_grad_norm: float = Field(default=0.5, gt=0.0)
    """Longest gradient of each network, by its global norm; a longer one is shortened to it."""
    adam_epsilon: float = Field(default=1e-5, gt=0.0, le=1.0)
    """What Adam adds to the root of its second moment, against a division by zero."""
    normalize_advantage: bool = True
    """Whether the advantages of a minibatch are shifted and scaled to mean 0 and standard deviation
    1."""


class WorldConfig(Strict):
    """What training requires beyond the aircraft's own task."""

    separation_spread: float = Field(default=0.0, ge=0.0, le=10.0)
    """Each environment requires a separation of 1 to 1 + this times the aircraft's, spread evenly;
    the observation does not show it."""
    time_share: float = Field(default=1.0, gt=0.0, le=1.0)
    """Share of the aircraft's time limit within which training requires the goal; the observation
    does not show it.
    """

    def required_separation(self, environments: int, separation: float) -> np.ndarray:
        """Return the separation that each environment requires, m, ``[environments]``, mixed over
        their numbers.
        """
        # By the golden ratio, so that any few neighbours cover the spread.
        share = np.modf(np.arange(environments) * (0.5 * (math.sqrt(5.0) - 1.0)))[0]
        return (separation + self.separation_spread * separation * share).astype(np.float32)


RewardWeight = Annotated[float, Field(ge=-1e6, le=1e6)]


class _RewardsConfig(Strict):
    """The reward that is learned from: weight times term, added up in every step, points.

    Terms are those of :data:`envs.rewards.TERMS` and, by ``module:name``, the user's own.
    """

    model_config = ConfigDict(extra="allow")
    # pydantic's way to say what values further keys have
    __pydantic_extra__: dict[str, RewardWeight] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    def weights(self) -> dict[str, float]:
        """Return the weights by the names of the terms."""
        return self.model_dump()

    def table(self) -> Rewards:
        """Return the table of the terms that have a weight; the code of the user's own is loaded.

        Raises:
            ConfigError: one of them is not there, or cannot be used.
        """
        try:
            return reward_table(self.weights())
        except RewardError as problem:
            raise ConfigError(f"rewards: {problem}") from None

    @model_validator(mode="after")
    def _check(self) -> "_RewardsConfig":
        for name in self.__pydantic_extra__ or {}:
            if name not in REWARD_TERMS and not is_extension(name):
                raise ConfigError(f"{name} is unknown; {REWARD_TERMS.expected(name)}")
        return self


def _row(name: str, term: Term) -> tuple[Any, Any]:
    weight = getattr(Rules(), TASK[name]) if name in TASK else 0.0
    text = f"Points for {term.meaning[0].lower()}{term.meaning[1:]}"
    return RewardWeight, Field(default=weight, description=text)


if TYPE_CHECKING:

    class RewardsConfig(_RewardsConfig):
        """A field for each of the toolkit's terms."""
else:
    RewardsConfig = create_model(
        "RewardsConfig",
        __base__=_RewardsConfig,
        __doc__=_RewardsConfig.__doc__,
        **{name: _row(name, term) for name, term in TERMS.items()},
    )


class FamilyConfig(Strict):
    """Other aircraft that the training flies beside the configured one, so that one policy serves
    them all.

    Sizes do not count, only ratios: lengths are in separations D, speeds in the ownship's greatest
    speed V.
    """

    share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the environments whose ownship is drawn from the family."""
    speed_min: tuple[float, float] = (0.4, 0.75)
    """Lowest speed, V."""
    acceleration: tuple[float, float] = (0.03, 0.4)
    """Greatest acceleration and, drawn apart, deceleration, V^2/D."""
    turn_radius: tuple[float, float] = (0.3, 2.5)
    """Radius of the circle at V and the greatest turn rate, D."""
    traffic_speed: tuple[float, float] = (0.4, 1.3)
    """Speed of the intruders, V."""

    @model_validator(mode="after")
    def _check(self) -> "FamilyConfig":
        for key, (low, high), most in (
            ("speed_min", self.speed_min, 0.99),
            ("acceleration", self.acceleration, 10.0),
            ("turn_radius", self.turn_radius, 10.0),
            ("traffic_speed", self.traffic_speed, 1.5),
        ):
            if not 0.01 <= low <= high <= most:
                raise ConfigError(
                    f"{key} is [{low:g}, {high:g}]; expected [low, high] within 0.01 to {most:g}"
                )
        return self


class EvaluationConfig(Strict):
    """Evaluations of the deterministic policy on encounters that training never sees."""

    every_steps: int = Field(default=2_000_000, ge=1, le=10**12)
    """Environment steps between evaluations during training."""
    encounters: int = Field(default=1_000, ge=1, le=1_000_000)
    """Encounters of each of these evaluations."""
    final_encounters: int = Field(default=10_000, ge=1, le=1_000_000)
    """Encounters of the evaluation after training."""
    seed: int = Field(default=1_000_003, ge=0, lt=2**63)
    """Seed of the encounters; independent of the training's, so that all runs are evaluated on the
    same encounters.
    """


class CheckpointConfig(Strict):
    """Checkpoints, from which ``--resume`` goes on."""

    every_seconds: float = Field(default=60.0, ge=0.0)
    """Least time between checkpoints, s; 0: after every update."""


class TrainConfig(Strict):
    """A training run; the defaults train the paper's circle encounters with its aircraft."""

    PHASE_KEYS: ClassVar = (
        "steps",
        "environments",
        "rollout",
        "discount",
        "reward_scale",
        "learning_rate",
        "learning_rate_final",
        "ppo",
        "world",
        "scenarios",
        "pool_rows",
        "rewards",
    )

    name: str = Field(
        default="train",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$",
        json_schema_extra={
            "expected": "a text of at most 64 letters, digits, dots, dashes and underscores"
        },
    )
    """Name of the run; part of the default name of its folder."""
    seed: int = Field(default=0, ge=0, lt=SEED_END)
    """Everything random in the run follows from it."""
    steps: int = Field(default=10_000_000, ge=1, le=10**12)
    """Length of the training, environment steps; rounded down to whole updates, of which there is
    at least one.
    """
    warm_start: Path | None = None
    """Directory of an earlier run, or one of its checkpoints: training begins with its networks and
    the optimiser's state (a path as seen from the working directory). Or a policy file: training
    begins with its actor and a fresh critic. null: with fresh networks."""
    aircraft: AircraftConfig = Field(
        default=PAPER_AIRCRAFT,
        json_schema_extra={
            "expected": "the path of a YAML file, a name that ships, or a group of keys"
        },
    )
    """The ownship and its task. A path is looked for beside the configuration file, then in the
    working directory; a name such as `uas` is that of one that ships. Scenarios, rewards and
    observations are scaled by it."""
    network: NetworkConfig = NetworkConfig()
    algorithm: str = Field(
        default=PPO, json_schema_extra={"expected": "ppo, or module:name of your own"}
    )
    """What learns: ppo, or `module:name` of an algorithm of your own
    (`agents.learning.algorithm.Algorithm`)."""
    algorithm_settings: dict[str, Any] = Field(
        default={}, json_schema_extra={"expected": "a group of keys"}
    )
    """Keyword arguments of an algorithm of your own; those of ppo stand in `ppo`."""
    environments: int = Field(default=1024, ge=1, le=1_000_000)
    """Encounters that are flown at the same time."""
    rollout: int = Field(default=32, ge=1, le=10_000)
    """Time steps that each of them is flown between two updates; short ones learn more from a step.
    """
    discount: float = Field(default=0.995, gt=0.0, le=1.0)
    """Worth of a reward one time step later."""
    reward_scale: float = Field(default=0.01, gt=0.0)
    """Factor on the points of `rewards` before learning; logged scores are unscaled."""
    learning_rate: float = Field(default=7e-4, gt=0.0, le=1.0)
    """Step size of the optimiser at the start."""
    learning_rate_final: float = Field(default=0.0, ge=0.0, le=1.0)
    """Step size at the end; it changes linearly with the steps."""
    ppo: PpoConfig = PpoConfig()
    world: WorldConfig = WorldConfig()
    scenarios: tuple[ScenarioConfig, ...] = Field(
        default=(ScenarioConfig(name="circle"),), min_length=1, max_length=64
    )
    """The mixture of encounters that training draws from; `module:name` names a sampler of your
    own, which is imported."""
    pool_rows: int = Field(default=16, ge=1, le=10_000)
    """Encounters that are drawn per environment and update; an encounter that ends goes on with the
    next of them.
    """
    family: FamilyConfig = FamilyConfig()
    rewards: RewardsConfig = RewardsConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    phases: tuple[dict[str, Any], ...] = Field(
        default=(), max_length=16, json_schema_extra={"expected": "a list of groups of keys"}
    )
    """Parts of the training, one after the other in one run: each names what differs in it from the
    other keys (steps, environments, rollout, discount, reward_scale, learning_rate,
    learning_rate_final, ppo, world, scenarios, pool_rows and rewards), and goes on with the
    networks of the one before. Empty: one phase."""

    @property
    def samples(self) -> int:
        """Samples of an update."""
        return self.environments * self.rollout

    def rules(self) -> Rules:
        """Return the task: the aircraft's, with the scores of `rewards`."""
        return with_scores(self.aircraft.aircraft().rules(), self.rewards.weights())

    def training_scenarios(self) -> list[Scenario]:
        """Return the scenarios that training draws from; the code of the user's own is loaded.

        Raises:
            ConfigError: one of them is not there, or contradicts the aircraft.
        """
        for number, entry in enumerate(self.scenarios):
            try:
                resolve_scenario(entry.name)
            except EncounterError as problem:
                raise ConfigError(f"scenarios.{number}.name: {problem}") from None
        return self._scenarios()

    def _scenarios(self) -> list[Scenario]:
        aircraft, scenarios = self.aircraft.aircraft(), []
        for number, entry in enumerate(self.scenarios):
            try:
                scenarios.append(entry.scenario(aircraft))
            except ConfigError as problem:
                raise ConfigError(f"scenarios.{number}.{problem}") from None
        return scenarios

    def phase_configs(self) -> tuple["TrainConfig", ...]:
        """Return one configuration for each phase, in which nothing is left of ``phases``.

        With ``seed: 3`` and ``phases: [{steps: 100}, {steps: 200}]`` these are two: ``{seed: 3,
        steps: 100}`` and ``{seed: 3, steps: 200}``. A training without phases is one phase, so its
        own configuration is the only one.
        """
        if not self.phases:
            return (self,)
        common = self.model_dump(exclude={"phases"})
        return tuple(
            self._phase_config(common, number, changes)
            for number, changes in enumerate(self.phases)
        )

    def _phase_config(
        self, common: dict[str, Any], number: int, changes: dict[str, Any]
    ) -> "TrainConfig":
        """Return the configuration of a phase: what is common to all of them, with its changes;
        raises a ConfigError that names the phase.
        """
        for key in changes:
            if key not in self.PHASE_KEYS:
                raise ConfigError(
                    f"phases.{number}.{key}: expected one of {', '.join(self.PHASE_KEYS)}"
                )
        try:
            return validate(TrainConfig, _merge(common, changes))
        except ConfigError as problem:
            raise ConfigError(f"phases.{number}: {problem}") from None

    @model_validator(mode="after")
    def _check(self) -> "TrainConfig":
        if all(is_loaded(entry.name) for entry in self.scenarios):  # others are not loaded yet
            self._scenarios()
        beyond_paper = (
            self.aircraft.aircraft()._replace(t_max=PAPER.t_max) != PAPER or self.family.share > 0.0
        )
        if self.network.feature_set != "set" and beyond_paper:
            raise ConfigError(
                f"network.feature_set is {self.network.feature_set}, for the paper's aircraft "
                "alone; expected set "
                "with another aircraft or a family"
            )
        if self.network.inputs and self.network.feature_set != "set":
            raise ConfigError(
                f"network.feature_set is {self.network.feature_set}; expected set with "
                "network.inputs"
            )
        if self.algorithm != PPO and not is_extension(self.algorithm):
            raise ConfigError(
                f"algorithm is {self.algorithm!r}; expected ppo, or module:name of your own"
            )
        if self.algorithm == PPO and self.algorithm_settings:
            raise ConfigError(
                f"algorithm_settings has {', '.join(self.algorithm_settings)}; expected none, as "
                "the settings of ppo stand in ppo"
            )
        if self.algorithm == PPO:
            minibatch, segment = self.ppo.minibatch, self.ppo.segment
            _check_divisor("ppo.minibatch", minibatch, "environments times rollout", self.samples)
            _check_divisor("ppo.segment", segment, "rollout", self.rollout)
            _check_divisor("ppo.segment", segment, "ppo.minibatch", minibatch)
        if self.phases:
            self.phase_configs()  # refuses a phase that is not right
        return self


def configuration_of_run(source: Path | str) -> TrainConfig:
    """Return the configuration that a run wrote, a file or its text; that of an earlier release
    with its keys where they are today.

    Raises:
        ConfigError: it cannot be read, or a key or a value is not valid.
    """
    try:
        values = read(source)
    except YamlError as problem:
        raise ConfigError(str(problem)) from None
    return validate(TrainConfig, upgrade(values), source if isinstance(source, Path) else None)


def upgrade(values: Any) -> Any:
    """Return the keys of a training's configuration, or of a phase, with those that an earlier
    release had in other places where they are today.
    """
    if not isinstance(values, dict):
        return values
    upgraded = dict(values)
    if isinstance(values.get("phases"), list):
        upgraded["phases"] = [upgrade(phase) for phase in values["phases"]]
    if isinstance(values.get("ppo"), dict):
        moved = PpoConfig.MOVED
        upgraded["ppo"] = {k: v for k, v in values["ppo"].items() if k not in moved}
        upgraded |= {moved[k]: v for k, v in values["ppo"].items() if k in moved}
    return upgraded


def _merge(common: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return nested keys with some of them changed.

    ``{a: 1, b: {c: 2, d: 3}}`` with the changes ``{b: {c: 4}}`` gives ``{a: 1, b: {c: 4, d: 3}}``.
    """
    merged = dict(common)
    for key, value in changes.items():
        before = merged.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            merged[key] = _merge(before, value)
        else:
            merged[key] = value
    return merged


def _check_divisor(name: str, part: int, whole_name: str, whole: int) -> None:
    """Raise a ConfigError where the value of a key does not divide a whole number."""
    if whole % part:
        raise ConfigError(
            f"{name} is {part}; expected a divisor of {whole_name}, {whole}, such as "
            f"{_nearest_divisor(whole, part)}"
        )


def _nearest_divisor(whole: int, number: int) -> int:
    """Return the divisor of a whole number that is nearest to another number, the smaller of two.

    Of 12 and 5 it is 4, not 6.
    """
    divisors: set[int] = set()
    for small in range(1, math.isqrt(whole) + 1):
        if whole % small == 0:
            divisors |= {small, whole // small}
    return min(divisors, key=lambda divisor: (abs(divisor - number), divisor))
