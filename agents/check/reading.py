"""Reading a certificate: an object of JSON becomes what it states, or is refused."""

import re
from itertools import chain
from typing import Any

from .certificate import (
    ARCS,
    FORMAT,
    Apart,
    Area,
    Certificate,
    Heights,
    Levels,
    Limits,
    Origin,
    PlanState,
    Profile,
    Report,
    Requirement,
    Wind,
)
from .refusal import demand

LARGEST = 1e8
"""Numbers of a certificate are below this."""

_MOST_PARTS = 1024  # of an arc
_SAME_CLIMB = 1e-9  # by which the middle of the levels' climbs may differ from the profile's, m/s
_FIELDS = {
    "format",
    "request",
    "own",
    "waypoints",
    "controls",
    "intruders",
    "excluded",
    "apart",
    "requirement",
    "limits",
    "wind",
    "areas",
    "levels",
    "profile",
    "parts",
    "bounds",
}


def read(data: Any) -> Certificate:
    """Return what a certificate states; raise RefusedError where it is none."""
    right = isinstance(data, dict) and set(data) == _FIELDS and data["format"] == FORMAT
    demand(right, f"it is not a {FORMAT}")
    own = table("own", [data["own"]], 4)[0]
    waypoints = table("waypoints", data["waypoints"], len(PlanState._fields))
    controls = table("controls", data["controls"], 2 * ARCS)
    intruders = table("intruders", data["intruders"], len(Report._fields))
    excluded = table("excluded", data["excluded"], len(Heights._fields))
    apart = table("apart", data["apart"], 3 + len(Heights._fields))
    for row in apart:
        demand(row[0] in range(len(intruders)), "a row of apart is of no intruder")
    certificate = Certificate(
        request=read_origin(data["request"]),
        plan_states=[PlanState(*own, time=0.0), *(PlanState(*row) for row in waypoints)],
        controls=controls,
        reports=[Report(*row) for row in intruders],
        excluded=[Heights(*row) for row in excluded],
        apart=[Apart(int(row[0]), row[1], row[2], Heights(*row[3:])) for row in apart],
        requirement=Requirement(*numbers("requirement", data["requirement"], Requirement._fields)),
        limits=Limits(*numbers("limits", data["limits"], Limits._fields)),
        wind=Wind(*numbers("wind", data["wind"], Wind._fields)),
        areas=read_areas(data["areas"]),
        levels=read_levels(data["levels"]),
        profile=read_profile(data["profile"]),
        parts=data["parts"],
        bounds=table("bounds", [data["bounds"]], len(intruders))[0],
    )
    check_sizes(certificate)
    check_ranges(certificate)
    check_profile_ranges(certificate)
    return certificate


def check_sizes(certificate: Certificate) -> None:
    """Refuse a certificate whose lists do not belong together, or whose sizes are negative."""
    parts, reports, requirement = certificate.parts, certificate.reports, certificate.requirement
    whole = type(parts) is int and 1 <= parts <= _MOST_PARTS
    demand(whole and parts & (parts - 1) == 0, "parts is no power of 2 to 1024")
    # The first plan state is the ownship's, the others are the waypoints.
    paired = len(certificate.controls) == len(certificate.plan_states) - 1 > 0
    demand(paired, "there are not as many controls as waypoints, one or more")
    sizes = [*requirement, *certificate.bounds, certificate.wind.std]
    for report in reports:
        sizes += [report.speed, report.turn_time, report.position_std, report.velocity_std]
    demand(min(sizes) >= 0.0, "a size is negative")
    separations = [requirement.separation, *(report.separation for report in reports)]
    demand(min(separations) > 0.0, "a separation is not positive")
    least = least_vertical(certificate)
    demand(least is None or least >= 0.0, "a vertical separation is negative")


def least_vertical(certificate: Certificate) -> float | None:
    """Return the least vertical separation that a certificate states, m; None: it states none."""
    heights = chain(certificate.excluded, (row.heights for row in certificate.apart))
    return min((row.vertical for row in heights), default=None)


def check_ranges(certificate: Certificate) -> None:
    """Refuse a certificate of which a range ends before it begins, so that nothing lies in it."""
    limits, levels = certificate.limits, certificate.levels
    demand(limits.speed_min <= limits.speed_max, "limits.speed_min is above limits.speed_max")
    if levels is not None:
        ordered = levels.low <= levels.high and levels.low_climb <= levels.high_climb
        demand(ordered, "levels has a low level above the high one")
    for time in certificate.apart:
        demand(time.begin <= time.end, "a time of apart ends before it begins")
    for number, area in enumerate(certificate.areas):
        for name, (first, last) in (("valid", area.valid), ("heights", area.heights)):
            ordered = first is None or last is None or first < last
            demand(ordered, f"areas[{number}].{name} ends before it begins")
    origin = certificate.request
    whole = (origin.latitude is None) == (origin.longitude is None)
    demand(whole, "request has half of an origin")


def check_profile_ranges(certificate: Certificate) -> None:
    """Refuse a profile that has not an altitude for each waypoint, whose limits are not positive,
    or that begins elsewhere than the levels.
    """
    profile, levels = certificate.profile, certificate.levels
    if profile is None:
        return
    paired = len(profile.altitudes) == len(certificate.plan_states) - 1
    demand(paired, "profile has not as many altitudes as there are waypoints")
    limits = profile.climb_max, profile.descent_max, profile.acceleration
    demand(min(limits) > 0.0 and profile.margin >= 0.0, "a limit of profile is not positive")
    floor, ceiling = profile.floor, profile.ceiling
    ordered = floor is None or ceiling is None or floor < ceiling
    demand(ordered, "profile.floor is not below profile.ceiling")
    same = levels is not None and (
        abs(0.5 * (levels.low_climb + levels.high_climb) - profile.climb) <= _SAME_CLIMB
    )
    demand(same, "profile has another climb at the request than levels")


def read_levels(data: Any) -> Levels | None:
    """Return the levels of the ownship; None where they are unknown."""
    if data is None:
        return None
    return Levels(*table("levels", [data], len(Levels._fields))[0])


def read_profile(data: Any) -> Profile | None:
    """Return the profile of a plan that climbs; None where it is one in the plane."""
    if data is None:
        return None
    right = isinstance(data, dict) and set(data) == set(Profile._fields)
    demand(right, "profile has other fields than expected")
    altitudes = as_list("profile.altitudes", data["altitudes"])
    levels = {name: data[name] for name in ("floor", "ceiling")}
    table("profile", [[level] for level in levels.values() if level is not None], 1)
    plain = [name for name in Profile._fields if name != "altitudes" and name not in levels]
    stated = table("profile", [[data[name] for name in plain]], len(plain))[0]
    return Profile(
        altitudes=table("profile.altitudes", [altitudes], len(altitudes))[0],
        **dict(zip(plain, stated, strict=True)),
        **levels,
    )


def read_areas(data: Any) -> list[Area]:
    """Return the areas of a certificate."""
    return [read_area(f"areas[{n}]", area) for n, area in enumerate(as_list("areas", data))]


def read_area(name: str, data: Any) -> Area:
    """Return an area; refuse one that is none."""
    right = isinstance(data, dict) and set(data) == set(Area._fields)
    demand(right, f"{name} has other fields than expected")
    demand(data["keep"] in ("out", "in"), f"{name}.keep is neither out nor in")
    for field in ("valid", "heights"):
        pair = data[field]
        demand(isinstance(pair, list) and len(pair) == 2, f"{name}.{field} is no pair")
        table(f"{name}.{field}", [[value] for value in pair if value is not None], 1)
    circle, rings = read_shape(name, data["circle"], data["rings"])
    growth, clearance = table(name, [[data["growth"], data["clearance"]]], 2)[0]
    velocity = table(name, [data["velocity"]], 2)[0]
    demand(clearance >= 0.0, f"{name} has a negative clearance")
    return Area(
        keep=data["keep"],
        circle=circle,
        rings=rings,
        velocity=velocity,
        growth=growth,
        clearance=clearance,
        valid=data["valid"],
        heights=data["heights"],
    )


def read_shape(
    name: str, circle_data: Any, ring_data: Any
) -> tuple[list[float], list[list[list[float]]]]:
    """Return circle and rings of an area, of which one is empty."""
    rings = [table(f"{name}.rings", ring, 2) for ring in as_list(f"{name}.rings", ring_data)]
    if circle_data == []:
        demand(bool(rings) and min(map(len, rings)) >= 3, f"{name} has no rings of 3 points")
        return [], rings
    demand(not rings, f"{name} is both a circle and a polygon")
    circle = table(f"{name}.circle", [circle_data], 3)[0]
    demand(circle[2] > 0.0, f"{name} has no radius")
    return circle, rings


def read_origin(data: Any) -> Origin:
    """Return which flight a certificate says that it belongs to."""
    right = isinstance(data, dict) and set(data) == set(Origin._fields)
    demand(right, "request has other fields than expected")
    origin = Origin(**data)
    digest = origin.policy is None or (
        type(origin.policy) is str and re.fullmatch("[0-9a-f]{64}", origin.policy) is not None
    )
    demand(digest, "request.policy is no SHA-256")
    time = origin.time_ns
    dated = time is None or (type(time) is int and abs(time) < 1 << 63)
    demand(dated, "request.time_ns is no whole number of 64 bits")
    for name, value, most in (
        ("latitude", origin.latitude, 90),
        ("longitude", origin.longitude, 360),
    ):
        inside = value is None or (type(value) in (int, float) and abs(value) <= most)
        demand(inside, f"request.{name} is no angle to {most} degrees")
    return origin


def as_list(name: str, data: Any) -> list[Any]:
    """Return a list."""
    demand(isinstance(data, list), f"{name} is no list")
    return list(data)


def numbers(name: str, group: Any, fields: tuple[str, ...]) -> list[float]:
    """Return the numbers of a group by the order of its fields."""
    right = isinstance(group, dict) and set(group) == set(fields)
    demand(right, f"{name} has other fields than expected")
    return table(name, [[group[field] for field in fields]], len(fields))[0]


def table(name: str, rows: Any, width: int) -> list[list[float]]:
    """Return rows of numbers of moderate size."""
    sentence = f"{name} are not rows of {width} numbers below 1e8"
    demand(isinstance(rows, list), sentence)
    for row in rows:
        demand(isinstance(row, list) and len(row) == width, sentence)
        for value in row:
            # Not-a-number and infinity are not below it either.
            demand(type(value) in (int, float) and abs(value) < LARGEST, sentence)
    return [[float(value) for value in row] for row in rows]
