"""Areas of messages come into the local frame as they are at the request, or the field that is wrong
is named.
"""

import copy
import json
import math
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.answer import Plan, Source, Status
from envs.area_geometry import signed_distance
from envs.areas import Area, AreaError, Circle, Keep, Level, Polygon
from ros_bridge.core.areas import areas, areas_of_file, to_local
from ros_bridge.core.conversions import Origin
from ros_bridge.core.fields import Code, FieldError, Refusal
from ros_bridge.core.situation import Held, Situation
from ros_bridge.core.tasks import task
from tests.ros_bridge.graph import MISSING, NODE, PATIENCE, Client, Process, World, domain
from tests.ros_bridge.scenes import FRAME, NOW, SECOND, SETTINGS, crossing, situation_after, stamp

WITHIN = 1e5
TRIANGLE = ((0.0, 0.0), (2e3, 0.0), (0.0, 1.5e3))


def ring(points: Any) -> Any:
    at = FRAME.geodetic(*zip(*points, strict=True))
    return SimpleNamespace(latitude=at.latitude.tolist(), longitude=at.longitude.tolist())


def area(**more: Any) -> Any:
    fields = {
        "id": "TRA 1",
        "keep": 0,
        "valid": 0x0F,
        "rings": [ring(TRIANGLE)],
        "latitude": 47.0,
        "longitude": 8.0,
        "radius": 500.0,
        "velocity": SimpleNamespace(x=5.0, y=-2.0, z=0.0),
        "growth": 0.0,
        "floor": 300.0,
        "floor_reference": 4,
        "ceiling": 2_000.0,
        "ceiling_reference": 2,
        "valid_from": stamp(NOW + 60 * SECOND),
        "valid_until": stamp(NOW + 90 * SECOND),
        "clearance": 50.0,
    }
    return SimpleNamespace(**(fields | more))


def message(*every: Any) -> Any:
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp(NOW)), areas=list(every))


def test_an_area_stands_where_it_is_at_the_request() -> None:
    report = areas(message(area(), area(rings=[], keep=1, valid=0)))
    cell, disc = to_local(report, FRAME, NOW + 20 * SECOND, WITHIN)
    assert isinstance(cell.shape, Polygon)
    expected = np.add(TRIANGLE, (100.0, -40.0))
    assert np.array(cell.shape.outer) == pytest.approx(expected, abs=1e-6)
    assert (cell.floor, cell.ceiling) == (Level(300.0, "ground"), Level(2_000.0, "msl"))
    assert (cell.valid_from, cell.valid_until) == (40.0, 70.0)
    assert (cell.clearance, cell.velocity, cell.name) == (50.0, (5.0, -2.0), "TRA 1")
    assert disc.shape == Circle(100.0, -40.0, 500.0)
    assert (disc.keep, disc.floor, disc.valid_until) == (Keep.IN, None, math.inf)


def test_what_has_grown_since_the_message_is_kept_from() -> None:
    report = areas(message(area(growth=2.0)))
    (now,) = to_local(report, FRAME, NOW, WITHIN)
    (later,) = to_local(report, FRAME, NOW + 20 * SECOND, WITHIN)
    assert later.clearance == 90.0
    assert signed_distance(later, 5e3, 5e3, 10.0) - later.clearance == pytest.approx(
        signed_distance(now, 5e3, 5e3, 30.0) - now.clearance
    )


def test_far_areas_are_left_out() -> None:
    far = area(rings=[], latitude=49.0)
    assert to_local(areas(message(far)), FRAME, NOW, WITHIN) == ()
    assert len(to_local(areas(message(far)), FRAME, NOW, 3e5)) == 1


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"keep": 2}, r"areas.areas\[0\].keep is 2, expected an integer from 0 to 1"),
        ({"valid": 16}, r"areas\[0\].valid is 0x10, expected bits of 0xf only"),
        ({"id": "x" * 65}, r"areas\[0\].id is 'x.*, expected a printable name of 64 bytes"),
        ({"floor": math.nan}, r"areas\[0\].floor is nan, expected"),
        ({"ceiling_reference": 0}, r"areas\[0\].ceiling_reference is 0, expected one of"),
        ({"valid_from": stamp(0)}, r"areas\[0\].valid_from is 0 s, expected a time after zero"),
        ({"growth": math.inf}, r"areas\[0\].growth is inf"),
        ({"clearance": -1.0}, r"areas\[0\].clearance is -1"),
        ({"velocity": SimpleNamespace(x=math.nan, y=0.0)}, r"areas\[0\].velocity.x is nan"),
        ({"rings": [ring(TRIANGLE[:2])]}, r"rings\[0\].latitude has 2 points, expected 3"),
        (
            {"rings": [SimpleNamespace(latitude=[1.0] * 4, longitude=[1.0] * 3)]},
            r"rings\[0\].longitude has 3 numbers, expected 4 as latitude has",
        ),
        (
            {"rings": [SimpleNamespace(latitude=[95.0] * 3, longitude=[1.0] * 3)]},
            r"rings\[0\]\[0\].latitude is 95, expected -90 to 90 degrees",
        ),
        ({"rings": [], "radius": 0.0}, r"areas\[0\] is no area: radius is 0 m"),
        (
            {"rings": [ring((*TRIANGLE, (1.5e3, 1.5e3)))]},
            r"areas\[0\] is no area: outer crosses or touches itself",
        ),
        (
            {"valid_until": stamp(NOW)},
            r"areas\[0\] is no area: valid_until is 0 s, expected more than valid_from",
        ),
    ],
)
def test_a_wrong_field_is_named(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(FieldError, match=problem):
        to_local(areas(message(area(**changes))), FRAME, NOW, WITHIN)


def test_messages_hold_what_an_area_is() -> None:
    pytest.importorskip("rlcas_msgs.msg", reason="rlcas_msgs is not built; to have it: make ros")
    from ros_bridge.transport.messages import areas_message

    sent_areas = [
        Area(Polygon(TRIANGLE, (((1e2, 1e2), (2e2, 1e2), (1e2, 2e2)),)), name="TRA"),
        Area(
            Circle(3e3, 0.0, 4e2),
            Keep.IN,
            (1.0, 2.0),
            0.5,
            Level(1e2, "msl"),
            Level(2e3, "wgs84"),
            valid_from=10.0,
            valid_until=20.0,
            clearance=5.0,
        ),
    ]
    sent = areas_message(sent_areas, NOW, FRAME, "map")
    received_areas = to_local(areas(copy.deepcopy(sent)), FRAME, NOW, WITHIN)
    for sent_area, received in zip(sent_areas, received_areas, strict=True):
        for name in Area.__slots__:
            if name != "shape":
                assert getattr(sent_area, name) == getattr(received, name), name
    assert np.array(received_areas[0].shape.outer) == pytest.approx(np.array(TRIANGLE), abs=1e-6)
    assert received_areas[1].shape.radius == 4e2


SQUARE = [[8.1, 47.0], [8.2, 47.0], [8.2, 47.1], [8.1, 47.1], [8.1, 47.0]]


def write_areas(folder: Path, ring: list[list[float]] = SQUARE, **properties: object) -> str:
    """Return the name of a file with one area."""
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "geometry": shape, "properties": properties}
    path = folder / "areas.geojson"
    path.write_text(json.dumps(feature))
    return str(path)


def test_areas_of_a_file_count_between_their_dates(tmp_path: Path) -> None:
    assert areas_of_file("") == ()
    file_areas = areas_of_file(
        write_areas(tmp_path, valid_until="2023-11-14T22:14:00Z", name="field")
    )
    begun = datetime(2023, 11, 14, 22, 13, tzinfo=UTC)
    for seconds in (0.0, 90.0):
        now = round((begun.timestamp() + seconds) * SECOND)
        (placed,) = Situation(fixed_areas=file_areas).areas_in(FRAME, now)
        (active_area,) = placed.at(now + 10 * SECOND)
        assert active_area.name == "field"
        assert active_area.valid_until == pytest.approx(50.0 - seconds)


def test_heights_above_the_sea_are_those_of_altitudes_where_the_geoid_is_known(
    tmp_path: Path,
) -> None:
    limits = {"floor_m": 100.0, "floor_reference": "msl"}
    limits |= {"ceiling_m": 500.0, "ceiling_reference": "pressure"}
    file_areas, now = areas_of_file(write_areas(tmp_path, **limits)), 10**18
    for undulation, floor in ((None, Level(100.0, "msl")), (48.0, Level(148.0, "wgs84"))):
        origin = Held(Origin(FRAME, undulation))
        (placed,) = Situation(origin=origin, fixed_areas=file_areas).areas_in(FRAME, now)
        assert placed.areas[0].floor == floor
        assert placed.areas[0].ceiling == Level(500.0, "pressure")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"velocity_east_m_s": 3.0}, "has velocity, expected an area that stands"),
        ({"valid_until_s": 60.0}, "has valid_until, expected an area that stands"),
        ({"ring": [[8.1, 47.0], [8.2, 47.1], [8.2, 47.0], [8.1, 47.1]]}, "crosses"),
        ({"clearance_m": -1.0}, "expected 0 to"),
        (
            {"valid_from": "2023-11-14T22:14:00Z", "valid_until": "2023-11-14T22:13:00Z"},
            "expected a date after valid_from",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(tmp_path: Path, changes: dict, says: str) -> None:
    with pytest.raises(AreaError, match=says) as refused:
        areas_of_file(write_areas(tmp_path, **changes))
    assert "areas.geojson" in str(refused.value)
    with pytest.raises(AreaError, match="missing"):
        areas_of_file(str(tmp_path / "missing"))


def test_a_node_does_not_fly_without_the_areas_of_its_file(tmp_path: Path) -> None:
    far = [[12.1, 47.0], [12.2, 47.0], [12.2, 47.1]]
    for ring, says in ((far, r"the nearest \d+ km$"), ([p[::-1] for p in SQUARE], "exchanged")):
        file = write_areas(tmp_path, ring)
        situation = replace(
            situation_after(crossing()), fixed_areas=areas_of_file(file), areas_file=file
        )
        with pytest.raises(Refusal, match=says) as refused:
            task(situation, NOW, SETTINGS)
        assert (refused.value.code, refused.value.field) == (Code.INVALID_TASK, "areas_file")
    # An autopilot's fence has no file: it may belong to another place.
    assert task(replace(situation, areas_file=""), NOW, SETTINGS).areas == ()
    free = write_areas(tmp_path, restriction="NO_RESTRICTION")
    with pytest.raises(AreaError, match="holds no area that is an obstacle"):
        areas_of_file(free)


@pytest.mark.slow
def test_the_monitor_hears_of_areas_on_a_real_graph(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason=MISSING)
    from rlcas_msgs.msg import AssuranceStatus, Trajectory
    from rlcas_msgs.srv import GenerateTrajectory

    from ros_bridge.transport import qos
    from ros_bridge.transport.messages import areas_message
    from ros_bridge.transport.topics import AREAS

    file = write_areas(tmp_path, [[8.1, 47.2], [8.2, 47.2], [8.2, 47.3], [8.1, 47.2]])
    arguments = "--ros-args", "-p", f"areas_file:={file}"
    with domain() as number:
        # A busy machine takes longer than usual.
        runner = Process("ros_bridge.runner", number, *arguments, "-p", "deadline:=5.0")
        monitor = Process("ros_bridge.monitor", number, *arguments)
        refused = Process("ros_bridge.monitor", number, "--ros-args", "-p", "areas_file:=/nowhere")
        client = Client(number)
        world = World(client)
        says = client.hear(AssuranceStatus, "/rlcas_monitor/output/status", qos.LATCHED)
        plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
        publisher = client.node.create_publisher(*AREAS)
        ahead = Area(Circle(12_000.0, 100.0, 1_500.0), clearance=100.0, name="cell")
        world.reference()
        world.route()
        end = time.monotonic() + PATIENCE
        plans_before = 0
        while not plans_before or len(plans) == plans_before:
            assert time.monotonic() < end, [item.reasons for item in says[-3:]]
            world.ownship()
            client.idle(0.1)
            if not plans:
                request = GenerateTrajectory.Request(
                    reason=GenerateTrajectory.Request.REASON_MANUAL
                )
                client.call(GenerateTrajectory, f"{NODE}/generate_trajectory", request)
            elif says and says[-1].state == AssuranceStatus.STATE_MONITORING and not plans_before:
                plans_before = len(plans)
                publisher.publish(areas_message([ahead], time.time_ns(), FRAME, "map"))
        assert any("kept clear" in why for item in says for why in item.reasons)
        places = [FRAME.place(item.latitude, item.longitude) for item in plans[-1].waypoints]
        away = [float(signed_distance(ahead, at.x, at.y)) for at in places]
        assert min(away) >= 99.0
        output, _ = refused.popen.communicate(timeout=PATIENCE)
        assert refused.popen.returncode == 2 and "/nowhere" in output
        assert "Traceback" not in output
        client.close()
        for process in (monitor, runner):
            process.stop()


def test_a_viewer_draws_every_area_and_each_intruders_own_separation() -> None:
    pytest.importorskip("rclpy", reason=MISSING)
    from ros_bridge.transport.views import markers

    requested = task(situation_after(crossing()), NOW, SETTINGS)
    (intruder,) = requested.intruders
    heavy = replace(intruder, separation=2_500.0)
    lake = Area(Polygon(TRIANGLE, (((400.0, 200.0), (800.0, 200.0), (400.0, 500.0)),)), name="lake")
    field = Area(Circle(1e3, 2e3, 3e4), Keep.IN)
    requested = replace(
        requested, intruders=(intruder, heavy), identifiers=("a", "b"), areas=(lake, field)
    )
    unsolved = Plan(
        Status.UNRESOLVED, Source.POLICY, (), math.nan, math.nan, None, math.nan, (), ()
    )
    drawn = markers(unsolved, requested, "map").markers
    widths = [marker.scale.x for marker in drawn if marker.ns == "traffic"]
    assert widths == [2.0 * requested.options.requirement.separation, 5_000.0]
    edges = [marker.points for marker in drawn if marker.ns == "areas"]
    assert [len(edge) - 1 for edge in edges] == [3, 3, 48]
    for edge in edges:
        assert (edge[0].x, edge[0].y) == (edge[-1].x, edge[-1].y)
    assert [(point.x, point.y) for point in edges[0][:-1]] == list(TRIANGLE)
    assert all(math.hypot(p.x - 1e3, p.y - 2e3) == pytest.approx(3e4) for p in edges[2])
    assert [marker.text for marker in drawn if marker.ns == "area names"] == ["lake"]
    colours = [marker.color for marker in drawn if marker.ns == "areas"]
    assert colours[0] == colours[1] != colours[2]
