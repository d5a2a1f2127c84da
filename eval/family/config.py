"""Configuration of a policy's flights with random aircraft."""

from typing import Literal

from pydantic import Field, field_validator, model_validator

from agents.config.load import ConfigError
from agents.config.world import known_scenario
from eval.config import PREFIXES, PolicyConfig


class FamilyConfig(PolicyConfig):
    """Random aircraft and their encounters; the defaults fly the shipped policy with twenty."""

    extensions: tuple[str, ...] = Field(default=(), max_length=64)
    """Inputs that the policy needs, and scenarios, of your own, `module:name` each; they are
    imported."""
    allow_outside_domain: bool = False
    """Whether aircraft, and more intruders, than the policy was trained for are flown all the same.
    """
    aircraft_seed: int = Field(default=0, ge=0)
    """Seed of the aircraft."""
    count: int = Field(default=20, ge=1)
    """How many aircraft are drawn."""
    encounters: int = Field(default=500, ge=1, le=100_000_000)
    """How many encounters each aircraft flies."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of encounters and sensor noise."""
    scenario: str = "circle"
    """A sampled scenario; module:name for your own, which is imported."""
    intruders: tuple[int, int] = (1, 1)
    """Fewest and most intruders of an encounter, at least 1."""
    turning: bool = False
    """Whether each intruder turns once, at up to the ownship's turn rate."""
    noisy: bool = False
    """Whether intruders are reported with the errors and latency of the scenario noisy."""
    mode: Literal["policy", "plan", "assured"] = "policy"
    """What decides."""
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """Confidence of all intervals."""
    workers: int = Field(default=0, ge=0, le=1024)
    """Processes that fly; 0: as many as there are cores. It changes no result."""

    @field_validator("scenario")
    @classmethod
    def _scenario(cls, name: str) -> str:
        if name.startswith(PREFIXES):
            raise ConfigError(f"{name!r} is a file; expected a sampled scenario")
        return known_scenario(name)

    @field_validator("intruders")
    @classmethod
    def _intruders(cls, span: tuple[int, int]) -> tuple[int, int]:
        if not 1 <= span[0] <= span[1]:
            raise ConfigError("expected the fewest first, then the most, at least 1")
        return span

    @model_validator(mode="after")
    def _check(self) -> "FamilyConfig":
        if self.noisy and self.scenario != "circle":
            raise ConfigError(
                f"noisy is a scenario of its own; expected scenario circle, not {self.scenario}"
            )
        return self
