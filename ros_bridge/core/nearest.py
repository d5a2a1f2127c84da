"""How many aircraft are followed at once: the nearest ones, where somebody sends ever new names."""

import math
from collections.abc import Mapping

from ros_bridge.core.tracks import Track

MOST = 1_000
"""Aircraft that are followed; receivers hear some hundreds at most."""

_MORE = MOST // 4  # beyond them before it is cut down, so that not every report is compared


def keep_nearest(
    tracks: Mapping[str, Track], own_place: tuple[float, float] | None
) -> tuple[Mapping[str, Track], int]:
    """Return the tracks, or of too many the :data:`MOST` nearest, and how many were dropped.

    What has no known place may be near, and is kept before the others.

    Args:
        tracks: by name.
        own_place: latitude and longitude of the ownship, degrees; None: unknown, and of too many
            the first ones are dropped.
    """
    if len(tracks) <= MOST + _MORE:
        return tracks, 0
    names = list(tracks)[::-1]
    if own_place is not None:
        names.sort(key=lambda name: _distance(tracks[name], *own_place))
    nearest = frozenset(names[:MOST])
    return {name: track for name, track in tracks.items() if name in nearest}, len(names) - MOST


def _distance(track: Track, latitude: float, longitude: float) -> float:
    """Return about how far a track was last from a place, degrees; 0: nobody knows."""
    places = [
        sighted.sighting.place for sighted in track.sightings if sighted.sighting.place is not None
    ]
    if track.last is not None:
        places.append(track.last.place)
    if not places:
        return 0.0
    shrink = math.cos(math.radians(latitude))
    return min(
        math.hypot(place[0] - latitude, shrink * math.remainder(place[1] - longitude, 360.0))
        for place in places
    )
