"""What measures and draws the true aircraft tells errors apart, and refuses what it cannot write to."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import c208_figures
from benchmarks.c208 import judge, plans_of, within_power
from commands.command import ConfigError
from envs.c208.conditions import CALM, Conditions
from envs.c208.guidance import Path as Track
from envs.follower import PERIOD


def test_errors_across_along_and_in_time_are_kept_apart() -> None:
    plan = plans_of(4, "circle", 0)[0]
    track = Track(plan.legs)
    clock = [PERIOD * number for number in range(1, 3001)]
    exact = [track.at(time) for time in clock]
    found = judge(plan, exact, [0.0] * len(exact), np.full(len(exact), 2501.0))
    assert found.cross_track.max() < 1e-3 and found.position.max() < 1e-3
    assert found.altitude.max() == 1.0
    late = [track.at(time - 20.0) for time in clock]
    # A guess that is wrong by a second is put right.
    found = judge(plan, late, [19.0] * len(late), np.full(len(late), 2500.0))
    assert found.cross_track.max() < 0.05
    np.testing.assert_allclose(found.late, 20.0, atol=0.02)
    aside = [
        state._replace(
            x=state.x - 5.0 * math.sin(state.heading), y=state.y + 5.0 * math.cos(state.heading)
        )
        for state in exact
    ]
    found = judge(plan, aside, [0.0] * len(aside), np.full(len(aside), 2500.0))
    np.testing.assert_allclose(found.cross_track, 5.0, atol=0.05)
    assert found.late.max() < 0.01


def test_a_plan_within_power_in_calm_air_may_not_be_in_wind() -> None:
    plans = [plan for plan in plans_of(6, "circle", 0) if within_power(plan, CALM)]
    assert plans
    # A gale from ahead or behind always takes one of them out of the range.
    gales = [
        Conditions(wind_east=30.0 * math.cos(a), wind_north=30.0 * math.sin(a))
        for a in np.arange(0.0, 6.3, 0.5)
    ]
    assert all(any(not within_power(plan, gale) for gale in gales) for plan in plans)


@pytest.mark.slow
def test_the_pictures_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["c208_figures", "--out", str(tmp_path / "new" / "folder")])
    assert c208_figures.main() == 0
    assert (tmp_path / "new" / "folder" / "aircraft.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "new" / "folder" / "aircraft.svg").stat().st_size > 10_000
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setattr("sys.argv", ["c208_figures", "--out", str(blocked)])
    with pytest.raises(ConfigError, match="expected a folder"):
        c208_figures.main()
