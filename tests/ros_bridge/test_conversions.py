"""Messages to domain values: every field is taken as it is or refused by its name, and places in the local frame."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

import pyproj

from agents.planner.request import Altitude
from envs.formats.local_frame import LocalFrame, carried, distance
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


# The local frame against PROJ's own map and its geodesics: round trips, distances, directions, predictions.

GEOD = pyproj.Geod(ellps="WGS84")
ORIGINS = [(0.0, 0.0), (47.0, 8.0), (47.0, 179.99), (-33.0, -179.99), (89.0, 20.0), (90.0, 0.0), (-90.0, 135.0)]
origins = st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
places = st.tuples(st.floats(0.0, 60_000.0), st.floats(-math.pi, math.pi))


def disc(radius: float, count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    far, way = radius * np.sqrt(generator.uniform(size=count)), generator.uniform(-math.pi, math.pi, count)
    return far * np.cos(way), far * np.sin(way)


@given(origins, places)
def test_there_and_back_is_the_same_place(origin: tuple[float, float], place: tuple[float, float]):
    frame = LocalFrame(*origin)
    x, y = place[0] * math.cos(place[1]), place[0] * math.sin(place[1])
    there = frame.geodetic(x, y)
    back = frame.place(there.latitude, there.longitude)
    assert math.hypot(float(back.x) - x, float(back.y) - y) <= 1e-6
    assert -180.0 <= there.longitude < 180.0


@given(origins)
def test_the_origin_is_the_centre_and_its_north_is_north(origin: tuple[float, float]):
    at = LocalFrame(*origin).place(*origin)
    assert math.hypot(float(at.x), float(at.y)) <= 1e-6
    assert float(at.convergence) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("origin", ORIGINS)
def test_places_agree_with_projs_azimuthal_equidistant_map(origin: tuple[float, float]):
    x, y = disc(60_000.0, 500)
    there = LocalFrame(*origin).geodetic(x, y)
    proj = pyproj.Proj(proj="aeqd", lat_0=origin[0], lon_0=origin[1], ellps="WGS84")
    east, north = proj(there.longitude, there.latitude)
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
    there = LocalFrame(*origin).geodetic(x, y)
    half = x.size // 2
    true = GEOD.inv(there.longitude[:half], there.latitude[:half], there.longitude[half:], there.latitude[half:])[2]
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
    east, north = frame.place(at.latitude, at.longitude).velocity(np.sin(np.radians(track)), np.cos(np.radians(track)))
    longitude_, latitude_, _ = GEOD.fwd(at.longitude, at.latitude, track, np.full(track.shape, length))
    there = frame.place(latitude_, longitude_)
    off = np.hypot(there.x - x - length * east, there.y - y - length * north)
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
    to = carried(*origin, speed * math.cos(way), speed * math.sin(way), seconds)
    assert distance(*origin, *to) == pytest.approx(speed * seconds, abs=1e-6)
