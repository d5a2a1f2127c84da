"""Configuration of flights of the true aircraft: the keys of ``eval.monte_carlo``, and conditions and vehicle."""

from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from agents.config.load import ConfigError
from eval.config import FILE, MonteCarloConfig
from eval.hifi.conditions import ConditionConfig

__all__ = ["VEHICLES", "HifiConfig"]

VEHICLES = ("c208_ex", "c208", "point_mass", "surrogate")
"""What flies."""

_CHUNK = 8
_FACTORS = ("inertia_factor", "drag_factor", "lift_slope_factor")


class HifiConfig(MonteCarloConfig):
    """Flights of the true aircraft; the defaults fly plans of the shipped policy once, in calm air."""

    # Recorded intruders fly over the ground, and here all aircraft fly in the air mass.
    files: ClassVar[tuple[str, ...]] = (FILE,)
    quasi: ClassVar[bool] = False
    modes: ClassVar[tuple[str, ...]] = ("plan", "closed", "assured")
    baselines: ClassVar[tuple[str, ...]] = ("none",)

    mode: str = Field(default="plan", json_schema_extra={"expected": "plan, closed or assured"})
    """What decides: plan, the planner once at the start, whose plan is then followed; closed, the network alone, once
    a second; assured, the plan under a monitor that asks for new plans and falls back to a backup."""
    vehicle: Literal["c208_ex", "c208", "point_mass", "surrogate"] = "c208_ex"
    """What flies: c208_ex or c208 (675 shp) in JSBSim, point_mass (its lags and limits alone), surrogate."""
    condition: ConditionConfig = ConditionConfig()
    wind_plan: Literal["air", "ground"] = "air"
    """How the wind is met: air, the planner works in the air mass and the plan drifts with it; ground, without wind,
    and a plan whose air speeds leave the envelope in the true wind is refused."""

    @model_validator(mode="before")
    @classmethod
    def _old_key(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("aircraft") in VEHICLES:
            raise ConfigError(f"aircraft is now called vehicle where it names what flies, {data['aircraft']}")
        return data

    @model_validator(mode="after")
    def _whole(self) -> "HifiConfig":
        dt = 1.0 if self.aircraft is None else self.aircraft.aircraft().dt
        if dt != 1.0:
            raise ConfigError(f"aircraft.dt_s is {dt:g}; expected 1, the step at which vehicles are flown here")
        if self.vehicle in ("point_mass", "surrogate"):
            family, calm = self.condition, ConditionConfig()
            for key in ("turbulence", "weight_lb", "centre_of_gravity", *_FACTORS):
                if getattr(family, key) != getattr(calm, key):
                    raise ConfigError(
                        f"vehicle {self.vehicle} has one loading and flies in no turbulence (condition.{key}); "
                        "expected c208_ex or c208, or the condition calm or wind"
                    )
        return self

    @property
    def wanted(self) -> int:
        """Number of flights where no file says otherwise."""
        return 200 if self.encounters is None else self.encounters

    def chunk_for(self, encounters: int, workers: int) -> int:
        """Return the size of the chunks: a flight takes a second, and what is interrupted shall lose little."""
        return self.chunk or max(1, min(_CHUNK, -(-encounters // workers)))
