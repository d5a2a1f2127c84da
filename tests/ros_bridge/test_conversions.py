"""Messages to domain values: every field is taken as it is or refused by its name."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.request import Altitude
from ros_bridge.core import conversions
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
def test_value_not_finite_or_out_of_range_is_refused_by_name(path: str, value: float):
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
