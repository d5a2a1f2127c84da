"""Configuration of a comparison: the encounters, and who flies through them."""

from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from agents.config.load import ConfigError
from agents.config.world import AircraftConfig
from eval.config import ChunksConfig, PlannerConfig, locate

_DEFAULT_ENCOUNTERS = 1_000
_LARGEST_CHUNK, _LARGEST_OF_WITNESSES = 500, 100  # progress is to be seen while they are searched


class CompareConfig(ChunksConfig):
    """A comparison; the defaults fly the shipped policy and all baselines through the paper's
    circle encounters.
    """

    encounters: int | None = Field(default=None, ge=1, le=100_000_000)
    """How many encounters are flown; null: 1000, or all of a file's."""
    policies: tuple[Path, ...] = ()
    """Policy files (.safetensors or .nnet), each beside the configuration file or in the working
    directory; none: the shipped one."""
    policies_sha256: tuple[str, ...] = ()
    """Digest that each policy but .nnet files must have, in their order; none: any."""
    modes: tuple[Literal["plan", "assured"], ...] = ()
    """Other ways in which each policy is flown too: its plans, made once; its plans under the
    run-time monitor."""
    aircraft: AircraftConfig | None = Field(
        default=None,
        json_schema_extra={
            "expected": "null, the path of a YAML file, a name that ships, or a group of keys"
        },
    )
    """The ownship and its task; null: the aircraft of the policies."""
    planner: PlannerConfig = PlannerConfig()
    """Of the modes."""
    maneuvers: tuple[Literal["horizontal", "vertical", "both"], ...] = ()
    """What plans may do, each in every mode; none: planner.maneuvers."""
    baselines: tuple[str, ...] = ()
    """Baselines: none, rules, mvp, mvp_speed, witness, or module:name of your own; none of them:
    all but witness."""
    well_clear: (
        Literal["do365_en_route", "do365_terminal", "do365_non_cooperative", "f3442"] | None
    ) = None
    """Well-clear volume of the figures in the units of standards; null: those are left out."""

    @model_validator(mode="after")
    def _maneuvers(self) -> "CompareConfig":
        if self.maneuvers and not self.modes:
            raise ConfigError(f"maneuvers is {list(self.maneuvers)}; expected none without modes")
        return self

    @field_validator("policies")
    @classmethod
    def _policies(cls, paths: tuple[Path, ...], info: ValidationInfo) -> tuple[Path, ...]:
        return tuple(locate(path, info) for path in paths)

    @property
    def largest_chunk(self) -> int:
        """Encounters of a chunk at most, where none is configured."""
        return _LARGEST_OF_WITNESSES if "witness" in self.baselines else _LARGEST_CHUNK

    @property
    def default_count(self) -> int:
        """Number of encounters where no file says otherwise."""
        return _DEFAULT_ENCOUNTERS if self.encounters is None else self.encounters
