"""The parts of a configuration that describe the world: the task, the vehicle's limits and the
scenarios.

Training and evaluation share them, so that a vehicle file or a changed scenario means the same in
both. Angles are in degrees here, as the keys say, and radians in what the models return.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_serializer, model_validator

from agents.config.load import AIRCRAFT, VEHICLES, ConfigError, Strict, file_of, load
from envs.aircraft import (
    GREATEST_VERTICAL,
    LEAST_VERTICAL,
    PAPER,
    Aircraft,
    Vertical,
    new_aircraft,
)
from envs.encounters import EncounterError, Scenario
from envs.kinematics import FASTEST, SURROGATE, Limits
from envs.scenarios import canonical, expected, scenario


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 9)


_SpeedMin = Annotated[float, Field(ge=0.0, le=FASTEST.speed_min)]
_SpeedMax = Annotated[float, Field(gt=0.0, le=FASTEST.speed_max)]
_AccelerationMin = Annotated[float, Field(ge=FASTEST.acceleration_min, lt=0.0)]
_AccelerationMax = Annotated[float, Field(gt=0.0, le=FASTEST.acceleration_max)]
_YawRateMax = Annotated[float, Field(ge=0.01, le=_degrees(FASTEST.yaw_rate_max))]


def _vertical_key(name: str) -> Any:
    """Return the key of a number of :class:`envs.aircraft.Vertical`: optional, with its range."""
    low, high = (getattr(bounds, name) for bounds in (LEAST_VERTICAL, GREATEST_VERTICAL))
    return Field(default=None, ge=low, le=high)


class VehicleConfig(Strict):
    """Limits of the ownship, inline or as the path of a YAML file with these keys or the name of
    one that ships. All five are stated: none is filled in from another aircraft.

    A path is looked for beside the configuration file first and then in the working directory.
    """

    KIND: ClassVar = VEHICLES
    STATED: ClassVar[tuple[str, ...]] = (
        "speed_min_mps",
        "speed_max_mps",
        "acceleration_min_mps2",
        "acceleration_max_mps2",
        "yaw_rate_max_deg_s",
    )
    """What a file states: left out, it would be another aircraft's."""

    speed_min_mps: _SpeedMin
    """Lowest speed, m/s."""
    speed_max_mps: _SpeedMax
    """Highest speed, m/s."""
    acceleration_min_mps2: _AccelerationMin
    """Strongest deceleration, m/s^2, negative."""
    acceleration_max_mps2: _AccelerationMax
    """Strongest acceleration, m/s^2."""
    yaw_rate_max_deg_s: _YawRateMax
    """Largest turn rate to either side, deg/s."""

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, (str, Path)):
            return data
        beside = Path((info.context or {}).get("folder", "")) / data
        path = beside if beside.is_file() else file_of(Path(data), cls.KIND)
        # The values, not the path: a run's own configuration must not depend on another file.
        return cls.of_file(path).model_dump()

    @classmethod
    def of_file(cls, path: Path) -> Self:
        """Return what a file or a name that ships states; raise a ConfigError where one of the
        numbers that say which aircraft it is is missing.
        """
        vehicle = load(cls, file_of(path, cls.KIND))
        missing = [name for name in cls.STATED if name not in vehicle.model_fields_set]
        if missing:
            raise ConfigError(f"{path}: {missing[0]} is missing; expected {', '.join(cls.STATED)}")
        return vehicle

    @model_validator(mode="after")
    def _check(self) -> "VehicleConfig":
        if self.speed_min_mps >= self.speed_max_mps:
            raise ConfigError(
                f"speed_min_mps is {self.speed_min_mps}; expected less than speed_max_mps, "
                f"{self.speed_max_mps}"
            )
        return self

    def limits(self) -> Limits:
        """Return the limits as the world's functions take them."""
        accelerations = self.acceleration_min_mps2, self.acceleration_max_mps2
        return Limits(
            self.speed_min_mps,
            self.speed_max_mps,
            *accelerations,
            math.radians(self.yaw_rate_max_deg_s),
        )


class AircraftConfig(VehicleConfig):
    """The ownship and its task, inline, as the path of a file, or as the name of one that ships,
    such as `uas`.
    """

    KIND: ClassVar = AIRCRAFT
    STATED: ClassVar[tuple[str, ...]] = (*VehicleConfig.STATED, "separation_m")
    VERTICAL: ClassVar[tuple[str, ...]] = (
        "climb_max_mps",
        "descent_max_mps",
        "vertical_acceleration_mps2",
        "vertical_separation_m",
    )
    """What a file states all of or nothing of; in the order of :class:`envs.aircraft.Vertical`."""

    speed_min_mps: _SpeedMin = SURROGATE.speed_min
    """Lowest speed, m/s."""
    speed_max_mps: _SpeedMax = SURROGATE.speed_max
    """Highest speed, m/s."""
    acceleration_min_mps2: _AccelerationMin = SURROGATE.acceleration_min
    """Strongest deceleration, m/s^2, negative."""
    acceleration_max_mps2: _AccelerationMax = SURROGATE.acceleration_max
    """Strongest acceleration, m/s^2."""
    yaw_rate_max_deg_s: _YawRateMax = _degrees(SURROGATE.yaw_rate_max)
    """Largest turn rate to either side, deg/s."""
    separation_m: float = Field(default=PAPER.separation, ge=1.0, le=1e6)
    """Required horizontal separation, m: an encounter is lost below it."""
    goal_radius_m: float | None = Field(default=None, gt=0.0)
    """Distance from the goal at which it counts as reached, m; null: half the separation."""
    traffic_speed_max_mps: float | None = Field(default=None, gt=0.0)
    """Highest speed of the intruders, m/s; null: 1.5 times the ownship's."""
    dt_s: float | None = Field(default=None, gt=0.0)
    """Time step of decisions, s; null: a tenth of the separation at the highest speed, with two
    digits.
    """
    t_max_s: float | None = Field(default=None, gt=0.0)
    """Time after which the goal counts as missed, s, a whole number of time steps; null: 300 of
    them.
    """
    vehicle: VehicleConfig | None = Field(
        default=None,
        json_schema_extra={
            "expected": "null, the path of a YAML file, a name that ships, or a group of keys"
        },
    )
    """What the vehicle itself can do, where decisions keep to more conservative limits: legs of
    plans obey it. All five limits. null: the limits above, which no plan called SAFE exceeds."""
    climb_max_mps: float | None = _vertical_key("climb_max")
    """Fastest climb, m/s, held at every speed and in every turn within the limits; it is stated
    with the next three keys, or all four are null: the aircraft plans in the plane."""
    descent_max_mps: float | None = _vertical_key("descent_max")
    """Fastest descent, m/s, positive, held at every speed and in every turn within the limits."""
    vertical_acceleration_mps2: float | None = _vertical_key("acceleration")
    """Acceleration with which a climb or a descent changes, m/s^2."""
    vertical_separation_m: float | None = _vertical_key("separation")
    """Required vertical separation, m: an intruder that is so far above or below is clear."""

    @model_validator(mode="after")
    def _check(self) -> "AircraftConfig":
        self.aircraft()
        return self

    @model_serializer(mode="wrap")
    def _without_vertical(self, handler: Any) -> dict[str, Any]:
        # An aircraft that plans in the plane is written as in earlier releases: the same run has
        # the same configuration, and a training the same policy file, to the last bit.
        return {
            key: value
            for key, value in handler(self).items()
            if key not in self.VERTICAL or value is not None
        }

    def aircraft(self) -> Aircraft:
        """Return the aircraft as the world's functions take it."""
        return new_aircraft(
            self.limits(),
            self.separation_m,
            goal_radius=self.goal_radius_m,
            traffic_speed_max=self.traffic_speed_max_mps,
            dt=self.dt_s,
            t_max=self.t_max_s,
            vehicle=None if self.vehicle is None else self.vehicle.limits(),
            vertical=self._vertical(),
        )

    def _vertical(self) -> Vertical | None:
        """Return what the aircraft can do up and down, None where nothing is stated; raise a
        ConfigError where a part is missing.
        """
        numbers = {name: getattr(self, name) for name in self.VERTICAL}
        missing = [name for name, number in numbers.items() if number is None]
        if len(missing) == len(numbers):
            return None
        if missing:
            raise ConfigError(
                f"{missing[0]} is missing; expected all of {', '.join(self.VERTICAL)}, or none"
            )
        return Vertical(*numbers.values())


def _paper_aircraft() -> AircraftConfig:
    """Return the paper's aircraft, which has a vehicle of its own."""
    vehicle = PAPER.vehicle_limits
    return AircraftConfig(
        vehicle=VehicleConfig(
            speed_min_mps=vehicle.speed_min,
            speed_max_mps=vehicle.speed_max,
            acceleration_min_mps2=vehicle.acceleration_min,
            acceleration_max_mps2=vehicle.acceleration_max,
            yaw_rate_max_deg_s=_degrees(vehicle.yaw_rate_max),
        ),
    )


PAPER_AIRCRAFT = _paper_aircraft()
"""The paper's aircraft, where a configuration names none."""


_Range = tuple[float, float]
_DEGREES = ("course_difference_deg", "turn_rate_deg_s", "heading_change_deg")
_UNITS: dict[str, Callable[[Aircraft], float]] = {
    **dict.fromkeys(
        (
            "radius",
            "displacement",
            "min_initial_separation",
            "conflicts_closer_than",
            "position_std",
        ),
        lambda aircraft: aircraft.separation,
    ),
    **dict.fromkeys(
        ("own_speed", "intruder_speed", "velocity_std"), lambda aircraft: aircraft.limits.speed_max
    ),
    "latency": lambda aircraft: aircraft.dt,
}
"""What a number of a scenario is multiplied by where its ``units`` are the aircraft's."""


def _map_values(function: Callable[[float], float], value: Any) -> Any:
    return tuple(map(function, value)) if isinstance(value, tuple) else function(value)


def known_scenario(name: str, more: str = "module:name of your own") -> str:
    """Return the name of a scenario whose geometry ships, is registered or may be of the user's
    own, with its modifiers in their order; nothing is imported. Others raise a ConfigError, whose
    message ends the list of geometries with ``more``.
    """
    try:
        return canonical(name, more)
    except EncounterError as problem:
        raise ConfigError(str(problem).removeprefix("scenario ")) from None


class ScenarioConfig(Strict):
    """A scenario, such as ``circle + noise``, with its share of the encounters, some of its numbers
    changed.

    A number that is null is as the scenario has it, scaled by the aircraft.
    """

    name: str = Field(
        default="circle",
        json_schema_extra={"expected": expected()},
    )
    """The scenario that the numbers below change: a geometry, and modifiers of it after +, such as
    circle + standing + partly_seen; `module:name` is an `envs.encounters.Sampler` of your own,
    which uses the numbers that it needs."""
    weight: float = Field(default=1.0, gt=0.0)
    """Share of the encounters, relative to the other scenarios' weights."""
    units: Literal["si", "aircraft"] = "si"
    """Unit of the lengths, speeds and latencies below: si, m, m/s and s as each key says; aircraft,
    required separations, highest speeds of the ownship and time steps, so that the same file serves
    any aircraft."""
    radius: _Range | None = None
    """Range of the ownship's distance from the conflict point, m; the goal lies as far behind it.
    """
    own_speed: _Range | None = None
    """Range of the ownship's initial speed, m/s."""
    intruder_speed: _Range | None = None
    """Range of the intruders' speed, m/s."""
    course_difference_deg: _Range | None = None
    """Range of the intruder's course minus the ownship's, degrees clockwise: +90 comes from the
    left.
    """
    displacement: float | None = Field(default=None, ge=0.0)
    """Every start is moved by up to this in x and in y, m."""
    min_initial_separation: float | None = Field(default=None, ge=0.0)
    """Starts closer than this are redrawn, m; 0 keeps them all."""
    conflicts_closer_than: float | None = Field(default=None, gt=0.0)
    """Only starts whose straight courses pass closer than this are kept, m; a large number keeps
    them all.
    """
    intruders: tuple[int, int] | None = None
    """Fewest and most intruders, 1 to 64."""
    turn_rate_deg_s: float | None = Field(default=None, ge=0.0, le=57.0)
    """Largest rate of each intruder's one turn, deg/s; 0: it flies straight on."""
    heading_change_deg: float | None = Field(default=None, ge=0.0, le=180.0)
    """Largest heading change of that turn, degrees."""
    position_std: float | None = Field(default=None, ge=0.0)
    """Noise of reported positions, one sigma per axis, m."""
    velocity_std: float | None = Field(default=None, ge=0.0)
    """Noise of reported velocities, one sigma per axis, m/s."""
    latency: _Range | None = None
    """Range of the age of the reports, s, up to two time steps."""
    vertical_miss: float | None = Field(default=None, ge=0.0)
    """Greatest vertical distance at the closest approach, m, with modifier layered; null: two
    vertical separations."""
    vertical_rate: _Range | None = None
    """Range of the vertical speed of its intruders that climb or descend, m/s; null: 2.54 to 7.62
    (500 to 1500 ft/min)."""
    attempts: int | None = Field(default=None, ge=1, le=1000)
    """How many draws an encounter has to meet the conditions, where encounters are numbered;
    training instead fills its pool with starts that do."""

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        return known_scenario(name)

    @model_serializer(mode="wrap")
    def _without_null(self, handler: Any) -> dict[str, Any]:
        return {
            key: value
            for key, value in handler(self).items()
            if value is not None and (key, value) != ("units", "si")
        }

    def scenario(self, aircraft: Aircraft) -> Scenario:
        """Return the scenario of an aircraft with its numbers changed; a contradiction raises a
        ConfigError.
        """
        changes: dict[str, Any] = {}
        for key, value in self.model_dump(exclude={"name", "weight", "units"}).items():
            if key in _DEGREES:
                changes[key.removesuffix("_s").removesuffix("_deg")] = _map_values(
                    math.radians, value
                )
            elif self.units == "aircraft" and key in _UNITS:
                unit = _UNITS[key](aircraft)
                changes[key] = _map_values(lambda number, unit=unit: number * unit, value)
            else:
                changes[key] = value
        try:
            return scenario(self.name, aircraft, **changes)
        except EncounterError as problem:
            raise ConfigError(str(problem)) from None
