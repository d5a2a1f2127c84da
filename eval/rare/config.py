"""Configuration of an estimate of rare losses: the keys of ``eval.monte_carlo``, and how the
estimate is made.
"""

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from agents.config.load import ConfigError
from eval.config import MonteCarloConfig


class RareConfig(MonteCarloConfig):
    """An estimate; the defaults split the paper's circle encounters, flown by the shipped
    policy.
    """

    # The draws of a sampled scenario are what is copied and moved.
    files: ClassVar[tuple[str, ...]] = ()
    climbs: ClassVar[bool] = False

    mode: Literal["policy", "plan", "none"] = "policy"  # pyright: ignore[reportIncompatibleVariableOverride]
    """What decides: policy, the network alone, once a second; plan, the planner once at the start,
    then the plan is followed; none, nothing: straight to the goal."""
    resolvable_only: bool = False
    """Whether encounters that are proven unresolvable never count."""
    closer_than: float | None = Field(default=None, ge=1e-3, le=1e6)
    """Separations below this count, m, and flights go on after a loss; null: the required
    separation.
    """
    particles: int = Field(default=1_000, ge=10)
    """Encounters at each level."""
    moves: int = Field(default=5, ge=1)
    """Steps of each of them at each level."""
    repetitions: int = Field(default=10, ge=3)
    """Independent estimates, from whose spread the interval follows."""
    encounters_per_hour: float | None = Field(default=None, ge=1e-6, le=1e4)
    """Encounters in an hour of flight, which turn the rate into losses an hour; null: not said."""

    @model_validator(mode="after")
    def _calm(self) -> "RareConfig":
        if self.wind_mps != (0.0, 0.0):
            low, high = self.wind_mps
            raise ConfigError(f"wind_mps is [{low:g}, {high:g}]; expected [0, 0] for rare losses")
        if self.areas_file is not None:
            raise ConfigError(f"areas_file is {self.areas_file}; expected null for rare losses")
        if self.areas:
            raise ConfigError(f"areas is {self.areas}; expected 0 for rare losses")
        return self
