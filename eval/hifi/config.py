"""Configuration of flights of the true aircraft: the keys of ``eval.monte_carlo``, and conditions
and vehicle.
"""

import math
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_serializer, model_validator

from agents.config.load import ConfigError, Strict
from envs import draws
from envs.c208.conditions import TURBULENCE, Conditions, Loading
from envs.encounters import Encounter
from envs.profile import Height
from envs.scenarios.layered import begin_height
from envs.wind import Wind
from eval.config import FILE, MonteCarloConfig

_CHUNK = 8
_FACTORS = ("inertia_factor", "drag_factor", "lift_slope_factor")
_STREAM = 1 << 40  # of the draws; the lower ones belong to starts and to the sensors' noise by step

_ABOVE, _CLIMB = 5_000.0, 50.0  # m and m/s, of intruders at most

_Range = tuple[float, float]
_WIND: dict[str, Any] = {"wind_mps": (0.0, 15.0)}
_LOADED: dict[str, Any] = {
    "weight_lb": (6500.0, 8807.0),
    "centre_of_gravity": (0.25, 0.38),
    "inertia_factor": (0.7, 1.3),
    "drag_factor": (0.92, 1.08),
    "lift_slope_factor": (0.95, 1.05),
}
_MIXED = (
    _LOADED
    | _WIND
    | {"turbulence": tuple(TURBULENCE), "wind_error_mps": 1.0, "own_position_std": 5.0}
)

CONDITIONS: dict[str, dict[str, Any]] = {
    "calm": {},
    "loaded": _LOADED,
    "wind": _WIND,
    "light": _WIND | {"turbulence": ("light",)},
    "moderate": _WIND | {"turbulence": ("moderate",)},
    "mixed": _MIXED,
    "noisy": _MIXED | {"position_std": 30.0, "velocity_std": 3.0, "latency": (1.0, 2.0)},
}
"""The families by name, as what they change of calm: each thing alone, all but the intruders'
sensors, everything.
"""

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


class ConditionConfig(Strict):
    """A family of conditions, some of its numbers changed; pairs are ranges of uniform draws.

    The defaults are those of calm; another family has others where its name says so.
    """

    name: Literal["calm", "loaded", "wind", "light", "moderate", "mixed", "noisy"] = "calm"
    """The family that the numbers below change."""
    weight_lb: _Range | None = None
    """Range of the weight with fuel, lb, within 5500 to 8900; null: the variant's greatest."""
    centre_of_gravity: _Range = (0.32, 0.32)
    """Range of the centre of gravity, share of the mean chord, within 0.15 to 0.4033."""
    inertia_factor: _Range = (1.0, 1.0)
    """Range of the factor on all moments of inertia, within 0.5 to 2."""
    drag_factor: _Range = (1.0, 1.0)
    """Range of the factor on the zero-lift drag, within 0.7 to 1.5."""
    lift_slope_factor: _Range = (1.0, 1.0)
    """Range of the factor on the lift curve's slope, within 0.8 to 1.2."""
    altitude_m: _Range = (2500.0, 2500.0)
    """Range of the altitude that is held, m above the sea, within 300 to 7000."""
    wind_mps: _Range = (0.0, 0.0)
    """Range of the wind's speed, m/s, within 0 to 30; it blows to any direction."""
    turbulence: tuple[str, ...] = ("none",)
    """Turbulence of MIL-F-8785C: none, light or moderate; one of those named is drawn."""
    wind_error_mps: float = Field(default=0.0, ge=0.0, le=15.0)
    """Error with which the planner knows the wind, one sigma per axis, m/s; its plans keep the
    limits in every wind within two of them."""
    position_std: float = Field(default=0.0, ge=0.0, le=1_000.0)
    """Noise of the intruders' reported positions, one sigma per axis, m."""
    velocity_std: float = Field(default=0.0, ge=0.0, le=50.0)
    """Noise of the intruders' reported velocities, one sigma per axis, m/s."""
    latency: _Range = (0.0, 0.0)
    """Range of the age of the intruders' reports, s, within 0 to 2."""
    own_position_std: float = Field(default=0.0, ge=0.0, le=100.0)
    """Error of the own navigation, one sigma per axis, m; it changes within a minute."""

    @model_validator(mode="before")
    @classmethod
    def _of_family(cls, data: Any) -> Any:
        return CONDITIONS.get(str(data.get("name")), {}) | data if isinstance(data, dict) else data

    @model_validator(mode="after")
    def _check(self) -> "ConditionConfig":
        for key, (low, high) in _BOUNDS.items():
            pair = getattr(self, key)
            if pair is not None and not low <= pair[0] <= pair[1] <= high:
                raise ConfigError(
                    f"{key} is [{pair[0]}, {pair[1]}]; expected [low, high] within {low} to {high}"
                )
        if not self.turbulence or set(self.turbulence) - set(TURBULENCE):
            raise ConfigError(
                f"turbulence is {list(self.turbulence)}; expected a list of {', '.join(TURBULENCE)}"
            )
        return self

    @model_serializer(mode="wrap")
    def _change(self, handler: Any) -> dict[str, Any]:
        usual = {key: field.default for key, field in type(self).model_fields.items()} | CONDITIONS[
            self.name
        ]
        return {
            key: value
            for key, value in handler(self).items()
            if key == "name" or getattr(self, key) != usual[key]
        }


class HifiConfig(MonteCarloConfig):
    """Flights of the true aircraft; the defaults fly plans of the shipped policy once, in
    calm air.
    """

    # Recorded intruders fly over the ground, and here all aircraft fly in the air mass.
    files: ClassVar[tuple[str, ...]] = (FILE,)

    mode: Literal["plan", "closed", "assured"] = "plan"  # pyright: ignore[reportIncompatibleVariableOverride]
    """What decides: plan, the planner once at the start, then the plan is followed; closed, the
    network alone, once a second; assured, the plan under a monitor that asks for new plans and
    falls back to a backup."""
    vehicle: Literal["c208_ex", "c208", "point_mass", "surrogate"] = "c208_ex"
    """What flies: c208_ex or c208 (675 shp) in JSBSim, point_mass (its lags and limits alone),
    surrogate.
    """
    condition: ConditionConfig = ConditionConfig()
    above_m: _Range = (0.0, 0.0)
    """Range of the intruders' height above the ownship, m, where they would be closest if all flew
    straight on; where plans may climb."""
    climb_mps: _Range = (0.0, 0.0)
    """Range of the vertical speed of every other intruder, m/s; the others fly level."""

    @model_validator(mode="after")
    def _check_levels(self) -> "HifiConfig":
        if self.planner.maneuvers != "horizontal" and self.mode == "closed":
            raise ConfigError(
                f"planner.maneuvers is {self.planner.maneuvers!r}; expected horizontal in mode "
                "closed, which holds its altitude"
            )
        for key, most in (("above_m", _ABOVE), ("climb_mps", _CLIMB)):
            low, high = getattr(self, key)
            if not -most <= low <= high <= most:
                raise ConfigError(
                    f"{key} is [{low:g}, {high:g}]; expected [low, high] within {-most:g} to "
                    f"{most:g}"
                )
            if (low, high) != (0.0, 0.0) and self.planner.maneuvers == "horizontal":
                raise ConfigError(
                    f"{key} is [{low:g}, {high:g}]; expected [0, 0] with planner.maneuvers "
                    "horizontal, whose flights are at one level"
                )
        return self

    @model_validator(mode="after")
    def _whole(self) -> "HifiConfig":
        if self.wind_mps != (0.0, 0.0):
            raise ConfigError("wind_mps is of eval.monte_carlo; expected condition.wind_mps here")
        if self.areas_file is not None:
            raise ConfigError("areas_file is of eval.monte_carlo; expected null here")
        dt = 1.0 if self.aircraft is None else self.aircraft.aircraft().dt
        if dt != 1.0:
            raise ConfigError(
                f"aircraft.dt_s is {dt:g}; expected 1, the step at which vehicles are flown here"
            )
        if self.vehicle in ("point_mass", "surrogate"):
            family, calm = self.condition, ConditionConfig()
            for key in ("turbulence", "weight_lb", "centre_of_gravity", *_FACTORS):
                if getattr(family, key) != getattr(calm, key):
                    raise ConfigError(
                        f"vehicle {self.vehicle} has one loading and flies in no turbulence "
                        f"(condition.{key}); "
                        "expected c208_ex or c208, or the condition calm or wind"
                    )
        return self

    @property
    def default_count(self) -> int:
        """Number of flights where no file says otherwise."""
        return 200 if self.encounters is None else self.encounters

    def chunk_for(self, encounters: int, workers: int) -> int:
        """Return the size of the chunks: small, so that an interruption loses little."""
        return self.chunk or max(1, min(_CHUNK, -(-encounters // workers)))


class LevelRanges(NamedTuple):
    """Ranges from which heights of intruders are drawn."""

    above: _Range  # the ownship, m, where they would be closest if all flew straight on
    climb: _Range  # of every other one, m/s


class Drawn(NamedTuple):
    """The conditions of one flight."""

    air: Conditions
    altitude: float  # m above the sea
    believed_wind: Wind  # as the planner knows it, with its uncertainty
    latency: float  # of the intruders' reports, s


def draw_conditions(
    family: ConditionConfig, seed: int, number: int, takeoff_weight: float
) -> Drawn:
    """Return the conditions of flight ``number`` of a seed; the takeoff weight, lb, where the
    family leaves it open.
    """
    u = draws.uniforms(seed, number, 1, (12,), stream=_STREAM)[0].tolist()
    gauss = draws.normals(seed, number, 1, (2,), stream=_STREAM + 1)[0].tolist()
    wind, direction = _between(family.wind_mps, u[0]), 2.0 * math.pi * u[1]
    east, north = wind * math.cos(direction), wind * math.sin(direction)
    weights = (takeoff_weight, takeoff_weight) if family.weight_lb is None else family.weight_lb
    loading = Loading(
        weight=_between(weights, u[2]),
        centre_of_gravity=_between(family.centre_of_gravity, u[3]),
        inertia_factor=_between(family.inertia_factor, u[4]),
        drag_factor=_between(family.drag_factor, u[5]),
        lift_slope_factor=_between(family.lift_slope_factor, u[6]),
    )
    kinds = family.turbulence
    kind: Any = kinds[min(int(u[7] * len(kinds)), len(kinds) - 1)]
    conditions = Conditions(loading, east, north, kind, int(u[8] * 2**31))
    error = family.wind_error_mps
    believed = Wind(east + error * gauss[0], north + error * gauss[1], error)
    return Drawn(
        conditions, _between(family.altitude_m, u[9]), believed, _between(family.latency, u[10])
    )


def draw_heights(
    encounter: Encounter, levels: LevelRanges, altitude: float, seed: int, number: int
) -> Height:
    """Return where intruders begin up and down, which then climb evenly, ``[1, K]``.

    Args:
        encounter: number ``number`` of a seed, ``[1]``.
        levels: ranges of the draws.
        altitude: of the ownship, m.
        seed: of the draws.
        number: of the flight.
    """
    u = draws.uniforms(seed, number, 1, (3, encounter.mask.shape[-1]), stream=_STREAM + 3)
    above, climb = (low + (high - low) * u[:, row] for row, (low, high) in enumerate(levels))
    climb = np.where(u[:, 2] < 0.5, climb, 0.0)
    return Height(begin_height(encounter, altitude, above, climb, np), climb)


def _between(bounds: tuple[float, float], draw: float) -> float:
    low, high = bounds
    return low + (high - low) * draw
