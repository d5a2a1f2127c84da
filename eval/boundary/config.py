"""Configuration of a check of resolvability by dynamic programming."""

from typing import Literal

from pydantic import Field

from agents.config.load import Strict
from agents.config.world import AircraftConfig


class BoundaryConfig(Strict):
    """A check; the defaults ask six slices of the paper's aircraft."""

    slices: tuple[tuple[float, float, float], ...] = ()
    """Own speed and intruder's, m/s, and the intruder's course minus the own, degrees clockwise, of
    each slice; none: six that the aircraft's speeds give."""
    aircraft: AircraftConfig | None = Field(
        default=None,
        json_schema_extra={
            "expected": "null, the path of a YAML file, a name that ships, or a group of keys"
        },
    )
    """The ownship, its task and the greatest speed of its traffic; null: the paper's."""
    spacing: float | None = Field(default=None, gt=0.0)
    """Distance between the starts of the raster, m; null: 0.15 separations."""
    grid: Literal["coarse", "default", "fine"] = "default"
    """Resolution; fine takes 3 times as long."""
