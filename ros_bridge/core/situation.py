"""The situation: what is known at one moment, as values; what receives messages only feeds it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar

from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.areas import AreaReport, Placed, comparable_areas, place_areas
from ros_bridge.core.conversions import Alert, Origin, Route
from ros_bridge.core.fields import FieldError
from ros_bridge.core.tracks import UNKNOWN, Fault, Track

__all__ = ["ACCURATE", "NOTHING", "Held", "Situation"]

_T = TypeVar("_T")

ACCURATE = 100_000.0
"""Distance from the origin, m, up to which ownship and route are accepted; it follows from the
map's errors.
"""


class Held(NamedTuple, Generic[_T]):
    """The last good message of an input, and what is wrong with a newer one."""

    value: _T | None = None
    fault: Fault | None = None


NOTHING: Held[Any] = Held()  # of an input without any message


@dataclass(frozen=True)
class Situation:
    """Everything that was received."""

    origin: Held[Origin] = NOTHING
    own: Track = UNKNOWN
    traffic: Mapping[str, Track] = field(default_factory=lambda: MappingProxyType({}))
    alert: Held[Alert] = NOTHING
    route: Held[Route] = NOTHING
    areas: Held[AreaReport] = NOTHING
    fixed_areas: tuple[GeodeticArea, ...] = ()  # of a file, or an autopilot's fence
    areas_file: str = ""  # of which some must lie near; empty: there is none

    def areas_in(self, frame: LocalFrame, moment: int) -> tuple[Placed, ...]:
        """Return all areas that there are in a local frame, or raise :class:`FieldError`; their
        heights above the sea are above the ellipsoid where the geoid is known.
        """
        origin, moving = self.origin.value, self.areas.value
        undulation = None if origin is None else origin.undulation
        placed = [self.fixed_in(frame, moment)]
        placed += [] if moving is None else [place_areas(moving, frame, ACCURATE)]
        return tuple(comparable_areas(areas, undulation) for areas in placed)

    def fixed_in(self, frame: LocalFrame, moment: int) -> Placed:
        """Return the fixed areas in a local frame; a :class:`FieldError` where none of a file lies
        near.
        """
        fixed = place_areas(AreaReport(moment, self.fixed_areas), frame, ACCURATE)
        if self.areas_file and not fixed.areas:
            raise FieldError(
                "areas_file", f"{self.areas_file}: nothing of it lies near: {fixed.far}"
            )
        return fixed
