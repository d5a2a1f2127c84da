"""Messages to domain values: every field is taken as it is or refused by its name."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.request import Altitude
from ros_bridge.core import conversions
from ros_bridge.core.adapters import adsb_vehicle, inspva, nav_sat_fix
from ros_bridge.core.fields import FieldError
from tests.ros_bridge.scenes import NOW, SECOND, aircraft, alert, geo_reference, point, published, stamp

rubbish = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300])


def changed(message, path: str, value) -> None:
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
def test_what_is_not_finite_or_out_of_range_is_refused_by_name(path: str, value: float):
    message = full()
    changed(message, path, value)
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
        ("valid", 0x105, "it.valid"),
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
    changed(message, path, value)
    with pytest.raises(FieldError) as caught:
        conversions.aircraft(message, "it")
    assert caught.value.field == field


@given(value=rubbish)
def test_a_field_without_its_bit_is_not_read(value: float):
    message = full()
    message.valid = 0x05
    for path in ("altitude", "velocity.z", "true_airspeed", "wind.x", "position_std", "velocity_std"):
        changed(message, path, value)
    report = conversions.aircraft(message, "it")
    assert report.altitude is None and report.wind is None and report.true_airspeed is None
    assert report.position_std == 0.0


@given(rubbish)
def test_a_geo_reference_is_refused_by_name(value: float):
    for field in ("latitude", "longitude", "geoid_undulation"):
        with pytest.raises(FieldError) as caught:
            conversions.geo_reference(geo_reference(**{"geoid_undulation_valid": True, field: value}))
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
        ([point(1, 47.0, 8.0, valid=1), point(2, 47.1, 8.0)], "route.waypoints[0].altitude_reference"),
        ([point(1, 47.0, 8.0, valid=16), point(2, 47.1, 8.0)], "route.waypoints[0].valid"),
    ],
)
def test_bad_routes_are_refused_by_name(points: list, field: str):
    with pytest.raises(FieldError) as caught:
        conversions.published_route(published(points))
    assert caught.value.field == field


def test_a_plan_is_no_route():
    with pytest.raises(FieldError, match=r"route\.status is 1, expected 4"):
        conversions.published_route(published([point(1, 47.0, 8.0), point(2, 47.1, 8.0)], status=1))


def fix(**more):
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "status": SimpleNamespace(status=0),
        "latitude": 47.0,
        "longitude": 8.0,
        "altitude": 500.0,
        "position_covariance": [4.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 16.0],
        "position_covariance_type": 2,
    }
    return SimpleNamespace(**(fields | more))


def twist(x: float = 30.0, y: float = 40.0, z: float = 1.0):
    return SimpleNamespace(linear=SimpleNamespace(x=x, y=y, z=z))


def test_a_fix_and_a_velocity_make_a_report():
    report = nav_sat_fix(fix(), twist(), "own")
    assert (report.latitude, report.longitude, report.east, report.north) == (47.0, 8.0, 30.0, 40.0)
    assert report.altitude == Altitude(500.0, "wgs84", 1.0)
    assert report.position_std == 3.0
    assert nav_sat_fix(fix(), twist(), "own", "msl").altitude == Altitude(500.0, "msl", 1.0)


@pytest.mark.parametrize(
    ("message", "velocity", "field"),
    [
        (fix(status=SimpleNamespace(status=-1)), twist(), "fix.status.status"),
        (fix(latitude=math.nan), twist(), "fix.latitude"),
        (fix(altitude=math.nan), twist(), "fix.altitude"),
        (fix(position_covariance=[math.nan] * 9), twist(), "fix.position_covariance[0]"),
        (fix(), twist(x=math.nan), "fix.velocity.x"),
        (fix(), twist(z=math.inf), "fix.twist.linear.z"),
    ],
)
def test_a_bad_fix_is_refused_by_name(message, velocity, field: str):
    with pytest.raises(FieldError) as caught:
        nav_sat_fix(message, velocity, "own")
    assert caught.value.field == field


def ins(**more):
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "status": SimpleNamespace(status=3),
        "latitude": 47.0,
        "longitude": 8.0,
        "height": 550.0,
        "north_velocity": 40.0,
        "east_velocity": 30.0,
        "up_velocity": -1.0,
    }
    return SimpleNamespace(**(fields | more))


def test_inspva_is_read_with_its_own_axes_and_height():
    report = inspva(ins(), "own")
    assert (report.east, report.north) == (30.0, 40.0)
    assert report.altitude == Altitude(550.0, "wgs84", -1.0)
    extended = ins(ins_status=SimpleNamespace(status=3))
    del extended.status
    assert inspva(extended, "own") == report


@pytest.mark.parametrize("status", [0, 1, 2, 6, 7])
def test_an_inertial_solution_that_is_not_good_is_refused(status: int):
    with pytest.raises(FieldError, match=r"inspva\.status\.status is \d, expected 3"):
        inspva(ins(status=SimpleNamespace(status=status)), "own")


def adsb(**more):
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "icao_address": 0x4B1A2C,
        "latitude": 47.0,
        "longitude": 8.0,
        "altitude_type": 0,
        "altitude": 1_000.0,
        "heading": math.radians(90.0),
        "hor_velocity": 75.0,
        "ver_velocity": 3.0,
        "tslc": SimpleNamespace(sec=2, nanosec=0),
        "flags": 1 | 2 | 4 | 8 | 128,
    }
    return SimpleNamespace(**(fields | more))


def test_an_adsb_report_held_before_it_was_received():
    report = adsb_vehicle(adsb())
    assert report.identifier == "4b1a2c"
    assert report.time == NOW - 2 * SECOND
    assert (report.east, report.north) == pytest.approx((75.0, 0.0), abs=1e-9)
    assert report.position_std == pytest.approx(75.0 / math.sqrt(3.0))


def test_an_adsb_altitude_is_unknown_unless_the_caller_knows_what_it_means():
    assert adsb_vehicle(adsb()).altitude is None
    assert adsb_vehicle(adsb(), {0: "pressure"}).altitude == Altitude(1_000.0, "pressure", 3.0)
    assert adsb_vehicle(adsb(altitude_type=1), {0: "pressure"}).altitude is None


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"flags": 4 | 8}, "adsb.flags"),
        ({"flags": 1 | 8}, "adsb.flags"),
        ({"flags": 1 | 4}, "adsb.flags"),
        ({"icao_address": 0}, "adsb.icao_address"),
        ({"tslc": SimpleNamespace(sec=255, nanosec=0)}, "adsb.tslc.sec"),
        ({"hor_velocity": math.nan}, "adsb.hor_velocity"),
        ({"heading": math.inf}, "adsb.heading"),
        ({"latitude": math.nan}, "adsb.latitude"),
        ({"ver_velocity": math.nan}, "adsb.ver_velocity"),
    ],
)
def test_a_bad_adsb_report_is_refused_by_name(change: dict, field: str):
    with pytest.raises(FieldError) as caught:
        adsb_vehicle(adsb(**change))
    assert caught.value.field == field
