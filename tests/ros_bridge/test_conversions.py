"""Messages to domain values: every field is taken as it is or refused by its name, and places in
the local frame.
"""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

import pyproj

from agents.planner.request.request import Altitude
from envs.formats.local_frame import LocalFrame, distance, fly_straight
from ros_bridge.core import conversions
from ros_bridge.core.adapters import adsb_vehicle, inspva, inspvax, nav_sat_fix
from ros_bridge.core.fields import FieldError, callsign
from ros_bridge.core.reports import EXACT, Report
from tests.ros_bridge.scenes import (
    NOW,
    SECOND,
    aircraft,
    alert,
    fields_of,
    geo_reference,
    message,
    point,
    publish,
    stamp,
)

rubbish = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300])


def change_field(message, path: str, value) -> None:
    *parents, last = path.split(".")
    for name in parents:
        message = getattr(message, name)
    setattr(message, last, value)


def full():
    """Return an aircraft all of whose fields are valid and agree."""
    return aircraft(
        1_000.0,
        2_000.0,
        0.5,
        80.0,
        valid=0xFF,
        altitude=1_500.0,
        altitude_reference=2,
        true_airspeed=80.0,
        position_std=5.0,
        velocity_std=0.5,
    )


def test_a_good_state_is_taken_field_by_field():
    message = full()
    message.velocity.z = 2.0
    report = conversions.aircraft(message, "it")
    assert (report.identifier, report.time) == ("4b1a2c", NOW)
    assert (report.latitude, report.longitude) == (message.latitude, message.longitude)
    assert math.hypot(report.east, report.north) == pytest.approx(80.0)
    assert report.altitude == Altitude(1_500.0, "msl", 2.0)
    assert (report.position_std, report.velocity_std, report.wind) == (5.0, 0.5, (0.0, 0.0))


@pytest.mark.parametrize(
    "path",
    [
        "latitude",
        "longitude",
        "altitude",
        "velocity.x",
        "velocity.y",
        "velocity.z",
        "true_airspeed",
        "wind.x",
        "wind.y",
        "position_std",
        "velocity_std",
    ],
)
@given(value=rubbish)
def test_value_not_finite_or_out_of_range_is_refused_by_name(path: str, value: float):
    message = full()
    change_field(message, path, value)
    with pytest.raises(FieldError) as caught:
        conversions.aircraft(message, "it")
    assert caught.value.field == f"it.{path}"
    assert str(caught.value).startswith(f"it.{path} is ")
    assert "expected" in str(caught.value)


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        ("valid", 0x04, "it.valid"),
        ("valid", 0x01, "it.valid"),
        ("valid", 0x205, "it.valid"),
        ("id", "", "it.id"),
        ("id", "x" * 65, "it.id"),
        ("id", "a\nb", "it.id"),
        ("altitude_reference", 0, "it.altitude_reference"),
        ("altitude_reference", 9, "it.altitude_reference"),
        ("true_airspeed", 50.0, "it.true_airspeed"),
        ("wind.x", 60.0, "it.true_airspeed"),
        ("latitude", 90.01, "it.latitude"),
        ("longitude", 180.01, "it.longitude"),
        ("header.stamp", stamp(0), "it.header.stamp"),
        ("header.stamp", SimpleNamespace(sec=1, nanosec=SECOND), "it.header.stamp.nanosec"),
        ("position_std", -1.0, "it.position_std"),
    ],
)
def test_inconsistent_fields_are_refused_by_name(path: str, value: object, field: str):
    message = full()
    change_field(message, path, value)
    with pytest.raises(FieldError) as caught:
        conversions.aircraft(message, "it")
    assert caught.value.field == field


@given(value=rubbish)
def test_a_field_without_its_bit_is_not_read(value: float):
    message = full()
    message.valid = 0x05
    for path in (
        "altitude",
        "velocity.z",
        "true_airspeed",
        "wind.x",
        "position_std",
        "velocity_std",
    ):
        change_field(message, path, value)
    report = conversions.aircraft(message, "it")
    assert report.altitude is None and report.wind is None and report.true_airspeed is None
    assert report.position_std is None and report.velocity_std is None and report.time_std == 0.0


@given(rubbish)
def test_a_geo_reference_is_refused_by_name(value: float):
    for field in ("latitude", "longitude", "geoid_undulation"):
        with pytest.raises(FieldError) as caught:
            conversions.geo_reference(
                geo_reference(**{"geoid_undulation_valid": True, field: value})
            )
        assert caught.value.field == f"geo_reference.{field}"


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (alert(level=2), "alert.intruder_ids"),
        (alert("a", level=0), "alert.intruder_ids"),
        (alert("a", "b", "a"), "alert.intruder_ids[2]"),
        (alert("a", level=4), "alert.level"),
        (alert("", level=1), "alert.intruder_ids[0]"),
        (alert("a", time=0), "alert.header.stamp"),
    ],
)
def test_alerts_that_contradict_themselves_are_refused(message, field: str):
    with pytest.raises(FieldError) as caught:
        conversions.alert(message)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("points", "field"),
    [
        ([], "route.waypoints"),
        ([point(1, 47.0, 8.0)], "route.waypoints"),
        ([point(1, 47.0, 8.0), point(1, 47.1, 8.0)], "route.waypoints[1].index"),
        ([point(1, 47.0, 8.0), point(2**31, 47.1, 8.0)], "route.waypoints[1].index"),
        ([point(1, 47.0, 8.0), point(2, math.nan, 8.0)], "route.waypoints[1].latitude"),
        ([point(1, 47.0, 8.0), point(2, 47.0, 200.0)], "route.waypoints[1].longitude"),
        ([point(1, 47.0, 8.0), point(2, 47.1, 8.0, origin=1)], "route.waypoints[1].origin"),
        (
            [point(1, 47.0, 8.0, valid=1), point(2, 47.1, 8.0)],
            "route.waypoints[0].altitude_reference",
        ),
        ([point(1, 47.0, 8.0, valid=16), point(2, 47.1, 8.0)], "route.waypoints[0].valid"),
    ],
)
def test_bad_routes_are_refused_by_name(points: list, field: str):
    with pytest.raises(FieldError) as caught:
        conversions.published_route(publish(points))
    assert caught.value.field == field


def test_a_plan_is_no_route():
    with pytest.raises(FieldError, match=r"route\.status is 1, expected 4"):
        conversions.published_route(publish([point(1, 47.0, 8.0), point(2, 47.1, 8.0)], status=1))


# The local frame against PROJ's own map and its geodesics: round trips, distances, directions,
# predictions.

GEOD = pyproj.Geod(ellps="WGS84")
ORIGINS = [
    (0.0, 0.0),
    (47.0, 8.0),
    (47.0, 179.99),
    (-33.0, -179.99),
    (89.0, 20.0),
    (90.0, 0.0),
    (-90.0, 135.0),
]
origins = st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
places = st.tuples(st.floats(0.0, 60_000.0), st.floats(-math.pi, math.pi))


def disc(radius: float, count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    far, way = (
        radius * np.sqrt(generator.uniform(size=count)),
        generator.uniform(-math.pi, math.pi, count),
    )
    return far * np.cos(way), far * np.sin(way)


@given(origins, places)
def test_there_and_back_is_the_same_place(origin: tuple[float, float], place: tuple[float, float]):
    frame = LocalFrame(*origin)
    x, y = place[0] * math.cos(place[1]), place[0] * math.sin(place[1])
    geodetic = frame.geodetic(x, y)
    back = frame.place(geodetic.latitude, geodetic.longitude)
    assert math.hypot(float(back.x) - x, float(back.y) - y) <= 1e-6
    assert -180.0 <= geodetic.longitude < 180.0


@given(origins)
def test_the_origin_is_the_centre_and_its_north_is_north(origin: tuple[float, float]):
    at = LocalFrame(*origin).place(*origin)
    assert math.hypot(float(at.x), float(at.y)) <= 1e-6
    assert float(at.convergence) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("origin", ORIGINS)
def test_places_agree_with_projs_azimuthal_equidistant_map(origin: tuple[float, float]):
    x, y = disc(60_000.0, 500)
    geodetic = LocalFrame(*origin).geodetic(x, y)
    proj = pyproj.Proj(proj="aeqd", lat_0=origin[0], lon_0=origin[1], ellps="WGS84")
    east, north = proj(geodetic.longitude, geodetic.latitude)
    assert np.max(np.hypot(east - x, north - y)) <= 1e-6


@pytest.mark.parametrize(("radius", "allowed"), [(57_000.0, 0.6), (60_000.0, 0.69)])
@pytest.mark.parametrize("origin", ORIGINS)
def test_distances_between_places_are_those_on_the_ellipsoid(
    origin: tuple[float, float], radius: float, allowed: float
):
    x, y = disc(radius, 4_000)
    # The largest errors are between points on the rim.
    way = np.linspace(0.0, 2.0 * math.pi, 200)
    x, y = (
        np.r_[x, radius * np.cos(way), radius * np.cos(2.3 * way)],
        np.r_[y, radius * np.sin(way), radius * np.sin(2.3 * way)],
    )
    geodetic = LocalFrame(*origin).geodetic(x, y)
    half = x.size // 2
    true = GEOD.inv(
        geodetic.longitude[:half],
        geodetic.latitude[:half],
        geodetic.longitude[half:],
        geodetic.latitude[half:],
    )[2]
    assert np.max(np.abs(np.hypot(x[:half] - x[half:], y[:half] - y[half:]) - true)) <= allowed


@pytest.mark.parametrize("latitude", [0.0, 47.0, 89.0])
@pytest.mark.parametrize("longitude", [8.0, 179.99])
def test_straight_flight_far_from_the_origin_is_predicted(latitude: float, longitude: float):
    frame = LocalFrame(latitude, longitude)
    way = np.linspace(-math.pi, math.pi, 721)
    x, y = 60_000.0 * np.cos(way), 60_000.0 * np.sin(way)
    at = frame.geodetic(x, y)
    track = np.degrees(7.0 * way)
    length = 40_000.0
    east, north = frame.place(at.latitude, at.longitude).velocity(
        np.sin(np.radians(track)), np.cos(np.radians(track))
    )
    longitude_, latitude_, _ = GEOD.fwd(
        at.longitude, at.latitude, track, np.full(track.shape, length)
    )
    later = frame.place(latitude_, longitude_)
    off = np.hypot(later.x - x - length * east, later.y - y - length * north)
    assert np.max(off) <= 5.0


def test_without_the_convergence_the_prediction_would_be_far_off():
    frame = LocalFrame(47.0, 8.0)
    at = frame.geodetic(60_000.0, 0.0)
    assert math.degrees(float(at.convergence)) == pytest.approx(0.58, abs=0.01)
    assert 40_000.0 * abs(float(at.convergence)) > 400.0


def test_the_antimeridian_is_no_border():
    frame = LocalFrame(10.0, 179.99)
    at = frame.place([10.0, 10.0], [-179.99, 180.01])
    assert at.x == pytest.approx([2192.9, 2192.9], abs=1.0)
    assert np.all(np.abs(at.y) < 1.0)


@given(origins, st.floats(-math.pi, math.pi), st.floats(0.0, 300.0), st.floats(0.0, 30.0))
def test_dead_reckoning_covers_the_distance_flown(origin, way: float, speed: float, seconds: float):
    to = fly_straight(*origin, speed * math.cos(way), speed * math.sin(way), seconds)
    assert distance(*origin, *to) == pytest.approx(speed * seconds, abs=1e-6)


# Messages of other packages, made from their own definitions, as reports: units, references, what
# is refused.


ADSB = message("mavros_msgs", "ADSBVehicle")
VALID = (
    ADSB.FLAG_VALID_COORDS
    | ADSB.FLAG_VALID_ALTITUDE
    | ADSB.FLAG_VALID_HEADING
    | ADSB.FLAG_VALID_VELOCITY
)
_VERTICAL = 128  # VERTICAL_VELOCITY_VALID of MAVLink, which mavros passes on and does not name


def time(kind: str, nanoseconds: int) -> Any:
    return message(
        "builtin_interfaces", kind, sec=nanoseconds // SECOND, nanosec=nanoseconds % SECOND
    )


def header(nanoseconds: int = NOW) -> Any:
    return message("std_msgs", "Header", stamp=time("Time", nanoseconds))


def fix(**more: Any) -> Any:
    sensor = pytest.importorskip(
        "sensor_msgs.msg", reason="ROS 2 is not installed; to have it: make ros"
    )
    result = sensor.NavSatFix(
        latitude=47.0, longitude=8.0, altitude=500.0, position_covariance_type=2
    )
    result.position_covariance = [4.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 16.0]
    result.header.stamp.sec, result.header.stamp.nanosec = NOW // SECOND, NOW % SECOND
    result.status.status = more.pop("status", sensor.NavSatStatus.STATUS_FIX)
    for name, value in more.items():
        setattr(result, name, value)
    return result


def twist(x: float = 30.0, y: float = 40.0, z: float = 1.0) -> Any:
    return SimpleNamespace(linear=SimpleNamespace(x=x, y=y, z=z))


def test_fix_and_velocity_make_a_report():
    report = nav_sat_fix(fix(), twist, "own", "wgs84")
    assert (report.latitude, report.longitude, report.east, report.north) == (47.0, 8.0, 30.0, 40.0)
    assert report.altitude == Altitude(500.0, "wgs84", 1.0)
    assert report.position_std == 3.0
    assert nav_sat_fix(fix(), twist, "own", "msl").altitude == Altitude(500.0, "msl", 1.0)


def test_fix_without_altitude_or_covariance_is_taken_with_both_unknown():
    report = nav_sat_fix(
        fix(altitude=math.nan, position_covariance=[math.nan] * 9), twist, "own", "wgs84"
    )
    assert (report.altitude, report.position_std, report.velocity_std) == (None, None, None)
    assert (report.latitude, report.east) == (47.0, 30.0)
    assert nav_sat_fix(fix(position_covariance_type=0), twist, "own", "wgs84").position_std is None


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
        nav_sat_fix(fix(**change), lambda: velocity, "own", "wgs84")
    assert caught.value.field == field


def test_fix_without_velocity_still_says_where_the_aircraft_is():
    for status, place in ((0, (47.0, 8.0)), (-1, None)):
        with pytest.raises(FieldError) as caught:
            nav_sat_fix(
                fix(status=status), lambda: twist(math.nan, math.nan, math.nan), " N1 ", "wgs84"
            )
        assert caught.value.sighting == ("n1", NOW, place, None)


def inertial(name: str, **more: Any) -> Any:
    status = message("novatel_oem7_msgs", "InertialSolutionStatus", status=more.pop("status", 3))
    place = {"latitude": 47.0, "longitude": 8.0, "height": 400.0}
    velocity = {"north_velocity": 40.0, "east_velocity": 30.0, "up_velocity": -1.0}
    solution = {"ins_status" if name == "INSPVAX" else "status": status}
    return message(
        "novatel_oem7_msgs", name, header=header(), **(place | velocity | solution | more)
    )


def test_inspva_height_is_ellipsoidal_and_inspvax_above_the_sea():
    report = inspva(inertial("INSPVA"), "own")
    assert (report.east, report.north, report.time) == (30.0, 40.0, NOW)
    assert report.altitude == Altitude(400.0, "wgs84", -1.0)
    report = inspvax(inertial("INSPVAX", undulation=48.0), "own")
    assert report.altitude == Altitude(448.0, "wgs84", -1.0)


@pytest.mark.parametrize("status", [0, 1, 2, 6, 7])
@pytest.mark.parametrize(
    ("read", "name", "field"),
    [(inspva, "INSPVA", "status"), (inspvax, "INSPVAX", "ins_status")],
)
def test_inertial_solution_that_is_not_good_is_refused(
    read: Callable[[Any, str], Report], status: int, name: str, field: str
):
    with pytest.raises(FieldError) as caught:
        read(inertial(name, status=status), "own")
    assert caught.value.field == f"inspva.{field}.status"


def adsb(**more: Any) -> Any:
    fields = {
        "header": header(),
        "icao_address": 0x4B1A2C,
        "callsign": "SWR12K  ",
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


def read(message: Any, references: dict[int, str] | None = None) -> Any:
    report = adsb_vehicle(message, references or {})
    assert report is not None
    return report


@given(st.floats(0.0, 359.9), st.floats(1.0, 300.0))
def test_adsb_heading_is_degrees_clockwise_from_north(heading: float, speed: float):
    report = read(adsb(heading=heading, hor_velocity=speed))
    track = math.degrees(math.atan2(report.east, report.north))
    assert abs(math.remainder(track - heading, 360.0)) < 1e-3
    assert math.hypot(report.east, report.north) == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize(
    ("heading", "track"), [(90.0, 90.0), (3.0, 3.0), (0.0, 0.0), (359.5, 359.5), (360.0, 0.0)]
)
def test_adsb_headings_of_all_quarters_are_taken(heading: float, track: float):
    report = read(adsb(heading=heading, hor_velocity=80.0))
    turn = math.degrees(math.atan2(report.east, report.north)) - track
    assert abs(math.remainder(turn, 360.0)) < 1e-6


def test_a_callsign_is_taken_where_it_is_valid_and_never_refuses_an_aircraft():
    assert read(adsb()).callsign == ""
    assert read(adsb(flags=VALID | 16)).callsign == "SWR12K"
    for wrong in ("<b>x</b>", "\n\n", "A" * 65, "\x00"):
        assert read(adsb(flags=VALID | 16, callsign=wrong)).callsign == ""


@given(st.text(max_size=20) | st.binary(max_size=20) | st.none() | st.integers())
def test_what_is_shown_as_a_callsign_is_plain(value: object):
    plain = callsign(value)
    assert len(plain) <= 16 and plain.isascii() and (plain.isprintable())
    assert callsign(plain) == plain


def test_adsb_report_held_before_it_was_received():
    report = read(adsb())
    assert report.identifier == "4b1a2c"
    assert report.time == NOW - 2 * SECOND
    # Of whole seconds up to one is cut off; of its own errors the message says nothing.
    assert report.spread(EXACT) == (pytest.approx(75.0 / math.sqrt(3.0)), 0.0)
    assert report.position_std is None and report.velocity_std is None


def test_adsb_altitude_is_unknown_unless_its_reference_is_given():
    assert read(adsb()).altitude is None
    assert read(adsb(), {0: "pressure"}).altitude == Altitude(1_000.0, "pressure", 3.0)
    assert read(adsb(altitude_type=ADSB.ALT_GEOMETRIC), {0: "pressure"}).altitude is None


def test_surface_vehicles_are_no_traffic_unless_they_move_as_in_flight():
    named = {kind: getattr(ADSB, kind) for kind in dir(ADSB) if kind.startswith("EMITTER_")}

    def left_out(**moving: float) -> set[str]:
        return {
            kind
            for kind, code in named.items()
            if adsb_vehicle(adsb(emitter_type=code, **moving)) is None
        }

    vehicles = {"EMITTER_EMERGENCY_SURFACE", "EMITTER_SERVICE_SURFACE"}
    assert left_out(hor_velocity=9.0, ver_velocity=0.0) == vehicles
    assert left_out(hor_velocity=75.0, ver_velocity=0.0) == set()
    assert left_out(hor_velocity=9.0, ver_velocity=-3.25) == set()
    assert left_out(hor_velocity=9.0, ver_velocity=0.0, altitude=6_000.0) == set()
    for unreadable in ("hor_velocity", "ver_velocity", "altitude"):
        with pytest.raises(FieldError):
            # Neither believed to be on the ground nor traffic without a fault.
            moving = {"hor_velocity": 9.0, "ver_velocity": 0.0, unreadable: math.nan}
            adsb_vehicle(adsb(emitter_type=17, **moving), {0: "msl"})


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
    assert (
        sighting is not None
        and sighting.identifier == f"{change.get('icao_address', 0x4B1A2C):06x}"
    )
    has_place = "latitude" not in change and change.get("flags", VALID) & ADSB.FLAG_VALID_COORDS
    assert sighting.place == ((47.0, 8.0) if has_place else None)


@pytest.mark.parametrize(
    "kind", ["std_msgs/Header", "builtin_interfaces/Time", "builtin_interfaces/Duration"]
)
def test_definitions_of_common_messages_are_those_installed(kind: str):
    package, name = kind.split("/")
    installed = pytest.importorskip(
        f"{package}.msg", reason="ROS 2 is not installed; to have it: make ros"
    )
    assert fields_of(package, name) == getattr(installed, name).get_fields_and_field_types()
