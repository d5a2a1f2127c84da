"""What is published, checked once more: the waypoints under indices of their own, the last one a
point of the route.

The validator judges plan states; this looks at the waypoints, and shares nothing with the modules
that write them.
"""

import math
from collections import Counter
from collections.abc import Sequence

from agents.planner.answer import Kind, Reason
from envs.waypoints import RoutePoint, Waypoint

ON_ROUTE = 1e-3
"""By how much the last waypoint may stand beside its point of the route, m."""


def audit(
    waypoints: Sequence[Waypoint],
    route: Sequence[RoutePoint],
    *,
    count: int,
    extended: bool = False,
) -> list[Reason]:
    """Return what is wrong with ``count`` published waypoints, in the order in which they are
    flown.

    ``extended`` says whether the plan may end beyond the route, on the straight line of its last
    leg.
    """
    reasons = []
    if len(waypoints) != count:
        reasons.append(
            Reason.of(Kind.COUNT, "waypoints", f"are {len(waypoints)}, expected {count}")
        )
    for number, point in enumerate(waypoints):
        if not all(map(math.isfinite, (point.x, point.y, point.heading, point.speed, point.time))):
            reasons.append(Reason.of(Kind.NOT_FINITE, f"waypoints[{number}]", "is not finite"))
    uses = Counter(point.index for point in waypoints)
    uses.update(point.index for point in route)
    ends_route = bool(waypoints) and waypoints[-1].index in {point.index for point in route}
    for number, point in enumerate(waypoints):
        last = number == len(waypoints) - 1
        if uses[point.index] > (2 if last and ends_route else 1):
            text = (
                f"has index {point.index}, which another waypoint or a point of the route has too"
            )
            reasons.append(
                Reason.of(Kind.INDICES, f"waypoints[{number}]", text, point.time, point.x, point.y)
            )
    if waypoints:
        reasons += _last(waypoints[-1], len(waypoints) - 1, route, extended)
    return reasons


def _last(
    point: Waypoint, number: int, route: Sequence[RoutePoint], extended: bool
) -> list[Reason]:
    name = f"waypoints[{number}]"
    on_route = next((candidate for candidate in route if candidate.index == point.index), None)
    if on_route is not None:
        off = math.hypot(point.x - on_route.x, point.y - on_route.y)
        expected = f"the route's point {on_route.index}"
    elif extended and len(route) > 1:
        before, end = route[-2], route[-1]
        dx, dy = end.x - before.x, end.y - before.y
        length = math.hypot(dx, dy)
        if length <= 0.0:
            return [_off_route(point, name, "cannot be on a route whose last leg has no length")]
        along = ((point.x - end.x) * dx + (point.y - end.y) * dy) / length
        # Behind the route's end the nearest point of the line's extension is that end.
        along = max(along, 0.0)
        off = math.hypot(
            point.x - end.x - along * dx / length, point.y - end.y - along * dy / length
        )
        expected = "the line on which the route goes on"
    else:
        return [
            _off_route(point, name, f"has index {point.index}, which no point of the route has")
        ]
    return [] if off <= ON_ROUTE else [_off_route(point, name, f"is {off:.3f} m off {expected}")]


def _off_route(point: Waypoint, name: str, text: str) -> Reason:
    return Reason.of(Kind.OFF_ROUTE, name, text, point.time, point.x, point.y)
