"""What an area's source leaves open counts as the worst that is plausible, in every reader.

Each scene is an area with a floor, a ceiling, a beginning and an end, of which some are not said. It
is read, and the planner says when an ownship of a known height has to keep out of it. When it must is
worked out here, from the scene.
"""

import itertools
import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.kernel.areas import window
from agents.planner.request.request import Altitude
from envs.areas import Area, AreaError
from envs.formats.areas import read_areas
from envs.formats.areas.geodetic import FOOT
from envs.formats.local_frame import LocalFrame
from eval.bluesky.plugin import area_of
from ros_bridge.core.areas import areas, to_local

HERE = LocalFrame(47.0, 8.0)
RING = [[8.0, 47.0], [8.02, 47.0], [8.02, 47.01], [8.0, 47.01]]
CLOSED_RING = [*RING, RING[0]]
NOON = datetime(2026, 11, 27, 12, tzinfo=UTC)
SECOND = 1_000_000_000  # ns
UNKNOWN_CLIMB = 10.0  # m/s
HORIZON = np.linspace(0.0, 300.0, 61)  # s
SLACK = 0.01  # m and s: files are read to rounding

LIMITS, TIMES = ("floor", "ceiling"), ("begin", "end")
READERS = {
    "GeoJSON": (*LIMITS, *TIMES, "now", "reference"),
    "ED-269": (*LIMITS, *TIMES, "now", "reference", "unit"),
    "ED-318": (*LIMITS, *TIMES, "now", "reference", "unit"),
    "ICAROUS": (*LIMITS, "reference"),
    "QGroundControl": (),
    "Areas": (*LIMITS, *TIMES),
    "BlueSky": LIMITS,
}
"""Of each reader what its source may leave open; ``now`` is the time of the request."""

SCENES = 10_000 // sum(2 ** len(fields) for fields in READERS.values()) + 1


class Zone(NamedTuple):
    """An area as it is."""

    floor: float  # m
    ceiling: float
    begin: float  # s after the request
    end: float


def draw_zone(rng: np.random.Generator) -> Zone:
    """Return an area that is above, below or about an ownship at 1000 m, before, after or at the
    time of its flight.
    """
    floor, begin = float(rng.uniform(-100.0, 2_500.0)), float(rng.uniform(-300.0, 400.0))
    return Zone(floor, floor + rng.uniform(50.0, 1_500.0), begin, begin + rng.uniform(1.0, 300.0))


def read(reader: str, zones: list[Zone], unsaid: frozenset[str], folder: Path) -> list[Area]:
    """Return what a reader makes of areas of which some fields are not said."""
    if reader == "Areas":
        message = SimpleNamespace(header=SimpleNamespace(stamp=_stamp(0.0)))
        message.areas = [_message(zone, unsaid) for zone in zones]
        at = int(NOON.timestamp()) * SECOND
        return list(to_local(areas(message), HERE, at, 1e5))
    if reader == "BlueSky":
        return [area_of(_shape(zone, unsaid), 47.0, 8.0) for zone in zones]
    said = [_stated(zone, unsaid) for zone in zones]
    path = folder / "areas"
    # A comment before it makes YAML of JSON.
    comment = "# fences\n" if reader == "ICAROUS" else ""
    path.write_text(comment + json.dumps(_CONTENTS[reader](said, unsaid)))
    reference = None if "reference" in unsaid else "msl"
    time = None if "now" in unsaid else NOON
    return read_areas(path, HERE, time=time, reference=reference)


def _stated(zone: Zone, unsaid: frozenset[str]) -> dict[str, Any]:
    """Return what is said of an area: heights in m, and dates."""
    values: dict[str, Any] = {name: getattr(zone, name) for name in LIMITS}
    values |= {name: (NOON + timedelta(seconds=getattr(zone, name))).isoformat() for name in TIMES}
    return {name: value for name, value in values.items() if name not in unsaid}


def _known(names: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in names.items() if value is not None}


def _geojson(said: list[dict[str, Any]], unsaid: frozenset[str]) -> Any:
    reference = None if "reference" in unsaid else "msl"
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Polygon", "coordinates": [CLOSED_RING]},
            "properties": _known(
                {
                    "floor_m": one.get("floor"),
                    "floor_reference": reference,
                    "ceiling_m": one.get("ceiling"),
                    "ceiling_reference": reference,
                    "valid_from": one.get("begin"),
                    "valid_until": one.get("end"),
                }
            ),
        }
        for one in said
    ]
    return {"type": "FeatureCollection", "features": features}


def _times(one: dict[str, Any]) -> list[dict[str, Any]]:
    return [_known({"startDateTime": one.get("begin"), "endDateTime": one.get("end")})]


def _feet(one: dict[str, Any], limit: str) -> float | None:
    return one[limit] / FOOT if limit in one else None


def _ed269(said: list[dict[str, Any]], unsaid: frozenset[str]) -> Any:
    reference = None if "reference" in unsaid else "AMSL"
    return [
        {
            "identifier": "A",
            "restriction": "PROHIBITED",
            "applicability": _times(one),
            "geometry": [
                _known(
                    {
                        "uomDimensions": None if "unit" in unsaid else "FT",
                        "lowerLimit": _feet(one, "floor"),
                        "lowerVerticalReference": reference,
                        "upperLimit": _feet(one, "ceiling"),
                        "upperVerticalReference": reference,
                        "horizontalProjection": {"type": "Polygon", "coordinates": [CLOSED_RING]},
                    }
                )
            ],
        }
        for one in said
    ]


def _ed318(said: list[dict[str, Any]], unsaid: frozenset[str]) -> Any:
    reference = None if "reference" in unsaid else "AMSL"
    features = [
        {
            "type": "Feature",
            "geometry": {
                "type": "Polygon",
                "coordinates": [CLOSED_RING],
                "layer": _known(
                    {
                        "uom": None if "unit" in unsaid else "ft",
                        "lower": _feet(one, "floor"),
                        "lowerReference": reference,
                        "upper": _feet(one, "ceiling"),
                        "upperReference": reference,
                    }
                ),
            },
            "properties": {
                "identifier": "A",
                "type": "PROHIBITED",
                "variant": "COMMON",
                "limitedApplicability": _times(one),
            },
        }
        for one in said
    ]
    return {"type": "FeatureCollection", "features": features}


def _plan(said: list[dict[str, Any]], unsaid: frozenset[str]) -> Any:
    ring = [place[::-1] for place in RING]
    polygons = [{"inclusion": False, "polygon": ring} for _ in said]
    fence = {"version": 2, "polygons": polygons, "circles": []}
    return {"fileType": "Plan", "geoFence": fence}


def _fences(said: list[dict[str, Any]], unsaid: frozenset[str]) -> Any:
    vertices = [place[::-1] for place in RING]
    return [
        {"id": n, "type": "KEEPOUT", "vertices": vertices}
        | _known({"floor": one.get("floor"), "roof": one.get("ceiling")})
        for n, one in enumerate(said)
    ]


_CONTENTS: dict[str, Any] = {
    "GeoJSON": _geojson,
    "ED-269": _ed269,
    "ED-318": _ed318,
    "ICAROUS": _fences,
    "QGroundControl": _plan,
}


def _stamp(after: float) -> Any:
    time = round((NOON.timestamp() + after) * SECOND)
    return SimpleNamespace(sec=time // SECOND, nanosec=time % SECOND)


def _message(zone: Zone, unsaid: frozenset[str]) -> Any:
    """Return an area of ROS; a field that is not valid holds what would leave the area out."""
    bits = {name: 1 << n for n, name in enumerate((*LIMITS, *TIMES))}
    return SimpleNamespace(
        id="",
        keep=0,
        valid=sum(bit for name, bit in bits.items() if name not in unsaid),
        rings=[],
        latitude=47.0,
        longitude=8.0,
        radius=1_000.0,
        velocity=SimpleNamespace(x=0.0, y=0.0),
        growth=0.0,
        clearance=0.0,
        floor=90_000.0 if "floor" in unsaid else zone.floor,
        floor_reference=2,
        ceiling=-10_000.0 if "ceiling" in unsaid else zone.ceiling,
        ceiling_reference=2,
        valid_from=_stamp(9e5 if "begin" in unsaid else zone.begin),
        valid_until=_stamp(-9e5 if "end" in unsaid else zone.end),
    )


def _shape(zone: Zone, unsaid: frozenset[str]) -> Any:
    """Return a box of BlueSky, whose heights are 10^9 m where there are none."""
    return SimpleNamespace(
        kind=lambda: "BOX",
        name="A",
        coordinates=[47.0, 8.0, 47.01, 8.02],
        bottom=-1e9 if "floor" in unsaid else zone.floor,
        top=1e9 if "ceiling" in unsaid else zone.ceiling,
    )


def refused(reader: str, unsaid: frozenset[str]) -> bool:
    """Return whether numbers are said without what they mean."""
    heights = not unsaid >= set(LIMITS)
    if "unit" in unsaid and (heights or reader == "ED-269"):  # of which the unit is no option
        return True
    return "reference" in unsaid and heights and reader != "ICAROUS"


def worst(reader: str, zone: Zone, unsaid: frozenset[str]) -> Zone:
    """Return the largest area that what is said leaves open."""
    without = set(unsaid) | {name for name in Zone._fields if name not in READERS[reader]}
    if "now" in unsaid:
        without |= set(TIMES)
    if "reference" in unsaid:
        without |= set(LIMITS)
    limitless = Zone(-math.inf, math.inf, -math.inf, math.inf)
    return zone._replace(
        **{name: getattr(limitless, name) for name in Zone._fields if name in without}
    )


def counts(zone: Zone, height: float, climb: float | None, slack: float) -> np.ndarray:
    """Return when an ownship may be in an area that is larger by some slack, over the horizon."""
    rates = (-UNKNOWN_CLIMB, UNKNOWN_CLIMB) if climb is None else (climb, climb)
    low, high = (height + rate * HORIZON for rate in rates)
    level = (high >= zone.floor - slack) & (low <= zone.ceiling + slack)
    return level & (zone.begin - slack <= HORIZON) & (zone.end + slack >= HORIZON)


@pytest.mark.parametrize("reader", READERS)
def test_no_area_is_left_out_that_the_worst_case_brings_near(reader: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(51)
    own_reference = "pressure" if reader == "BlueSky" else "msl"
    fields, near, far = READERS[reader], 0, 0
    for count in range(len(fields) + 1):
        for unsaid in map(frozenset, itertools.combinations(fields, count)):
            zones = [draw_zone(rng) for _ in range(SCENES)]
            if refused(reader, unsaid):
                with pytest.raises(AreaError):
                    read(reader, zones, unsaid, tmp_path)
                continue
            found = read(reader, zones, unsaid, tmp_path)
            for zone, area in zip(zones, found, strict=True):
                climb = None if rng.random() < 0.5 else float(rng.uniform(-9.0, 9.0))
                own = Altitude(1_000.0, own_reference, climb)
                begin, end = window(area, own, UNKNOWN_CLIMB)
                counted = (begin <= HORIZON) & (end >= HORIZON)
                possible = worst(reader, zone, unsaid)
                assert not (counts(possible, 1_000.0, climb, -SLACK) & ~counted).any()
                # Where all is known nobody is kept out for fear.
                assert not (counted & ~counts(possible, 1_000.0, climb, SLACK)).any()
                near, far = near + counted.any(), far + (not counted.all())
    assert near > SCENES // 2 and (far > SCENES // 2 or not fields)
