"""Configuration of flights of the true aircraft: the keys of ``eval.monte_carlo``, and conditions and vehicle."""

from dataclasses import replace
from typing import Any, ClassVar

from pydantic import Field, ValidationInfo, field_validator, model_serializer, model_validator

from agents.config.keys import nearest
from agents.config.load import ConfigError, Strict
from envs.c208.conditions import TURBULENCE
from eval.config import FILE, MonteCarloConfig
from eval.hifi.conditions import CONDITIONS, Family

__all__ = ["HIFI_MODES", "VEHICLES", "ConditionConfig", "HifiConfig"]

HIFI_MODES = ("plan", "closed", "assured")
"""What decides: a plan made at the start; the network once a second; a plan under the run-time monitor."""

VEHICLES = ("c208_ex", "c208", "point_mass", "surrogate")
"""What flies."""

_CHUNK = 8
_Range = tuple[float, float]
_BOUNDS: dict[str, _Range] = {
    "weight_lb": (5500.0, 8900.0),
    "centre_of_gravity": (0.15, 0.4033),
    "inertia_factor": (0.5, 2.0),
    "drag_factor": (0.7, 1.5),
    "lift_slope_factor": (0.8, 1.2),
    "altitude_m": (300.0, 7000.0),
    "wind_mps": (0.0, 30.0),
    "latency": (0.0, 2.0),
}


def _one_of(value: str, known: tuple[str, ...]) -> str:
    if value not in known:
        close = nearest(value, known)
        hint = f"; did you mean {close}?" if close else ""
        raise ConfigError(f"{value!r} is unknown; expected one of {', '.join(known)}{hint}")
    return value


class ConditionConfig(Strict):
    """A family of conditions, some of its numbers changed; a number that is null is as the family has it."""

    name: str = Field(default="calm", json_schema_extra={"expected": f"one of {', '.join(CONDITIONS)}"})
    """The family that the numbers below change."""
    weight_lb: _Range | None = None
    """Range of the weight with fuel, lb, within 5500 to 8900; of calm and wind the variant's greatest."""
    centre_of_gravity: _Range | None = None
    """Range of the centre of gravity, share of the mean chord, within 0.15 to 0.4033."""
    inertia_factor: _Range | None = None
    """Range of the factor on all moments of inertia, within 0.5 to 2."""
    drag_factor: _Range | None = None
    """Range of the factor on the zero-lift drag, within 0.7 to 1.5."""
    lift_slope_factor: _Range | None = None
    """Range of the factor on the lift curve's slope, within 0.8 to 1.2."""
    altitude_m: _Range | None = None
    """Range of the altitude that is held, m above the sea, within 300 to 7000."""
    wind_mps: _Range | None = None
    """Range of the wind's speed, m/s, within 0 to 30; it blows to any direction."""
    turbulence: tuple[str, ...] | None = None
    """Turbulence of MIL-F-8785C: none, light or moderate; one of those named is drawn."""
    wind_error_mps: float | None = Field(default=None, ge=0.0, le=15.0)
    """Error with which the planner knows the wind, one sigma per axis, m/s."""
    position_std: float | None = Field(default=None, ge=0.0, le=1_000.0)
    """Noise of the intruders' reported positions, one sigma per axis, m."""
    velocity_std: float | None = Field(default=None, ge=0.0, le=50.0)
    """Noise of the intruders' reported velocities, one sigma per axis, m/s."""
    latency: _Range | None = None
    """Range of the age of the intruders' reports, s, within 0 to 2."""
    own_position_std: float | None = Field(default=None, ge=0.0, le=100.0)
    """Error of the own navigation, one sigma per axis, m; it changes within a minute."""

    @field_validator("name")
    @classmethod
    def _known(cls, name: str) -> str:
        return _one_of(name, tuple(CONDITIONS))

    @model_validator(mode="after")
    def _check(self) -> "ConditionConfig":
        for key, (low, high) in _BOUNDS.items():
            pair = getattr(self, key)
            if pair is not None and not low <= pair[0] <= pair[1] <= high:
                raise ConfigError(f"{key} is [{pair[0]}, {pair[1]}]; expected [low, high] within {low} to {high}")
        if self.turbulence is not None and (not self.turbulence or set(self.turbulence) - set(TURBULENCE)):
            raise ConfigError(f"turbulence is {list(self.turbulence)}; expected a list of {', '.join(TURBULENCE)}")
        return self

    @model_serializer(mode="wrap")
    def _without_null(self, handler: Any) -> dict[str, Any]:
        return {key: value for key, value in handler(self).items() if value is not None}

    def family(self) -> Family:
        """Return the family with its numbers changed."""
        changes = {key: value for key in type(self).model_fields if (value := getattr(self, key)) is not None}
        del changes["name"]
        return replace(CONDITIONS[self.name], **changes)


class HifiConfig(MonteCarloConfig):
    """Flights of the true aircraft; the defaults fly plans of the shipped policy once, in calm air."""

    # Recorded intruders fly over the ground, and here all aircraft fly in the air mass.
    files: ClassVar[tuple[str, ...]] = (FILE,)
    quasi: ClassVar[bool] = False

    mode: str = Field(default="plan", json_schema_extra={"expected": "plan, closed or assured"})
    """What decides: plan, the planner once at the start, whose plan is then followed; closed, the network alone, once
    a second; assured, the plan under a monitor that asks for new plans and falls back to a backup."""
    vehicle: str = Field(default="c208_ex", json_schema_extra={"expected": f"one of {', '.join(VEHICLES)}"})
    """What flies: c208_ex or c208 (675 shp) in JSBSim, point_mass (its lags and limits alone), surrogate."""
    condition: ConditionConfig = ConditionConfig()
    wind_plan: str = Field(default="air", json_schema_extra={"expected": "air or ground"})
    """How the wind is met: air, the planner works in the air mass and the plan drifts with it; ground, without wind,
    and a plan whose air speeds leave the envelope in the true wind is refused."""

    @field_validator("mode", "baseline")
    @classmethod
    def _available(cls, value: str, info: ValidationInfo) -> str:
        return _one_of(value, HIFI_MODES if info.field_name == "mode" else ("none",))

    @field_validator("vehicle", "wind_plan")
    @classmethod
    def _named(cls, value: str, info: ValidationInfo) -> str:
        return _one_of(value, VEHICLES if info.field_name == "vehicle" else ("air", "ground"))

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
            family, calm = self.condition.family(), CONDITIONS["calm"]
            for key in ("turbulence", "weight_lb", "centre_of_gravity", *(k for k in _BOUNDS if k.endswith("factor"))):
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
