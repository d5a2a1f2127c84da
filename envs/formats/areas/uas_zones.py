"""UAS geographical zones: the JSON of EUROCAE ED-269, and of its successor ED-318, which is GeoJSON
with heights.

Zones without restriction are left out, and those whose restriction the operator says is no obstacle
to this flight. Schedules within a period are not read: a zone counts for the whole period.
"""

from collections.abc import Collection
from typing import Any

from envs.areas import AreaError, Level
from envs.formats.areas.geodetic import (
    FOOT,
    GeodeticArea,
    Period,
    Reading,
    hull,
    level,
    number,
    period,
    place,
    polygon,
    record,
    rows,
    text,
)

FREE = "NO_RESTRICTION"
RESTRICTIONS = ("PROHIBITED", "REQ_AUTHORISATION", "CONDITIONAL", "USPACE", FREE)
"""What zones ask for; ED-318 writes REQ_AUTHORIZATION."""

_REFERENCES = {"AGL": "ground", "AMSL": "msl", "WGS84": "wgs84"}
_OF_ED318 = "identifier", "type", "variant"  # what each zone of it states
_UNITS = {"M": 1.0, "FT": FOOT}


def is_ed269(content: object) -> bool:
    """Return whether a file is one of ED-269: volumes with a horizontal projection."""
    return any(isinstance(zone.get("geometry"), list) for zone in _zones(content))


def is_ed318(content: object) -> bool:
    """Return whether a file is one of ED-318: features that say which variant of zone they are."""
    stated = (zone.get("properties") for zone in _zones(content))
    return any(
        isinstance(properties, dict) and set(_OF_ED318) <= set(properties) for properties in stated
    )


def _zones(content: object) -> list[dict[str, Any]]:
    """Return what may be the zones of a file: a list of them, a collection, or one alone."""
    features = content.get("features", [content]) if isinstance(content, dict) else content
    return (
        [feature for feature in features if isinstance(feature, dict)]
        if isinstance(features, list)
        else []
    )


def _places(content: object, source: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the zones of a file, each with where it stands."""
    if isinstance(content, dict) and "features" not in content:
        return [(source, content)]
    features = content.get("features") if isinstance(content, dict) else content
    named = (
        (f"{source}, features[{n}]", zone)
        for n, zone in enumerate(rows(features, f"{source}, features"))
    )
    return [(where, record(zone, where)) for where, zone in named]


def areas_of_ed269(content: object, source: str, permitted: Collection[str] = ()) -> Reading:
    """Return the areas of zones of ED-269."""
    areas, free = list[GeodeticArea](), 0
    for where, zone in _places(content, source):
        name = text(zone.get("name") or zone.get("identifier") or "", f"{where}, name")
        if is_free(zone.get("restriction"), f"{where}, restriction", permitted):
            free += 1
            continue
        valid = _validity(zone.get("applicability"), f"{where}, applicability")
        volumes = rows(zone.get("geometry"), f"{where}, geometry", 1)
        for m, volume in enumerate(volumes):
            at = f"{where}, geometry[{m}]"
            area = _of_volume(record(volume, at), at)
            areas.append(area._replace(name=name, period=valid))
    return Reading(tuple(areas), free)


def areas_of_ed318(
    content: dict[str, Any], source: str, permitted: Collection[str] = ()
) -> Reading:
    """Return the areas of zones of ED-318."""
    areas, free = list[GeodeticArea](), 0
    for where, zone in _places(content, source):
        properties = record(zone.get("properties"), f"{where}, properties")
        if is_free(properties.get("type"), f"{where}, type", permitted):
            free += 1
            continue
        valid = _validity(properties.get("limitedApplicability"), f"{where}, limitedApplicability")
        name = _name(properties, f"{where}, name")
        shape = record(zone.get("geometry"), f"{where}, geometry")
        parts = [shape]
        if shape.get("type") == "GeometryCollection":
            parts = rows(shape.get("geometries"), f"{where}, geometry.geometries", 1)
        for m, part in enumerate(parts):
            at = f"{where}, geometry" if len(parts) == 1 else f"{where}, geometries[{m}]"
            areas += [
                area._replace(name=name, period=valid) for area in _of_layer(record(part, at), at)
            ]
    return Reading(tuple(areas), free)


def is_free(value: object, where: str, permitted: Collection[str]) -> bool:
    """Return whether a restriction keeps nobody out."""
    restriction = text(value, where).upper().replace("AUTHORIZATION", "AUTHORISATION")
    for word in (restriction, *permitted):
        if word not in RESTRICTIONS:
            raise AreaError(f"{where}: {word!r:.60} is unknown, expected one of {RESTRICTIONS}")
    return restriction == FREE or restriction in permitted


def _validity(value: object, where: str) -> Period:
    """Return when a zone may apply."""
    periods = []
    for n, entry in enumerate(rows([] if value is None else value, where)):
        limits = record(entry, f"{where}[{n}]")
        if limits.get("permanent") == "YES":
            return Period()
        names = "startDateTime", "endDateTime"
        begin, end = (limits.get(name) for name in names)
        periods.append(period(begin, end, f"{where}[{n}].", names))
    return hull(periods)


def _name(properties: dict[str, Any], where: str) -> str:
    """Return the first of a zone's names, which stand with their languages, or its identifier."""
    names = properties.get("name")
    if isinstance(names, list) and names:
        return text(record(names[0], where).get("text", ""), where)
    return text(names or properties.get("identifier") or "", where)


def _of_volume(volume: dict[str, Any], where: str) -> GeodeticArea:
    """Return the area of a volume of ED-269, without name and period."""
    unit = _unit(volume.get("uomDimensions"), f"{where}.uomDimensions")
    projection = record(volume.get("horizontalProjection"), f"{where}.horizontalProjection")
    floor, ceiling = (
        _limit(
            volume.get(f"{side}Limit"),
            volume.get(f"{side}VerticalReference"),
            unit,
            f"{where}.{side}",
        )
        for side in ("lower", "upper")
    )
    area = GeodeticArea(where, floor=_above_ground(floor), ceiling=ceiling)
    kind, at = projection.get("type"), f"{where}.horizontalProjection"
    if kind == "Circle":
        centre = place(projection.get("center"), f"{at}.center", longitude_first=True)
        radius = unit * number(projection.get("radius"), f"{at}.radius", 0.0, 1e7)
        return area._replace(centre=centre, radius=radius)
    if kind == "Polygon":
        return area._replace(rings=polygon(projection.get("coordinates"), f"{at}.coordinates"))
    raise AreaError(f"{at}.type: is {kind!r:.60}, expected Polygon or Circle")


def _of_layer(shape: dict[str, Any], where: str) -> list[GeodeticArea]:
    """Return the areas of a geometry of ED-318, without name and period."""
    layer = record(shape.get("layer", {}), f"{where}.layer")
    stated = layer.get("lower") is not None or layer.get("upper") is not None
    unit = _unit(layer.get("uom"), f"{where}.layer.uom") if stated else 1.0
    floor, ceiling = (
        _limit(layer.get(side), layer.get(f"{side}Reference"), unit, f"{where}.layer.{side}")
        for side in ("lower", "upper")
    )
    area = GeodeticArea(where, floor=_above_ground(floor), ceiling=ceiling)
    kind, coordinates = shape.get("type"), shape.get("coordinates")
    path = f"{where}.coordinates"
    if kind == "Polygon":
        return [area._replace(rings=polygon(coordinates, path))]
    if kind == "MultiPolygon":
        return [
            area._replace(rings=polygon(part, f"{path}[{n}]"), where=f"{where}, polygon {n}")
            for n, part in enumerate(rows(coordinates, path, 1))
        ]
    if kind == "Point":
        extent = record(shape.get("extent"), f"{where}.extent")
        if extent.get("subType") != "Circle":
            raise AreaError(
                f"{where}.extent.subType: is {extent.get('subType')!r:.60}, expected Circle"
            )
        radius = number(extent.get("radius"), f"{where}.extent.radius", 0.0, 1e7, "m")
        centre = place(coordinates, path, longitude_first=True)
        return [area._replace(centre=centre, radius=radius)]
    raise AreaError(
        f"{where}.type: is {kind!r:.60}, expected Polygon, MultiPolygon, Point or "
        "GeometryCollection"
    )


def _unit(value: object, where: str) -> float:
    unit = _UNITS.get(text(value, where).upper())
    if unit is None:
        raise AreaError(f"{where}: is {value!r:.60}, expected M or FT")
    return unit


def _limit(value: object, reference: object, unit: float, where: str) -> Level | None:
    if value is None:
        return None
    above = _REFERENCES.get(text(reference, f"{where}, reference").upper())
    if above is None:
        raise AreaError(
            f"{where}, reference: is {reference!r:.60}, expected one of {sorted(_REFERENCES)}"
        )
    return level(value, above, unit, where)


def _above_ground(floor: Level | None) -> Level | None:
    """Return a floor; None where it is the ground or below."""
    if floor is not None and floor.reference == "ground" and floor.value <= 0.0:
        return None
    return floor
