"""The configuration of a Monte Carlo evaluation: the model behind ``configs/monte_carlo.yaml`` and
``--set``.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, TypeVar

from pydantic import Field, ValidationInfo, field_validator, model_validator

from agents.config.load import ConfigError, Strict, validate
from agents.config.world import AircraftConfig, ScenarioConfig, VehicleConfig, known_scenario
from agents.kernel.traffic import Requirement
from agents.planner.answer import RequestError
from agents.planner.request.options import HIGHEST, LOWEST, Maneuvers, Options, check
from agents.policy.inference import Policy
from commands.command import require
from envs.aircraft import Aircraft
from envs.altitudes import REFERENCE
from envs.areas import Level
from envs.encounters import EncounterError, Scenario
from envs.random_areas import MOST
from envs.scenarios import MODIFIERS, expected, is_loaded, sampler_of

FILE, TRACKS, MODEL = "file:", "tracks:", "lincoln:"
PREFIXES: tuple[str, ...] = (FILE, TRACKS, MODEL)
"""Of scenarios that are files: of encounters, of recorded tracks, of an encounter model."""

_Model = TypeVar("_Model", bound=Strict)

_DEFAULT_ENCOUNTERS = 10_000
_LARGEST_CHUNK = 1_250
_COMPILED_FROM = 2_000


class PlannerConfig(Strict):
    """How plans are made and flown in the modes that plan."""

    margin: float | None = Field(default=None, ge=0.0)
    """Added to the required separation, m; null: 0.02 m for the paper's aircraft, others in
    proportion.
    """
    goal_radius: float | None = Field(default=None, gt=0.0)
    """Distance from a point of the route at which the route is rejoined, m; null: the aircraft's.
    """
    rejoin_by: float | None = Field(default=None, gt=0.0)
    """Latest time of rejoining the route, s; null: the aircraft's time limit."""
    goals: int = Field(default=3, ge=1, le=10)
    """Points of the route that are tried, the next one first."""
    direct: bool = True
    """Whether the policy's flight ends as soon as the direct route to the goal is clear; otherwise
    only at the goal.
    """
    fallback_cost_threshold: float | None = Field(default=None, ge=0.0)
    """Cost of the policy's safe plan above which the fallback is searched too, m; 0: always; null:
    1.5 separations.
    """
    exhaustive: bool = True
    """Whether the slow refinement is tried before a request is given up."""
    maneuvers: Literal["horizontal", "vertical", "both"] = "horizontal"
    """What plans may do: horizontal (turns, speeds), vertical (climbs and descents along the route)
    or both; the last two need an aircraft that states how it climbs, in modes plan and assured."""
    floor_m: float | None = Field(default=None, ge=LOWEST, le=HIGHEST)
    """Least altitude of plans that may climb, m, above that which the encounters' altitudes are
    measured from; null: any."""
    ceiling_m: float | None = Field(default=None, ge=LOWEST, le=HIGHEST)
    """Greatest altitude of plans that may climb, likewise."""
    vertical_margin_m: float | None = Field(default=None, ge=0.0, le=5_000.0)
    """Added to the vertical separation of plans that may climb, m; null: what a change of climb
    takes at most."""
    vehicle: VehicleConfig | None = Field(
        default=None,
        json_schema_extra={
            "expected": "null, the path of a YAML file, a name that ships, or a group of keys"
        },
    )
    """Limits of the legs and of the vehicle that follows them, all five; null: what the aircraft
    states of its vehicle.
    """

    def options(self, aircraft: Aircraft) -> Options:
        """Return this as the planner takes it: manoeuvres inside both the aircraft's limits and the
        vehicle's.
        """
        names = {"direct", "goals", "exhaustive", "rejoin_by", "fallback_cost_threshold"}
        changes: dict[str, Any] = self.model_dump(include=names, exclude_none=True)
        changes["maneuvers"] = Maneuvers(self.maneuvers)
        for name, level in (("floor", self.floor_m), ("ceiling", self.ceiling_m)):
            if level is not None:
                changes[name] = Level(level, REFERENCE)
        if self.vertical_margin_m is not None:
            changes["vertical_margin"] = self.vertical_margin_m
        if self.margin is not None:
            changes["requirement"] = Requirement(aircraft.separation, self.margin)
        radius = aircraft.goal_radius if self.goal_radius is None else self.goal_radius
        vehicle = None if self.vehicle is None else self.vehicle.limits()
        try:
            options = Options.for_aircraft(
                aircraft._replace(goal_radius=radius), vehicle, **changes
            )
            check(options)
        except RequestError as problem:
            raise ConfigError(f"planner: {problem}") from None
        except ValueError as problem:
            raise ConfigError(f"planner.vehicle: {problem}") from None
        return options


class TracksConfig(Strict):
    """How recorded tracks become encounters."""

    ahead: float = Field(default=220.0, ge=10.0, le=3_600.0)
    """The goal lies so many seconds ahead on the ownship's first course, at its first speed."""
    repair: bool = False
    """Whether rows that are incomplete, out of order or impossible are dropped, and gaps flown
    along a curve; else: refused.
    """
    max_gap: float = Field(default=5.0, gt=0.0, le=3_600.0)
    """Longest time between two rows of an aircraft, s."""
    within: float = Field(default=5_000.0, gt=0.0, le=100_000.0)
    """Aircraft of ADS-B reports that come this near each other, m, are an encounter."""
    vertical: float = Field(default=300.0, gt=0.0, le=20_000.0)
    """Largest difference of their altitudes at that time, m."""
    altitudes: bool = False
    """Whether intruders fly at their recorded altitudes, and the ownship begins at its own; else
    all are at one level."""
    lead: float = Field(default=120.0, ge=30.0, le=600.0)
    """Seconds before their closest approach at which that encounter begins."""


_Pair = tuple[float, float]
_STRONGEST = 30.0  # m/s of wind


class TrafficConfig(Strict):
    """Encounters with an encounter model's traffic: what ``changes`` can change."""

    own_speed: _Pair | None = None
    """Range of the ownship's speed, m/s; null: the aircraft's."""
    cpa_time: _Pair = (30.0, 180.0)
    """Range of the time of the closest approach without a resolver, s."""
    miss: float | None = Field(default=None, gt=0.0, le=50_000.0)
    """Largest distance there, m; null: the required separation."""
    vertical_miss: float | None = Field(default=None, ge=0.0, le=20_000.0)
    """Largest vertical distance there, m, of an intruder that climbs and descends as the model
    does; null: all are at one level."""
    strata: tuple[tuple[float, float, float], ...] = Field(default=(), max_length=16)
    """Which closest approaches are made likelier, from the nearest outward: [miss, vertical_miss,
    share of the draws] each, in m; the rest is drawn beyond them. The weights undo it."""
    min_initial_separation: float | None = Field(default=None, ge=0.0, le=50_000.0)
    """Starts closer than this, m, are drawn again; null: the required separation."""
    ahead: float = Field(default=220.0, ge=10.0, le=400.0)
    """The goal lies so many seconds ahead at the own speed, s."""
    attempts: int = Field(default=200, ge=1, le=10_000)
    """How many draws an encounter has to meet the conditions."""
    position_std: float = Field(default=0.0, ge=0.0, le=400.0)
    """Noise of reported positions, one sigma per axis, m."""
    velocity_std: float = Field(default=0.0, ge=0.0, le=100.0)
    """Noise of reported velocities, one sigma per axis, m/s."""
    latency: float = Field(default=0.0, ge=0.0, le=20.0)
    """Age of reports when they are used, s; at most two time steps of the aircraft."""
    altitude_std: float = Field(default=0.0, ge=0.0, le=400.0)
    """Error of the intruder's altimeter beside the ownship's, the same in all of an encounter, one
    sigma, m; reports say that they may be off by two of them. With vertical_miss."""
    sensor_range: float | None = Field(default=None, gt=0.0, le=1_000_000.0)
    """Distance beyond which no intruder is reported, m; null: any."""
    field_of_view_deg: float = Field(default=360.0, gt=0.0, le=360.0)
    """Angle ahead of the ownship in which intruders are reported, half of it to either side."""

    @model_validator(mode="after")
    def _check(self) -> "TrafficConfig":
        for key, (least, most) in {"own_speed": (1.0, 300.0), "cpa_time": (0.0, 380.0)}.items():
            low, high = getattr(self, key) or (least, most)
            if not least <= low <= high <= most:
                raise ConfigError(
                    f"{key} is [{low:g}, {high:g}]; expected [low, high] within {least:g} to "
                    f"{most:g}"
                )
        if self.altitude_std > 0.0 and self.vertical_miss is None:
            raise ConfigError(
                f"altitude_std is {self.altitude_std:g} m without vertical_miss; expected 0 where "
                "all are at one level"
            )
        if self.cpa_time[1] > self.ahead:
            raise ConfigError(
                f"cpa_time is up to {self.cpa_time[1]:g} s; expected at most ahead, "
                f"{self.ahead:g} s"
            )
        return self

    @model_validator(mode="after")
    def _check_strata(self) -> "TrafficConfig":
        if not self.strata:
            return self
        if self.vertical_miss is None or self.miss is None:
            raise ConfigError("strata without miss and vertical_miss; expected both with strata")
        inner, shares = (0.0, 0.0), sum(share for _, _, share in self.strata)
        for miss, height, share in (*self.strata, (self.miss, self.vertical_miss, 1.0 - shares)):
            if not (inner[0] <= miss and inner[1] <= height and inner != (miss, height)):
                raise ConfigError(
                    f"strata: [{miss:g}, {height:g}] m after [{inner[0]:g}, {inner[1]:g}] m; "
                    "expected each within the next, the last within miss and vertical_miss"
                )
            if not 0.0 < share < 1.0:
                raise ConfigError(
                    f"strata: a share of {share:g}; expected shares above 0 with a sum below 1"
                )
            inner = (miss, height)
        return self


class EncountersConfig(Strict):
    """Encounters to fly, and how their statistics are made: what all evaluations share."""

    files: ClassVar[tuple[str, ...]] = PREFIXES
    """Scenarios of files that can be flown."""

    extensions: tuple[str, ...] = Field(default=(), max_length=64)
    """Inputs that the policy needs, and scenarios, of your own, `module:name` each; they are
    imported."""
    scenario: str = Field(
        default="circle",
        json_schema_extra={
            "expected": expected(
                f"module:name of your own, or {', '.join(f'{p}PATH' for p in PREFIXES)}"
            )
        },
    )
    """Where the encounters come from: a scenario's name, and modifiers of it after +, such as
    circle + standing + partly_seen; module:name for a sampler of your own, which is imported;
    file:PATH for a CSV file of your own; tracks:PATH for recorded tracks;
    lincoln:PATH for traffic of an encounter model."""
    scenario_sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """SHA-256 that the scenario's file must have; null: any."""
    changes: dict[str, Any] = Field(
        default={}, json_schema_extra={"expected": "a group of a scenario's numbers"}
    )
    """Numbers of the scenario to change, such as {min_initial_separation: 0}."""
    encounters: int | None = Field(default=None, ge=1, le=100_000_000)
    """How many encounters are flown; null: 10000, or all of a file's."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of encounters, sensor noise and bootstrap."""
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """Confidence of all intervals."""
    resamples: int = Field(default=2_000, ge=100, le=100_000)
    """Bootstrap resamples behind the intervals of means."""
    tracks: TracksConfig = TracksConfig()

    @field_validator("scenario")
    @classmethod
    def _scenario(cls, name: str, info: ValidationInfo) -> str:
        prefix = next(
            (prefix_known for prefix_known in PREFIXES if name.startswith(prefix_known)), None
        )
        if prefix is not None:
            if prefix not in cls.files:
                expected = " or ".join(
                    ["a sampled scenario", *(f"{prefix_known}PATH" for prefix_known in cls.files)]
                )
                raise ConfigError(f"{name!r} cannot be flown here; expected {expected}")
            if name == prefix:
                raise ConfigError(f"{name!r} names no file; expected {prefix}PATH")
            if name.rpartition("+")[2].strip() in MODIFIERS:
                raise ConfigError(
                    f"{name!r} has a modifier; expected {prefix}PATH alone, or a geometry before "
                    "the modifier, such as circle + standing"
                )
            return f"{prefix}{locate(Path(name.removeprefix(prefix)), info)}"
        files = ", ".join(f"{prefix_known}PATH" for prefix_known in cls.files)
        own = "module:name of your own"
        return known_scenario(name, f"{own}, or {files}" if files else own)

    @model_validator(mode="after")
    def _check_tracks(self) -> Self:
        if self.prefix == TRACKS:
            return self
        usual = TracksConfig()
        for key, value in self.tracks:
            if value != getattr(usual, key):
                raise ConfigError(
                    f"tracks.{key} is {value} for the scenario {self.scenario!r}; expected it with "
                    f"{TRACKS}PATH alone"
                )
        return self

    @model_validator(mode="after")
    def _check_scenario(self) -> Self:
        if self.file is None:
            # A sampler of the user's own may not have been loaded yet.
            self._scenario_config()
        elif self.prefix == MODEL:
            self.traffic()
        elif self.changes:
            raise ConfigError(
                f"changes: {next(iter(self.changes))} cannot be changed, the encounters stand in "
                "a file"
            )
        if self.file is None and self.scenario_sha256 is not None:
            forms = ", ".join(f"{form}PATH" for form in self.files)
            raise ConfigError(
                f"scenario_sha256 is for a scenario {forms}, not for {self.scenario!r}; expected "
                "null"
            )
        return self

    @property
    def prefix(self) -> str | None:
        """What kind of file the scenario is, one of :data:`PREFIXES`; None for a sampled
        scenario.
        """
        return next((prefix for prefix in PREFIXES if self.scenario.startswith(prefix)), None)

    @property
    def file(self) -> Path | None:
        """The scenario's file, None for a sampled scenario."""
        return None if self.prefix is None else Path(self.scenario.removeprefix(self.prefix))

    @property
    def default_count(self) -> int:
        """Number of encounters where no file says otherwise."""
        return _DEFAULT_ENCOUNTERS if self.encounters is None else self.encounters

    def sampled_scenario(self, aircraft: Aircraft) -> Scenario:
        """Return the sampled scenario of an aircraft; ``ConfigError``: it is of the user's own and
        has not been loaded, or a change is of no number or out of range.
        """
        try:
            sampler_of(self.scenario)
        except EncounterError as problem:
            raise ConfigError(str(problem)) from None
        try:
            return self._scenario_config().scenario(aircraft)
        except ConfigError as problem:
            raise ConfigError(f"changes.{str(problem).removeprefix('changes.')}") from None

    def _scenario_config(self) -> ScenarioConfig:
        for key in ("name", "weight"):
            if key in self.changes:
                raise ConfigError(f"changes.{key} is unknown; expected a number of the scenario")
        return self._change(ScenarioConfig, {"name": self.scenario})

    def traffic(self) -> TrafficConfig:
        """Return what is drawn from an encounter model, with its changes; raises as
        :meth:`sampled`.
        """
        return self._change(TrafficConfig, {})

    def _change(self, model: type[_Model], first: dict[str, Any]) -> _Model:
        try:
            return validate(model, first | self.changes)
        except ConfigError as problem:
            raise ConfigError(f"changes.{problem}") from None


class PolicyConfig(Strict):
    """Which policy is examined."""

    policy: Path | None = None
    """Policy file (.safetensors), beside the configuration file or in the working directory; null:
    the shipped one.
    """
    policy_sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """Digest that the policy must have, so that a repeated run flies the same one; null: any."""

    @field_validator("policy")
    @classmethod
    def _policy(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        return None if path is None else locate(path, info)


class ChunksConfig(EncountersConfig):
    """How many encounters are shared out among the processes that fly them."""

    chunk: int | None = Field(default=None, ge=1, le=100_000)
    """Encounters that are flown together and stored together; null: equal shares of the workers, at
    most 1250 (5000 with backend jax; 500 in a comparison, 100 where it searches for witnesses). It
    changes no result."""
    workers: int = Field(default=0, ge=0, le=1024)
    """Processes that fly chunks; 0: as many as there are cores. It changes no result."""

    @property
    def largest_chunk(self) -> int:
        """Encounters of a chunk at most, where none is configured."""
        return _LARGEST_CHUNK

    def chunk_for(self, encounters: int, workers: int) -> int:
        """Return the size of the chunks of so many encounters among so many workers."""
        share = -(-encounters // workers)
        return self.chunk or -(-share // -(-share // self.largest_chunk))


class MonteCarloConfig(PolicyConfig, ChunksConfig):
    """An evaluation; the defaults fly the shipped policy through the paper's circle encounters."""

    mode: Literal["policy", "plan", "assured"] = "policy"
    """What decides: policy, the network alone, once a second; plan, the planner once at the start,
    then the plan is followed; assured, the same under a monitor that asks for new plans and falls
    back to a backup."""
    baseline: Literal["none", "rules", "mvp", "mvp_speed"] = "none"
    """What decides in the policy's place, in mode policy; none: the policy. The straight flight is
    always flown too.
    """
    backend: Literal["auto", "numpy", "jax"] = "auto"
    """What computes the policy's decisions in mode policy: numpy; or jax, compiled and some three
    times as fast, with flights that differ by rounding. auto: jax where it is installed, for 2000
    encounters or more."""
    aircraft: AircraftConfig | None = Field(
        default=None,
        json_schema_extra={
            "expected": "null, the path of a YAML file, a name that ships, or a group of keys"
        },
    )
    """The ownship and its task, which rules, scenarios and plans follow; null: the policy's own."""
    allow_outside_domain: bool = False
    """Whether aircraft, and more intruders, than the policy was trained for are flown all the same.
    """
    planner: PlannerConfig = PlannerConfig()
    wind_mps: _Pair = (0.0, 0.0)
    """Range of the wind's speed, m/s, within 0 to 30, in modes plan and assured: encounters are
    drawn in the air mass and carried by a wind of any direction, the goal lies over the ground."""
    areas: int = Field(default=0, ge=0, le=MOST)
    """Areas that must not be entered along the way of an encounter, at most: discs and polygons
    drawn at random, a third of them moving; fewer where start or goal are in the way of one."""
    areas_file: Path | None = None
    """File of areas that every encounter has, beside the configuration file or in the working
    directory: GeoJSON, ED-269, ED-318, .plan or ICAROUS YAML; null: none."""
    latitude: float | None = Field(default=None, ge=-90.0, le=90.0)
    """Latitude of the encounters' origin, degrees north, where there is a file of areas."""
    longitude: float | None = Field(default=None, ge=-180.0, le=180.0)
    """Longitude of the encounters' origin, degrees east, where there is a file of areas."""
    areas_sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """SHA-256 that the file of areas must have; null: any."""
    figures: bool = True
    """Whether figures are drawn."""

    @field_validator("areas_file")
    @classmethod
    def _areas_file(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        return None if path is None else locate(path, info)

    @model_validator(mode="after")
    def _check_areas(self) -> "MonteCarloConfig":
        for name in ("latitude", "longitude"):
            value = getattr(self, name)
            if (self.areas_file is None) != (value is None):
                raise ConfigError(
                    f"{name} is {value}; expected that of the encounters' origin with areas_file, "
                    "and null without"
                )
        if self.areas_file is not None and self.prefix not in (None, FILE):
            raise ConfigError(
                f"areas_file is {self.areas_file}; expected null for {self.scenario}, whose "
                "aircraft are recorded in a sky of their own"
            )
        return self

    @model_validator(mode="after")
    def _check(self) -> "MonteCarloConfig":
        if self.file is None and self.aircraft is not None and is_loaded(self.scenario):
            self.sampled_scenario(self.aircraft.aircraft())
        if self.baseline != "none" and self.mode != "policy":
            raise ConfigError(f"baseline is {self.baseline!r}; expected none with mode {self.mode}")
        if self.backend == "jax" and (self.mode != "policy" or self.baseline != "none"):
            raise ConfigError(
                "backend is 'jax'; expected auto or numpy where not the policy alone decides"
            )
        maneuvers = self.planner.maneuvers
        if maneuvers != "horizontal" and self.mode not in ("plan", "assured"):
            raise ConfigError(
                f"planner.maneuvers is {maneuvers!r}; expected horizontal in mode {self.mode}"
            )
        low, high = self.wind_mps
        if not 0.0 <= low <= high <= _STRONGEST:
            raise ConfigError(
                f"wind_mps is [{low:g}, {high:g}]; expected a range within 0 to {_STRONGEST:g}"
            )
        if high > 0.0 and self.mode not in ("plan", "assured"):
            raise ConfigError(
                f"wind_mps is [{low:g}, {high:g}]; expected [0, 0] in mode {self.mode}"
            )
        if high > 0.0 and self.prefix not in (None, FILE):
            raise ConfigError(
                f"wind_mps is [{low:g}, {high:g}]; expected [0, 0] for {self.scenario}, whose "
                "aircraft are recorded over the ground"
            )
        if self.areas and self.prefix not in (None, FILE):
            raise ConfigError(
                f"areas is {self.areas}; expected 0 for {self.scenario}, whose aircraft are "
                "recorded in a sky of their own"
            )
        return self

    def flown_aircraft(self, policy: Policy) -> Aircraft:
        """Return the aircraft that is flown, which the policy must be trained for where no other is
        allowed.
        """
        aircraft = policy.aircraft if self.aircraft is None else self.aircraft.aircraft()
        return policy.for_aircraft(
            aircraft, outside="allow" if self.allow_outside_domain else "refuse"
        ).aircraft

    def backend_for(self, policy: Policy, encounters: int) -> Literal["numpy", "jax"]:
        """Return what computes the policy's decisions, numpy or jax."""
        if self.backend == "jax":
            require("backend jax", "jax")
        if self.backend != "auto":
            return self.backend
        suits = (
            self.mode == "policy"
            and self.baseline == "none"
            and "encoder" in policy.metadata["architecture"]
        )
        pays = encounters >= _COMPILED_FROM and find_spec("jax") is not None
        return "jax" if suits and pays else "numpy"

    @property
    def largest_chunk(self) -> int:
        """Encounters of a chunk at most, where none is configured."""
        return _LARGEST_CHUNK * (4 if self.backend == "jax" else 1)


def locate(path: Path, info: ValidationInfo) -> Path:
    """Return the absolute path of a file that stands beside the configuration or in the working
    directory.
    """
    beside = Path((info.context or {}).get("folder", "")) / path
    return (beside if beside.exists() else path).absolute()
