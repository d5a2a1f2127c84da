"""Altitudes above what the ownship's is, so that all that is drawn can be compared."""

from typing import NamedTuple

from ros_bridge.core.situation import Situation


class Heights(NamedTuple):
    """What altitudes are drawn above."""

    reference: str | None  # as of agents.kernel.levels.Altitude; None: each is drawn as it is
    undulation: float | None  # height of the geoid above the ellipsoid, m; None: unknown

    @classmethod
    def of(cls, situation: Situation) -> "Heights":
        """Return what the ownship's altitude is above."""
        own, origin = situation.own.last, situation.origin.value
        altitude = None if own is None else own.altitude
        return cls(
            None if altitude is None else altitude.reference,
            None if origin is None else origin.undulation,
        )

    def offset(self, reference: str) -> float | None:
        """Return what is added to altitudes above a reference, m; None: they cannot be
        compared.
        """
        if self.reference in (None, reference):
            return 0.0
        if self.undulation is None or "pressure" in (self.reference, reference):
            return None
        return self.undulation if reference == "msl" else -self.undulation
