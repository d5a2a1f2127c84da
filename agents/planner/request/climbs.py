"""What a request says of altitudes where its plan may climb and descend, checked."""

from collections.abc import Sequence
from dataclasses import replace

from agents.kernel.levels import Altitude
from agents.planner.answer import Field, RequestError, Subject
from agents.planner.request.fields import part_value, quote
from agents.planner.request.options import HIGHEST, LOWEST, L, Options
from agents.planner.request.reports import check_altitude
from envs.areas import Area, Level, vertical_limits
from envs.profile import rise_to_level
from envs.waypoints import RoutePoint


def check_climbs(
    own: Altitude | None,
    route: Sequence[RoutePoint],
    areas: Sequence[Area],
    options: Options[L],
) -> tuple[Altitude, float, Options[L]]:
    """Return the altitude of the ownship, that of the route, m, and the options with the floor and
    the ceiling that areas ask for too.

    The route's altitude is that of its last point that has one; without any, the one in which the
    ownship levels off.

    Raises:
        RequestError: an altitude is missing, or cannot be compared, or lies beyond a floor or a
            ceiling.
    """
    name = Field(Subject.OWN_ALTITUDE)
    check_altitude(name, own)
    if own is None:
        raise RequestError(name, "is None, expected an Altitude: the plan may climb and descend")
    if own.vertical_speed is None:
        problem = "is None, expected a number: the plan begins with it"
        raise RequestError(name.part("vertical_speed"), problem)
    for level, option in ((options.floor, "floor"), (options.ceiling, "ceiling")):
        if level is not None and level.reference != own.reference:
            problem = f"is {quote(level.reference)}, expected the ownship's, {quote(own.reference)}"
            raise RequestError(f"options.{option}.reference", problem)
    options = with_levels_of(areas, own.reference, options)
    floor, ceiling = options.floor, options.ceiling
    _check_between(name.part("value"), own.value, floor, ceiling)
    altitudes = [
        part_value(point, "altitude", altitude, LOWEST, HIGHEST, "m")
        for point, altitude in (
            (Field(Subject.ROUTE, number=number), point.altitude)
            for number, point in enumerate(route)
        )
        if altitude is not None
    ]
    if not altitudes:
        rise = rise_to_level(own.vertical_speed, options.vertical.acceleration)
        return own, own.value + rise, options
    _check_between(Field(Subject.ROUTE, "altitude"), altitudes[-1], floor, ceiling)
    return own, altitudes[-1], options


def with_levels_of(areas: Sequence[Area], reference: str, options: Options[L]) -> Options[L]:
    """Return options whose floor and ceiling are also those of the areas that must not be left."""
    floor, ceiling = vertical_limits(areas, reference, options.floor, options.ceiling)
    return replace(options, floor=floor, ceiling=ceiling)


def _check_between(name: Field, value: float, floor: Level | None, ceiling: Level | None) -> None:
    """Refuse an altitude, m, below a floor or above a ceiling."""
    if floor is not None and not value >= floor.value:
        raise RequestError(name, f"is {value:g} m, expected the floor, {floor.value:g} m, or more")
    if ceiling is not None and not value <= ceiling.value:
        problem = f"is {value:g} m, expected the ceiling, {ceiling.value:g} m, or less"
        raise RequestError(name, problem)
