"""Configuration of a sensitivity study: a run to be cut into bins, and sweeps to be flown."""

from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator

from agents.config.load import ConfigError
from agents.config.world import known_scenario
from eval.config import PREFIXES, PolicyConfig, locate


class SensitivityConfig(PolicyConfig):
    """A study; without a run and without sweeps there is nothing to show.

    The keys from ``mode`` to ``workers`` are of sweeps, and so is the policy.
    """

    run: Path | None = None
    """Folder of a finished run of eval.monte_carlo or eval.hifi, beside the configuration file or
    in the working directory; null: none."""
    vary: tuple[str, ...] = ()
    """What is swept, `NAME` or `NAME=V1,V2,...` each: position_std (m), velocity_std (m/s), latency
    (s), turn_rate (deg/s)."""
    mode: Literal["policy", "plan", "assured"] = "policy"
    """What decides."""
    scenario: str = "circle"
    """A sampled scenario; module:name for your own, which is imported."""
    extensions: tuple[str, ...] = Field(default=(), max_length=64)
    """Inputs that the policy needs, and scenarios, of your own, `module:name` each; they are
    imported."""
    encounters: int = Field(default=1_000, ge=1, le=100_000_000)
    """How many encounters are flown for each value."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of encounters and noise."""
    settings: tuple[str, ...] = ()
    """Further keys of eval.monte_carlo, `KEY=VALUE` each."""
    workers: int = Field(default=0, ge=0, le=1024)
    """Processes that fly; 0: as many as there are cores. It changes no result."""
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """Confidence of all intervals."""

    @field_validator("run")
    @classmethod
    def _run(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        return None if path is None else locate(path, info)

    @field_validator("scenario")
    @classmethod
    def _scenario(cls, name: str) -> str:
        if name.startswith(PREFIXES):
            raise ConfigError(f"{name!r} has no numbers to vary; expected a sampled scenario")
        return known_scenario(name)
