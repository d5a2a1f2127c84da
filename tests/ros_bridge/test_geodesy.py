"""The local frame against PROJ's own map and its geodesics: round trips, distances, directions, predictions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pyproj = pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from ros_bridge.core.geodesy import LocalFrame, carried, distance  # noqa: E402

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
    east, north = frame.velocity(at.latitude, at.longitude, np.sin(np.radians(track)), np.cos(np.radians(track)))
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
