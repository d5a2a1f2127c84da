"""Compiled code: it agrees with Python, is never compiled in flight, and follows its sources."""

import fcntl
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs import compiled
from envs.angles import atan2, sincos, wrap
from envs.backend import EXACT_FLOATS, FLOATS
from envs.kinematics import Limits, VehicleState, advance, commands

pytestmark = pytest.mark.usefixtures("compiled_code")

_LIMITS = Limits(50.0, 100.0, -0.5, 0.5, 0.05)


def _angles(angle: float, y: float, x: float) -> tuple[float, ...]:
    fast, exact = sincos(wrap(angle, FLOATS), FLOATS), sincos(wrap(angle, FLOATS), EXACT_FLOATS)
    return (*fast, *exact, atan2(y, x, FLOATS), atan2(y, x, EXACT_FLOATS))


def _angles_compiled(angle: float, y: float, x: float) -> tuple[float, ...]:
    fast, exact = sincos(wrap(angle, FLOATS), FLOATS), sincos(wrap(angle, FLOATS), EXACT_FLOATS)
    return fast + exact + (atan2(y, x, FLOATS), atan2(y, x, EXACT_FLOATS))


def _fly(state: VehicleState, throttle: float, steering: float, steps: int) -> VehicleState:
    for _ in range(steps):
        acceleration, yaw_rate = commands((throttle, steering), _LIMITS, FLOATS)
        state = advance(state, acceleration, yaw_rate, 1.0, _LIMITS, FLOATS)
    return state


_START = VehicleState(0.0, 0.0, 0.0, 60.0)
_ANGLES = compiled.Entry(_angles_compiled, lambda: [(0.0, 0.0, 0.0)])
_FLY = compiled.Entry(_fly, lambda: [(_START, 0.0, 0.0, 1)])


@given(st.floats(-50.0, 50.0), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_angles_are_those_of_python(angle: float, y: float, x: float) -> None:
    np.testing.assert_allclose(_ANGLES(angle, y, x), _angles(angle, y, x), rtol=0.0, atol=1e-15)


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1), st.integers(1, 300))
def test_motion_is_that_of_python(
    throttle: float, steering: float, heading: float, steps: int
) -> None:
    start = _START._replace(heading=heading)
    flown = _FLY(start, throttle, steering, steps)
    np.testing.assert_allclose(flown, _fly(start, throttle, steering, steps), rtol=0.0, atol=1e-9)


def test_other_types_are_refused_and_not_compiled() -> None:
    with pytest.raises(TypeError, match="No matching definition"):
        _FLY(None, 0.0, 0.0, 1)
    with pytest.raises(TypeError, match="No matching definition"):
        _ANGLES(np.zeros(1), 0.0, 0.0)


def test_what_is_not_in_use_is_interpreted_until_it_is_prepared_again() -> None:
    compiled.use(False)
    assert not _FLY.ready
    assert compiled.prepare()
    assert _FLY.ready


def test_code_of_other_sources_is_kept_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """numba looks at the file of an entry alone: one that it calls may have changed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for package in ("envs", "agents"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "source.py").write_text("A = 1\n")
        monkeypatch.setitem(sys.modules, package, SimpleNamespace(__path__=[tmp_path / package]))
    assert compiled.folder_of_code() is None  # sources are younger than what was imported
    monkeypatch.setattr(compiled, "_IMPORTED", time.time() + 60.0)
    before = compiled.folder_of_code()
    assert before is not None
    assert before == compiled.folder_of_code()
    (tmp_path / "agents" / "source.py").write_text("A = 2\n")
    assert compiled.folder_of_code() not in (before, None)


def test_what_another_process_compiles_comes_last(tmp_path: Path) -> None:
    with (tmp_path / f"{_ANGLES.name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        turns = compiled.in_turns([_ANGLES, _FLY], tmp_path)
        assert next(turns) is _FLY
    assert list(turns) == [_ANGLES]


def test_a_damaged_cache_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compiled, "_IMPORTED", time.time() + 60.0)
    first = compiled.Entry(_fly, lambda: [(_START, 0.0, 0.0, 1)])
    compiled.prepare()
    for index in tmp_path.rglob("*.nbi"):
        index.write_bytes(index.read_bytes()[:20])
    again = compiled.Entry(_fly, lambda: [(_START, 0.0, 0.0, 1)])
    compiled.prepare()
    assert again(_START, 0.5, 0.5, 9) == first(_START, 0.5, 0.5, 9)


def test_without_a_folder_it_is_compiled_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert compiled.folder_of_code() is None
    anew = compiled.Entry(_fly, lambda: [(_START, 0.0, 0.0, 1)])
    assert compiled.prepare()
    assert anew(_START, 0.0, 0.0, 1).x == pytest.approx(60.0)
