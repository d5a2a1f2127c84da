"""Altitudes beside vertical speeds: what agrees, and what does not."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.backend import FLOATS
from envs.tracking.heights import Climb, Heights, begin, climb_of, extend

STEP = 30.48  # m: altitudes in steps of 100 ft
Said = Callable[[np.ndarray], np.ndarray]


def fly(climbs: list[float], reported: Said, rows: int = 500, seed: int = 3) -> list[Climb]:
    """Return what is believed after each report of flights that climb, m/s, for a second each."""
    rng = np.random.default_rng(seed)
    altitude, heights, believed = rng.uniform(500.0, 2000.0, rows), None, list[Climb]()
    for climb in climbs:
        altitude = altitude + climb
        rounded = STEP * np.round((altitude + 2.0 * rng.normal(size=rows)) / STEP)
        report = rounded, reported(np.full(rows, climb)), np.zeros(rows)
        heights = (
            begin(*report, np) if heights is None else extend(heights, *report, np.float64(1.0), np)
        )
        believed.append(climb_of(heights, np))
    return believed


PROFILES = {
    "level": [0.0] * 60,
    "climb": [5.0] * 60,
    "begins a descent": [0.0] * 30 + [-float(k) for k in range(8)] + [-8.0] * 22,
    "levels off": [10.0] * 30 + [10.0 - k for k in range(10)] + [0.0] * 20,
}


@pytest.mark.parametrize("climbs", PROFILES.values(), ids=PROFILES)
def test_a_right_vertical_speed_passes_to_the_bit(climbs: list[float]) -> None:
    beliefs = fly(climbs, lambda climb: climb)
    corrected = np.mean([belief.error > 0.0 for belief in beliefs])
    assert corrected < 1e-3
    for climb, belief in zip(climbs, beliefs, strict=True):
        as_reported = belief.error == 0.0
        np.testing.assert_array_equal(belief.climb[as_reported], climb)


@pytest.mark.parametrize(
    "reported",
    [lambda climb: -climb, lambda climb: 0.0 * climb, lambda climb: climb / 0.3048],
    ids=["sign", "zero", "feet"],
)
@pytest.mark.parametrize("climb", [5.0, -8.0])
def test_a_wrong_vertical_speed_is_taken_from_altitudes(reported: Said, climb: float) -> None:
    for belief in fly([climb] * 60, reported)[20:]:
        assert np.mean(belief.error > 0.0) > 0.99
        assert np.mean(np.abs(belief.climb - climb) <= belief.error) > 0.99
        assert belief.error.max() < 2.0


def test_a_vertical_speed_that_becomes_right_is_believed_again() -> None:
    beliefs = fly([8.0] * 30 + [0.0] * 30, lambda climb: 0.0 * climb)
    assert np.mean(beliefs[29].error > 0.0) > 0.99
    assert np.mean(beliefs[59].error > 0.0) < 0.02


@given(
    st.lists(
        st.tuples(
            st.floats(-500.0, 20_000.0),
            st.floats(-100.0, 100.0),
            st.floats(0.0, 500.0),
            st.floats(1e-3, 30.0),
        ),
        min_size=2,
        max_size=12,
    )
)
def test_arrays_equal_floats_and_stay_finite(rows: list[tuple]) -> None:
    alone: Heights | None = None
    array: Heights | None = None
    for *single, dt in rows:
        columns = [np.array([value]) for value in single]
        alone = begin(*single, FLOATS) if alone is None else extend(alone, *single, dt, FLOATS)
        array = (
            begin(*columns, np) if array is None else extend(array, *columns, np.float64(dt), np)
        )
        pairs = zip(climb_of(alone, FLOATS), climb_of(array, np), strict=True)
        for value, values in pairs:
            assert math.isfinite(value)
            assert float(values[0]) == pytest.approx(float(value), rel=1e-6, abs=1e-6)
