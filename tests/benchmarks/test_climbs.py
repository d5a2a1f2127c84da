"""What the benchmark of climbs asks, what its search in space finds, and what it counts."""

import json
import math

import pytest

from benchmarks import climbs
from benchmarks.levels import OWN_ALTITUDE
from benchmarks.space_search import Motion, escapes
from commands.command import ConfigError
from envs.aircraft import PAPER, Vertical

AIRCRAFT = PAPER._replace(vertical=Vertical(5.0, 4.0, 1.0, 140.0))
OWN = Motion(0.0, 0.0, 2_000.0, 0.0, 75.0, 0.0)


def head_on(away: float, above: float, climb: float = 0.0) -> Motion:
    """Return an intruder that comes along the route."""
    return Motion(away, 0.0, OWN.z + above, math.pi, 75.0, climb)


def test_the_search_in_space_climbs_where_a_turn_alone_does_not_do() -> None:
    # The separation is lost after 8 s on the way straight ahead. A climb of 5 m/s, which takes 5 s,
    # has risen 27.5 m by then; one of 4 m/s downwards, which takes 4 s, has sunk 24 m.
    assert escapes(OWN, head_on(2_200.0, -120.0), AIRCRAFT)
    assert all(flight.climb > 0.0 for flight in escapes(OWN, head_on(2_200.0, -120.0), AIRCRAFT))
    assert all(flight.climb < 0.0 for flight in escapes(OWN, head_on(2_200.0, 120.0), AIRCRAFT))
    straight = escapes(OWN, head_on(2_200.0, -114.0), AIRCRAFT)
    assert any(flight.turn == 0.0 and flight.climb == 5.0 for flight in straight)
    assert not any(
        flight.turn == 0.0 and flight.speed == OWN.speed
        for flight in escapes(OWN, head_on(2_200.0, -111.0), AIRCRAFT)
    )


def test_the_search_in_space_takes_what_passes_above_and_knows_what_is_lost() -> None:
    assert any(flight.climb == 0.0 for flight in escapes(OWN, head_on(2_200.0, 141.0), AIRCRAFT))
    assert escapes(OWN, head_on(900.0, 141.0), AIRCRAFT)
    assert not escapes(OWN, head_on(900.0, 139.0), AIRCRAFT)
    assert not escapes(OWN, head_on(900.0, 141.0, climb=-20.0), AIRCRAFT)
    with pytest.raises(ValueError, match="no vertical limits"):
        escapes(OWN, head_on(900.0, 0.0), PAPER)


def test_a_crowd_is_at_random_levels_and_rates() -> None:
    asked = climbs.crowd(0, AIRCRAFT)
    levels = [one.altitude for one in asked.intruders if hasattr(one, "altitude")]
    assert len(levels) == 20
    assert len({level.value for level in levels}) == 20
    assert {level.reference for level in levels} == {OWN_ALTITUDE.reference}
    assert 0 < sum(level.vertical_speed == 0.0 for level in levels) < 20


def test_an_aircraft_that_states_no_climb_is_refused() -> None:
    with pytest.raises(ConfigError, match="--aircraft: paper states no climb_max_mps"):
        climbs.main(["--aircraft", "paper"])


@pytest.mark.slow
def test_tiny_samples_end_with_one_json_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(climbs, "LEVELS", 1)
    climbs.main(["--requests", "2", "--encounters", "40"])
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    for kind in ("both", "horizontal"):
        figures = found["latency"][kind]
        made = sum(figures[f"by_{source}"] for source in ("policy", "fallback", "vertical"))
        assert made == round(2 * figures["safe"])
        assert figures["exact"]["requests"] == figures["with_errors"]["requests"] == 1
        assert 0.0 < figures["cpu_median_ms"] <= figures["cpu_max_ms"]
    assert found["deadline"]["solved"] <= found["deadline"]["requests"] == 2
    close = found["unresolvable"]["close"]
    compared = close["same_level"]["compared"] + close["other_levels"]["compared"]
    assert compared + close["begin_without_both"] == 2 * close["proven_unresolvable_in_the_plane"]
    assert close["climbs_needed"]["compared"] == close["climbs_needed"]["searched"]
