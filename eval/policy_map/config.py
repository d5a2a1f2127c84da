"""Configuration of a map of commands, and of proofs box by box."""

from pydantic import Field, field_validator

from agents.config.load import ConfigError
from eval.config import PolicyConfig

MOST_MAPS = 8


class PolicyMapConfig(PolicyConfig):
    """What a map holds fixed; angles count counter-clockwise as seen from above."""

    own_speed: float | None = None
    """Speed of the ownship, m/s; null: 3/4 of its greatest."""
    intruder_speed: float | None = None
    """Speed of the intruder, m/s; null: half of the traffic's greatest."""
    relative_headings: tuple[float, ...] = (180.0, -90.0, 90.0, -30.0)
    """Intruder's heading minus the own one, degrees from -180 to 180, a row of maps each, at most
    8."""
    goal_bearing: float = Field(default=0.0, ge=-180.0, le=180.0)
    """Bearing of the goal from the own heading, degrees."""
    goal_distance: float | None = None
    """Distance of the goal, m; null: 8 required separations."""
    extent: float | None = None
    """How far the map reaches to each side, m; null: 6 required separations."""
    cells: int = Field(default=181, ge=11, le=1_001)
    """Along each side of the map."""
    encounters: int = Field(default=500, ge=1, le=10_000)
    """How many circle encounters are flown for the chatter."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of the encounters."""

    @field_validator("relative_headings")
    @classmethod
    def _headings(cls, headings: tuple[float, ...]) -> tuple[float, ...]:
        if not 1 <= len(headings) <= MOST_MAPS:
            raise ConfigError(f"there are {len(headings)} of them; expected 1 to {MOST_MAPS}")
        if not all(-180.0 <= heading <= 180.0 for heading in headings):
            raise ConfigError("expected degrees from -180 to 180")
        return headings


class LocalConfig(PolicyConfig):
    """Scenes, errors and effort of the proofs; the defaults examine a hundred boxes."""

    boxes: int = Field(default=100, ge=1, le=1_000_000)
    """How many boxes are examined, in all."""
    course: tuple[float, float] = (0.0, 180.0)
    """Range of the difference of the courses, degrees, within 0 to 180."""
    loss: tuple[float, float] = (0.0, 30.0)
    """Range of the time to the loss of separation, s, within 0 to 60."""
    position: float = Field(default=30.0, ge=0.0, le=1e3)
    """Error of the intruder's x and y, m."""
    velocity: float = Field(default=3.0, ge=0.0, le=50.0)
    """Error of the intruder's vx and vy, m/s."""
    allowed: float = Field(default=0.1, ge=0.01, le=0.9)
    """Turn that does not count, of the greatest yaw rate."""
    depth: int = Field(default=12, ge=0, le=30)
    """How many times a box is cut in two."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of scenes and samples."""
    vnnlib: int = Field(default=0, ge=0, le=10_000)
    """How many boxes are written for other verifiers, with the network."""

    @field_validator("course", "loss")
    @classmethod
    def _rising(cls, ends: tuple[float, float]) -> tuple[float, float]:
        low, high = ends
        if not low < high:
            raise ConfigError(f"{low:g} {high:g}; expected the lower end first")
        return ends

    @field_validator("course")
    @classmethod
    def _course(cls, ends: tuple[float, float]) -> tuple[float, float]:
        if not 0.0 <= ends[0] <= ends[1] <= 180.0:
            raise ConfigError("expected a range within 0 to 180 degrees")
        return ends

    @field_validator("loss")
    @classmethod
    def _loss(cls, ends: tuple[float, float]) -> tuple[float, float]:
        if not 0.0 <= ends[0] <= ends[1] <= 60.0:
            raise ConfigError("expected a range within 0 to 60 s")
        return ends
