"""Configuration of a map of areas."""

from pathlib import Path

from pydantic import Field, ValidationInfo, field_validator

from agents.config.load import Strict
from eval.config import locate


class AreasConfig(Strict):
    """Which areas are drawn, and about which place."""

    file: Path
    """File of areas, beside the configuration file or in the working directory."""
    latitude: float = Field(ge=-90.0, le=90.0)
    """Latitude of the frame's origin, degrees north."""
    longitude: float = Field(ge=-180.0, le=180.0)
    """Longitude of the frame's origin, degrees east."""

    @field_validator("file")
    @classmethod
    def _file(cls, path: Path, info: ValidationInfo) -> Path:
        return locate(path, info)
