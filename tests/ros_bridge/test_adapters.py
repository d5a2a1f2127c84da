"""Messages of other packages, made from their own definitions, as reports: units, references, what is refused."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.request import Altitude
from ros_bridge.core.adapters import adsb_vehicle, fix_sighting, inspva, nav_sat_fix
from ros_bridge.core.fields import FieldError
from tests.ros_bridge.scenes import NOW, SECOND, fields_of, message

ADSB = message("mavros_msgs", "ADSBVehicle")
VALID = ADSB.FLAG_VALID_COORDS | ADSB.FLAG_VALID_ALTITUDE | ADSB.FLAG_VALID_HEADING | ADSB.FLAG_VALID_VELOCITY
_VERTICAL = 128  # VERTICAL_VELOCITY_VALID of MAVLink, which mavros passes on and does not name


def time(kind: str, nanoseconds: int) -> Any:
    return message("builtin_interfaces", kind, sec=nanoseconds // SECOND, nanosec=nanoseconds % SECOND)


def header(nanoseconds: int = NOW) -> Any:
    return message("std_msgs", "Header", stamp=time("Time", nanoseconds))


def fix(**more: Any) -> Any:
    sensor = pytest.importorskip("sensor_msgs.msg", reason="ROS 2 is not installed; to have it: make ros")
    result = sensor.NavSatFix(latitude=47.0, longitude=8.0, altitude=500.0, position_covariance_type=2)
    result.position_covariance = [4.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 16.0]
    result.header.stamp.sec, result.header.stamp.nanosec = NOW // SECOND, NOW % SECOND
    result.status.status = more.pop("status", sensor.NavSatStatus.STATUS_FIX)
    for name, value in more.items():
        setattr(result, name, value)
    return result


def twist(x: float = 30.0, y: float = 40.0, z: float = 1.0) -> Any:
    return SimpleNamespace(linear=SimpleNamespace(x=x, y=y, z=z))


def test_fix_and_velocity_make_a_report():
    report = nav_sat_fix(fix(), twist(), "own")
    assert (report.latitude, report.longitude, report.east, report.north) == (47.0, 8.0, 30.0, 40.0)
    assert report.altitude == Altitude(500.0, "wgs84", 1.0)
    assert report.position_std == 3.0
    assert nav_sat_fix(fix(), twist(), "own", "msl").altitude == Altitude(500.0, "msl", 1.0)


def test_fix_without_altitude_or_covariance_is_taken_with_both_unknown():
    report = nav_sat_fix(fix(altitude=math.nan, position_covariance=[math.nan] * 9), twist(), "own")
    assert (report.altitude, report.position_std) == (None, 0.0)
    assert (report.latitude, report.east) == (47.0, 30.0)
    assert nav_sat_fix(fix(position_covariance_type=0), twist(), "own").position_std == 0.0


@pytest.mark.parametrize(
    ("change", "velocity", "field"),
    [
        ({"status": -1}, twist(), "fix.status.status"),
        ({"latitude": math.nan}, twist(), "fix.latitude"),
        ({"altitude": math.inf}, twist(), "fix.altitude"),
        ({"position_covariance": [-1.0] * 9}, twist(), "fix.position_covariance[0]"),
        ({}, twist(x=math.nan), "fix.velocity.x"),
        ({}, twist(z=math.inf), "fix.twist.linear.z"),
    ],
)
def test_bad_fix_is_refused_by_name(change: dict, velocity: Any, field: str):
    with pytest.raises(FieldError) as caught:
        nav_sat_fix(fix(**change), velocity, "own")
    assert caught.value.field == field


def test_fix_without_velocity_still_says_where_the_aircraft_is():
    assert fix_sighting(fix(), " N1 ") == ("n1", NOW, (47.0, 8.0), None)
    assert fix_sighting(fix(status=-1), "n1").place is None


def inertial(name: str, **more: Any) -> Any:
    status = message("novatel_oem7_msgs", "InertialSolutionStatus", status=more.pop("status", 3))
    place = {"latitude": 47.0, "longitude": 8.0, "height": 400.0}
    velocity = {"north_velocity": 40.0, "east_velocity": 30.0, "up_velocity": -1.0}
    solution = {"ins_status" if name == "INSPVAX" else "status": status}
    return message("novatel_oem7_msgs", name, header=header(), **(place | velocity | solution | more))


def test_inspva_height_is_ellipsoidal_and_inspvax_above_the_sea():
    report = inspva(inertial("INSPVA"), "own")
    assert (report.east, report.north, report.time) == (30.0, 40.0, NOW)
    assert report.altitude == Altitude(400.0, "wgs84", -1.0)
    assert inspva(inertial("INSPVAX", undulation=48.0), "own").altitude == Altitude(448.0, "wgs84", -1.0)


@pytest.mark.parametrize("status", [0, 1, 2, 6, 7])
@pytest.mark.parametrize(("name", "field"), [("INSPVA", "status"), ("INSPVAX", "ins_status")])
def test_inertial_solution_that_is_not_good_is_refused(status: int, name: str, field: str):
    with pytest.raises(FieldError) as caught:
        inspva(inertial(name, status=status), "own")
    assert caught.value.field == f"inspva.{field}.status"


def adsb(**more: Any) -> Any:
    fields = {
        "header": header(),
        "icao_address": 0x4B1A2C,
        "latitude": 47.0,
        "longitude": 8.0,
        "altitude": 1_000.0,
        "heading": 90.0,
        "hor_velocity": 75.0,
        "ver_velocity": 3.0,
        "tslc": time("Duration", 2 * SECOND),
        "flags": VALID | _VERTICAL,
    }
    return message("mavros_msgs", "ADSBVehicle", **(fields | more))


def read(given: Any, references: dict[int, str] | None = None) -> Any:
    report = adsb_vehicle(given, references or {})
    assert report is not None
    return report


@given(st.floats(0.0, 359.9), st.floats(1.0, 300.0))
def test_adsb_heading_is_degrees_clockwise_from_north(heading: float, speed: float):
    report = read(adsb(heading=heading, hor_velocity=speed))
    track = math.degrees(math.atan2(report.east, report.north))
    assert abs(math.remainder(track - heading, 360.0)) < 1e-3
    assert math.hypot(report.east, report.north) == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize(("heading", "track"), [(90.0, 90.0), (3.0, 3.0), (0.0, 0.0), (359.5, 359.5), (360.0, 0.0)])
def test_adsb_headings_of_all_quarters_are_taken(heading: float, track: float):
    report = read(adsb(heading=heading, hor_velocity=80.0))
    turn = math.degrees(math.atan2(report.east, report.north)) - track
    assert abs(math.remainder(turn, 360.0)) < 1e-6


def test_adsb_report_held_before_it_was_received():
    report = read(adsb())
    assert report.identifier == "4b1a2c"
    assert report.time == NOW - 2 * SECOND
    assert report.position_std == pytest.approx(75.0 / math.sqrt(3.0))


def test_adsb_altitude_is_unknown_unless_its_reference_is_given():
    assert read(adsb()).altitude is None
    assert read(adsb(), {0: "pressure"}).altitude == Altitude(1_000.0, "pressure", 3.0)
    assert read(adsb(altitude_type=ADSB.ALT_GEOMETRIC), {0: "pressure"}).altitude is None


def test_adsb_vehicles_on_the_ground_are_no_traffic():
    named = {kind: getattr(ADSB, kind) for kind in dir(ADSB) if kind.startswith("EMITTER_")}
    left_out = {kind for kind, code in named.items() if adsb_vehicle(adsb(emitter_type=code)) is None}
    assert left_out == {"EMITTER_EMERGENCY_SURFACE", "EMITTER_SERVICE_SURFACE", "EMITTER_POINT_OBSTACLE"}


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"flags": VALID & ~ADSB.FLAG_VALID_COORDS}, "adsb.flags"),
        ({"flags": VALID & ~ADSB.FLAG_VALID_HEADING}, "adsb.flags"),
        ({"flags": VALID & ~ADSB.FLAG_VALID_VELOCITY}, "adsb.flags"),
        ({"icao_address": 0}, "adsb.icao_address"),
        ({"tslc": time("Duration", 255 * SECOND)}, "adsb.tslc.sec"),
        ({"hor_velocity": math.nan}, "adsb.hor_velocity"),
        ({"heading": math.inf}, "adsb.heading"),
        ({"heading": -10.0}, "adsb.heading"),
        ({"heading": 361.0}, "adsb.heading"),
        ({"latitude": math.nan}, "adsb.latitude"),
        ({"ver_velocity": math.nan}, "adsb.ver_velocity"),
    ],
)
def test_bad_adsb_report_is_refused_and_its_aircraft_named(change: dict, field: str):
    with pytest.raises(FieldError) as caught:
        adsb_vehicle(adsb(**change))
    assert caught.value.field == field
    sighting = caught.value.sighting
    assert sighting is not None and sighting.identifier == f"{change.get('icao_address', 0x4B1A2C):06x}"
    known = "latitude" not in change and change.get("flags", VALID) & ADSB.FLAG_VALID_COORDS
    assert sighting.place == ((47.0, 8.0) if known else None)


@pytest.mark.parametrize("kind", ["std_msgs/Header", "builtin_interfaces/Time", "builtin_interfaces/Duration"])
def test_definitions_of_common_messages_are_those_installed(kind: str):
    package, name = kind.split("/")
    installed = pytest.importorskip(f"{package}.msg", reason="ROS 2 is not installed; to have it: make ros")
    assert fields_of(package, name) == getattr(installed, name).get_fields_and_field_types()
