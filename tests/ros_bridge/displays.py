"""What the tests of the display share: scenes, and a server of a live source on a free port."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from ros_bridge.display.background import BackgroundServer
from ros_bridge.display.document import Document, to_json
from ros_bridge.display.draw import draw
from ros_bridge.display.scene import DisplayScene, take
from ros_bridge.display.server import LiveSource, Recording
from tests.ros_bridge.scenes import FRAME, NOW, SECOND, aircraft, stamp

__all__ = [
    "NOW",
    "PREFIX",
    "SECOND",
    "Served",
    "area",
    "areas",
    "climbing_plan",
    "guidance",
    "known_scene",
    "level_aircraft",
    "page_document",
    "plan",
    "serving",
    "status",
    "up_and_down",
]

PREFIX = "rlcas_runner/input/"


def known_scene(*traffic: Any, own: Any = None, moment: int = NOW) -> DisplayScene:
    """Return what is known after reports of an ownship that flies east and of these aircraft."""
    scene = take(
        DisplayScene(separation=1_000.0),
        f"{PREFIX}ownship",
        own or aircraft(0.0, 0.0, 0.0, 80.0, id="own"),
        moment,
    )
    for message in traffic:
        scene = take(scene, f"{PREFIX}traffic", message, moment)
    return scene


def page_document(scene: DisplayScene, moment: int) -> Document:
    """Return what the page gets of a scene at a time, ns."""
    return to_json(draw(scene, moment))


def guidance(
    closed: range = range(0), *, region: int = 2, recovery: int = -1, **changes: Any
) -> Any:
    """Return a GuidanceBands message whose tracks of these numbers have a region."""
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "look_ahead": 120.0,
        "track_deg": [5.0 * n for n in range(72)],
        "track_region": [region if n in closed else 0 for n in range(72)],
        "track_loss": [30.0 if n in closed else -1.0 for n in range(72)],
        "track_area": [-1] * 72,
        "speed": [50.0, 75.0, 100.0],
        "speed_region": [0, 2, 3],
        "speed_loss": [-1.0, 40.0, 20.0],
        "speed_area": [-1] * 3,
        "recovery": recovery,
        "recovery_time": 12.0,
        "recovery_shortfall": 250.0,
        "intruder_ids": [],
        "intruder_level": [],
        "intruder_loss": [],
        "area_ids": [],
        "area_level": [],
        "area_loss": [],
    }
    return SimpleNamespace(**(fields | changes))


def up_and_down(closed: range = range(0), *, region: int = 2, reference: int = 2) -> dict[str, Any]:
    """Return the fields of a GuidanceBands message with bands of vertical speeds, from -5 to 5 m/s,
    and altitudes, from 0 to 1000 m, of which those with these numbers have a region.
    """
    columns = {
        "region": [region if n in closed else 0 for n in range(11)],
        "loss": [30.0 if n in closed else -1.0 for n in range(11)],
        "area": [-1] * 11,
    }
    fields = {
        f"{kind}_{name}": column
        for kind in ("vertical_speed", "altitude")
        for name, column in columns.items()
    }
    return fields | {
        "vertical_speed": [float(n - 5) for n in range(11)],
        "altitude": [100.0 * n for n in range(11)],
        "altitude_reference": reference,
    }


def level_aircraft(*place: float, height: float = 500.0, climb: float = 0.0, **fields: Any) -> Any:
    """Return an AircraftState with an altitude above the sea and a vertical speed."""
    message = aircraft(*place, valid=0xCF, altitude=height, altitude_reference=2, **fields)
    message.velocity.z = climb
    return message


def climbing_plan(reference: int = 2) -> Any:
    """Return a Trajectory that flies east: 100 m up in 40 s, level for 40 s, and down again."""
    message = plan()
    first = message.waypoints[0]

    def at(number: int, x: float, height: float, climb: float) -> Any:
        place = FRAME.geodetic(x, 0.0)
        changes = {
            "index": number,
            "valid": 0x1F,
            "latitude": float(place.latitude),
            "longitude": float(place.longitude),
            "altitude": height,
            "altitude_reference": reference,
            "climb": climb,
            "track_deg": 90.0,
            "time_of_arrival": stamp(NOW + round(x / 80.0 * SECOND)),
        }
        return SimpleNamespace(**(vars(first) | changes))

    rises = [(0.0, 500.0, 2.5), (1_600.0, 550.0, 2.5), (3_200.0, 600.0, 0.0)]
    rises += [(4_800.0, 600.0, 0.0), (6_400.0, 600.0, -2.5), (9_600.0, 500.0, 0.0)]
    message.start, *message.waypoints = [at(n, *rise) for n, rise in enumerate(rises)]
    return message


def status(fly: int = 1, **changes: Any) -> Any:
    """Return an AssuranceStatus message."""
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "state": 4 if fly == 2 else 1,
        "fly": fly,
        "causes": 0,
        "reasons": [],
        "measured": fly == 1,
        "cross_track": 3.0,
        "along_track": -2.0,
        "time_error": 0.1,
        "separation": 1_100.0,
        "time_to_loss": -1.0,
    }
    return SimpleNamespace(**(fields | changes))


def plan(status: int = 1, *, north: float = 3_000.0) -> Any:
    """Return a Trajectory that leaves to the north (left of the ownship of :func:`known_scene`)."""

    def at(index: int, x: float, y: float, track: float, time: float) -> Any:
        place = FRAME.geodetic(x, y)
        return SimpleNamespace(
            index=index,
            origin=1,
            valid=0x0E,
            latitude=float(place.latitude),
            longitude=float(place.longitude),
            altitude=0.0,
            altitude_reference=0,
            track_deg=track,
            ground_speed=80.0,
            time_of_arrival=stamp(NOW + round(time * SECOND)),
        )

    seconds = math.hypot(4_000.0, north) / 80.0
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp(NOW)),
        id=SimpleNamespace(uuid=[0] * 16),
        revision=7,
        status=status,
        intruder_ids=[],
        start=at(0, 0.0, 0.0, 90.0, 0.0),
        wind=SimpleNamespace(x=0.0, y=0.0, z=0.0),
        wind_std=0.0,
        waypoints=[at(1, 4_000.0, north, 30.0 if north > 0.0 else 150.0, seconds)],
    )


def area(ring: Sequence[tuple[float, float]] = (), **changes: Any) -> Any:
    """Return an Area message of a storm that moves east and grows: a polygon with corners in m, or
    a circle.
    """
    corners = [FRAME.geodetic(x, y) for x, y in ring]
    rings = SimpleNamespace(
        latitude=[float(corner.latitude) for corner in corners],
        longitude=[float(corner.longitude) for corner in corners],
    )
    fields = {
        "id": "<i>storm",
        "keep": 0,
        "valid": 0,
        "rings": [rings] if corners else [],
        "latitude": 47.0,
        "longitude": 8.0,
        "radius": 0.0,
        "velocity": SimpleNamespace(x=10.0, y=0.0, z=0.0),
        "growth": 5.0,
        "floor": 0.0,
        "floor_reference": 0,
        "ceiling": 3_000.0,
        "ceiling_reference": 2,
        "valid_from": stamp(0),
        "valid_until": stamp(NOW + 60 * SECOND),
        "clearance": 100.0,
    }
    return SimpleNamespace(**(fields | changes))


def areas(*messages: Any, time: int = NOW) -> Any:
    """Return an Areas message of a time, ns."""
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp(time)), areas=list(messages))


class Served(BackgroundServer):
    """A server in a thread, which tells :attr:`said`."""

    def __init__(self, source: LiveSource | Recording) -> None:
        self.said: list[str] = []
        super().__init__(source, "a test", self.said.append)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"


def serving(source: LiveSource | Recording) -> Served:
    """Serve a source until the block ends."""
    return Served(source)
