"""Profiles that come above or below too late or not for long enough: with turns they may do."""

import itertools
from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import NamedTuple

from agents.kernel.areas import level_times
from agents.kernel.levels import lines
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.reports import times_of
from agents.planner.search.climbs import Conflict, Start
from envs.areas import Area
from envs.profile import Profile

Times = tuple[tuple[float, float], ...]
"""From and until, s after the request."""


class _Late(NamedTuple):
    """A profile that does not avoid all conflicts along the route."""

    unresolved: int  # conflicts
    lasting: float  # how long they last, s
    level: float  # for how long the others count in a plan, s
    profile: Profile


_ORDER = itemgetter(0, 1, 2)
"""Few conflicts, short ones, and others that count for a short time: a turn may put off a conflict
until then.
"""


class Ranking:
    """The profiles that do not avoid all conflicts along the route.

    Args:
        met: the conflicts.
        start: of the profiles.
        options: of the flight.
    """

    def __init__(self, met: Sequence[Conflict], start: Start, options: Options[Narrowed]) -> None:
        self._met, self._start, self._options = met, start, options
        # Where the same parts of all conflicts happen, one profile stands for the others.
        self._late = dict[tuple[Times, ...], _Late]()

    def avoids(self, profile: Profile) -> bool:
        """Return whether a profile avoids all conflicts; note it where it does not."""
        flight = lines(profile, self._start.own, self._options.vertical_margin)
        levels = list[Times]()
        for conflict in self._met:
            if isinstance(conflict.other, Area):
                times = level_times(conflict.other, flight, self._options.unknown_climb)
            else:
                times = times_of(conflict.other, flight, self._options)
            levels.append(tuple(times))
        parts = tuple(
            tuple(_shared(conflict, times))
            for conflict, times in zip(self._met, levels, strict=True)
        )
        if not any(parts):
            return True
        unresolved, lasting = sum(map(bool, parts)), self._lasting(itertools.chain(*parts))
        late = _Late(unresolved, lasting, self._lasting(itertools.chain(*levels)), profile)
        self._late[parts] = min(late, self._late.get(parts, late), key=_ORDER)
        return False

    def in_order(self) -> list[Profile]:
        """Return the profiles that do not, the most promising first, climbs and descents by
        turns.
        """
        profiles = [late.profile for late in sorted(self._late.values(), key=_ORDER)]
        up, down = (
            [profile for profile in profiles if self._rises(profile) == side]
            for side in (True, False)
        )
        by_turns = itertools.zip_longest(up, down)
        return [profile for pair in by_turns for profile in pair if profile is not None]

    def _rises(self, profile: Profile) -> bool:
        """Return whether a profile leaves the route's altitude by more upwards than downwards."""
        above = profile.altitude - self._start.target
        return bool(above.max() > -above.min())

    def _lasting(self, times: Iterable[tuple[float, float]]) -> float:
        """Return how much of a plan times take together, s."""
        last = self._options.last_free
        return sum(max(min(end, last) - max(begin, 0.0), 0.0) for begin, end in times)


def _shared(conflict: Conflict, times: Times) -> Iterable[tuple[float, float]]:
    """Yield the parts of a conflict in which the other counts, which it does in some times."""
    for first, last in times:
        begin, end = max(first, conflict.begin), min(last, conflict.end)
        if begin <= end:
            yield begin, end
