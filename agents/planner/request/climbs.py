"""What a request says of altitudes where its plan may climb and descend, checked."""

from collections.abc import Sequence
from dataclasses import replace

from agents.kernel.levels import Altitude
from agents.planner.answer import Advisory, AdvisoryCode, Field, RequestError, Subject
from agents.planner.request.fields import part_value, quote
from agents.planner.request.options import HIGHEST, LOWEST, L, Maneuvers, Options
from agents.planner.request.reports import check_altitude
from envs.areas import Area, Level, uncomparable_limits, unknown_limits, vertical_limits
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


def with_all_levels_of(areas: Sequence[Area], reference: str, options: Options[L]) -> Options[L]:
    """Return options as :func:`with_levels_of` does, but with a floor and a ceiling of another
    reference where these or an area have such: nothing is known to keep it.
    """
    unknown = uncomparable_limits(areas, reference, options.floor, options.ceiling)
    return replace(with_levels_of(areas, reference, options), **unknown)


def in_plane(
    own: Altitude | None, areas: Sequence[Area], options: Options[L]
) -> tuple[Options[L], tuple[Advisory, ...]]:
    """Return options of a plan that keeps the height, with the reasons, where an area that must
    not be left has a floor or a ceiling that cannot be compared with the altitude of the ownship;
    elsewhere the same options.
    """
    if own is None or not options.climbs:
        return options, ()
    notes = tuple(
        Advisory(
            AdvisoryCode.ASSUMED,
            Field(Subject.AREAS, f"{name}.reference", number),
            f"is {quote(level.reference)}, not the ownship's, {quote(own.reference)}: "
            "the plan does not climb or descend",
        )
        for number, name, level in unknown_limits(areas, own.reference)
    )
    if not notes:
        return options, ()
    plane = replace(options, maneuvers=Maneuvers.HORIZONTAL, floor=None, ceiling=None)
    return plane, notes


def _check_between(name: Field, value: float, floor: Level | None, ceiling: Level | None) -> None:
    """Refuse an altitude, m, below a floor or above a ceiling."""
    if floor is not None and not value >= floor.value:
        raise RequestError(name, f"is {value:g} m, expected the floor, {floor.value:g} m, or more")
    if ceiling is not None and not value <= ceiling.value:
        problem = f"is {value:g} m, expected the ceiling, {ceiling.value:g} m, or less"
        raise RequestError(name, problem)
