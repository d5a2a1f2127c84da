"""An aircraft is made of possible numbers, and says which is not."""

import math

import pytest

from envs.aircraft import PAPER, AircraftError, Vertical, new_aircraft

CLIMBS = Vertical(2.5, 3.0, 0.5, 137.2)
NAMES = ("climb_max", "descent_max", "vertical_acceleration", "vertical_separation")


def test_an_aircraft_without_climbs_is_in_the_plane() -> None:
    assert new_aircraft(PAPER.limits, PAPER.separation).vertical is None
    aircraft = new_aircraft(PAPER.limits, PAPER.separation, vertical=CLIMBS)
    assert aircraft == new_aircraft(PAPER.limits, PAPER.separation)._replace(vertical=CLIMBS)


@pytest.mark.parametrize("value", [0.0, -2.0, math.nan, math.inf])
@pytest.mark.parametrize("number", range(4))
def test_impossible_climbs_are_refused_by_name(number: int, value: float) -> None:
    climbs = CLIMBS._replace(**{Vertical._fields[number]: value})
    with pytest.raises(AircraftError, match=rf"^{NAMES[number]} is {value:g}; expected .* to "):
        new_aircraft(PAPER.limits, PAPER.separation, vertical=climbs)
