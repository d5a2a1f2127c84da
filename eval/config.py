"""What a Monte Carlo evaluation can be told: the model behind ``configs/monte_carlo.yaml`` and ``--set``."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, ValidationInfo, field_validator, model_validator

from agents.configuration import ConfigError, Strict
from agents.configuration_keys import nearest
from agents.configuration_world import RulesConfig, ScenarioConfig, VehicleConfig
from agents.request import MARGIN
from envs.encounters import SCENARIOS, Scenario

if TYPE_CHECKING:
    from eval.planned import Setting

__all__ = ["FILE", "MonteCarloConfig", "PlannerConfig"]

FILE = "file:"
"""Prefix of a scenario that is a file of encounters."""

_DEFAULT_ENCOUNTERS = 10_000
_LARGEST_CHUNK = 1_250
_AVAILABLE = {"mode": ("policy", "plan", "assured"), "baseline": ("none",)}


class PlannerConfig(Strict):
    """How plans are made and flown in the modes that plan."""

    margin: float = Field(default=MARGIN, ge=0.0, le=5_000.0)
    """Added to the required separation, m: what the follower may leave of the plan."""
    goal_radius: float = Field(default=500.0, gt=100.0, le=5_000.0)
    """Within which a point of the route counts as rejoined, m."""
    rejoin_by: float = Field(default=300.0, ge=20.0, le=340.0)
    """Latest time of that, s."""
    goals: int = Field(default=3, ge=1, le=10)
    """Points of the route that are tried, the next one first."""
    direct: bool = True
    """Whether the policy's flight ends as soon as the direct way to the goal is clear; otherwise only at the goal."""
    doubtful: float | None = Field(default=1_500.0, ge=0.0)
    """Cost of a safe plan of the policy's above which the fallback is searched too, m; 0: always, null: never."""
    thorough: bool = True
    """Whether the slow refinement is tried before a request is given up."""
    vehicle: VehicleConfig | None = Field(
        default=None, json_schema_extra={"expected": "null, the path of a YAML file, or a group of keys"}
    )
    """Limits of the legs and of the vehicle that follows them; manoeuvres keep inside the surrogate's, too; null: the
    Cessna 208's as the paper states them."""

    def setting(self) -> "Setting":
        """Return this as the planner takes it: manoeuvres inside both the surrogate's limits and the vehicle's.

        Raises:
            ConfigError: there is no speed that both have.
        """
        from agents.request import Options, gentle
        from agents.traffic import Requirement
        from envs.kinematics import C208_PUBLISHED, SURROGATE, within
        from eval.planned import Setting

        limits = C208_PUBLISHED if self.vehicle is None else self.vehicle.limits()
        try:
            manoeuvre = gentle(within(SURROGATE, limits))
        except ValueError as problem:
            raise ConfigError(f"planner.vehicle: {problem}") from None
        options = Options(
            requirement=Requirement(margin=self.margin),
            limits=limits,
            manoeuvre=manoeuvre,
            goal_radius=self.goal_radius,
            rejoin_by=self.rejoin_by,
            direct=self.direct,
            goals=self.goals,
            doubtful=math.inf if self.doubtful is None else self.doubtful,
            thorough=self.thorough,
        )
        return Setting(options, limits)


class MonteCarloConfig(Strict):
    """An evaluation; the defaults fly the shipped policy through the paper's circle encounters."""

    policy: Path | None = None
    """Policy file (.safetensors), looked for beside the configuration file and then in the working directory; null:
    the policy that ships with the toolkit."""
    policy_sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """Digest that the policy must have, so that a repeated run flies the same one; null: any."""
    mode: str = Field(default="policy", json_schema_extra={"expected": "policy, plan or assured"})
    """Who decides: policy, the network alone, once a second; plan, the planner once at the start, whose plan is then
    followed; assured, the same under a monitor that asks for new plans and falls back to a backup."""
    baseline: str = Field(default="none", json_schema_extra={"expected": "none"})
    """What is flown beside for comparison: none, straight along the route without any resolver."""
    scenario: str = Field(
        default="circle", json_schema_extra={"expected": f"one of {', '.join(SCENARIOS)}, or {FILE}PATH"}
    )
    """Where the encounters come from: a scenario's name, or file:PATH for a CSV file of one's own."""
    scenario_sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """SHA-256 that the file of encounters must have; null: any."""
    changes: dict[str, Any] = Field(default={}, json_schema_extra={"expected": "a group of a scenario's numbers"})
    """Numbers of the scenario to change, such as {min_initial_separation: 0}."""
    encounters: int | None = Field(default=None, ge=1, le=100_000_000)
    """How many encounters are flown; null: 10000, or all of a file's."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Of encounters, sensor noise and bootstrap."""
    chunk: int | None = Field(default=None, ge=1, le=100_000)
    """Encounters that are flown together and stored together; null: equal shares of the workers, at most 1250. It
    changes no result."""
    workers: int = Field(default=0, ge=0, le=1024)
    """Processes that fly chunks; 0: as many as there are cores. It changes no result."""
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """Of all intervals."""
    resamples: int = Field(default=2_000, ge=100, le=100_000)
    """Bootstrap resamples behind the intervals of means."""
    rules: RulesConfig = RulesConfig()
    vehicle: VehicleConfig | None = Field(
        default=None, json_schema_extra={"expected": "null, the path of a YAML file, or a group of keys"}
    )
    """Limits of the ownship; null: those that the policy was trained for."""
    planner: PlannerConfig = PlannerConfig()
    figures: bool = True
    """Whether figures are drawn."""

    @field_validator("mode", "baseline")
    @classmethod
    def _available(cls, value: str, info: ValidationInfo) -> str:
        known = _AVAILABLE[str(info.field_name)]
        if value not in known:
            raise ConfigError(f"{value!r} is not available in this version; expected {' or '.join(known)}")
        return value

    @field_validator("policy")
    @classmethod
    def _policy(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        return None if path is None else _located(path, info)

    @field_validator("scenario")
    @classmethod
    def _scenario(cls, name: str, info: ValidationInfo) -> str:
        if name.startswith(FILE):
            if name == FILE:
                raise ConfigError(f"{name!r} names no file; expected {FILE}PATH")
            return f"{FILE}{_located(Path(name.removeprefix(FILE)), info)}"
        if name not in SCENARIOS:
            close = nearest(name, SCENARIOS)
            hint = f"; did you mean {close}?" if close else ""
            raise ConfigError(f"{name!r} is unknown; expected one of {', '.join(SCENARIOS)}, or {FILE}PATH{hint}")
        return name

    @model_validator(mode="after")
    def _check(self) -> "MonteCarloConfig":
        if self.file is None:
            self.sampled()
        elif self.changes:
            raise ConfigError(f"changes: {next(iter(self.changes))} cannot be changed, the encounters stand in a file")
        if self.file is None and self.scenario_sha256 is not None:
            raise ConfigError(f"scenario_sha256 is for a scenario {FILE}PATH, not for {self.scenario!r}; expected null")
        return self

    @property
    def file(self) -> Path | None:
        """The user's file of encounters, None for a sampled scenario."""
        return Path(self.scenario.removeprefix(FILE)) if self.scenario.startswith(FILE) else None

    @property
    def wanted(self) -> int:
        """Number of encounters where no file says otherwise."""
        return _DEFAULT_ENCOUNTERS if self.encounters is None else self.encounters

    def chunk_for(self, encounters: int, workers: int) -> int:
        """Return the size of the chunks of so many encounters among so many workers."""
        share = -(-encounters // workers)
        return self.chunk or -(-share // -(-share // _LARGEST_CHUNK))

    def sampled(self) -> Scenario:
        """Return the sampled scenario with its changes.

        Raises:
            ConfigError: a change names an unknown number or a value outside its range.
        """
        for key in ("name", "weight"):
            if key in self.changes:
                raise ConfigError(f"changes.{key} is unknown; expected a number of the scenario")
        # Through the sentences of the configuration, which name the key and the nearest one.
        from agents.configuration import load

        try:
            written = [f"{key}={_yaml(value)}" for key, value in self.changes.items()]
            return load(ScenarioConfig, None, [f"name={self.scenario}", *written]).scenario()
        except ConfigError as problem:
            raise ConfigError(f"changes.{str(problem).removeprefix('--set: ')}") from None


def _located(path: Path, info: ValidationInfo) -> Path:
    """Return the absolute path of a file that stands beside the configuration or in the working directory."""
    beside = Path((info.context or {}).get("folder", "")) / path
    return (beside if beside.exists() else path).absolute()


def _yaml(value: Any) -> str:
    from agents.configuration_yaml import write

    return write([value])[1:-2] if not isinstance(value, (list, tuple)) else write(value).strip()
