"""What is no certificate, or contradicts itself, is refused by a sentence that names it."""

import math
from typing import Any

import pytest

from agents.check.reading import read
from agents.check.refusal import RefusedError
from tests.agents.check.certificates import area, box, climbing, edited, intruder, straight

HEIGHTS = [0.0, 0.0, 700.0, 0.0, 0.0, 600.0]
FULL = straight(
    request={"policy": "0a" * 32, "time_ns": -1, "latitude": -90.0, "longitude": 360},
    intruders=[intruder(9e3, 9e3)],
    excluded=[HEIGHTS],
    apart=[[0, 1.0, 2.0, *HEIGHTS]],
    areas=[
        area(circle=[1.0, 2.0, 3.0], valid=[None, 1], heights=[1.0, 2.0]),
        area(rings=[box(0.0, 0.0, 1.0, 1.0)], keep="in"),
    ],
    levels=[-10.0, -1.0, 10.0, 1.0],
)
TEXT, ROWS = "other fields", "are not rows of"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("format",), "another", "it is not a RLCAS"),
        (("more",), 1, "it is not a RLCAS"),
        (("own",), [0.0, 0.0, 0.0], ROWS),
        (("own",), [0.0, 0.0, 0.0, 80.0, 0.0], ROWS),
        (("own", 0), 1e8, ROWS),
        (("own", 0), -1e8, ROWS),
        (("own", 0), math.nan, ROWS),
        (("own", 0), math.inf, ROWS),
        (("own", 0), True, ROWS),
        (("own", 0), "1", ROWS),
        (("own",), "four", ROWS),
        (("waypoints",), {}, ROWS),
        (("limits",), {}, TEXT),
        (("requirement",), None, TEXT),
        (("request",), {}, TEXT),
        (("apart", 0, 0), 1, "of no intruder"),
        (("apart", 0, 0), -1, "of no intruder"),
        (("apart", 0, 0), 0.5, "of no intruder"),
        *((("parts",), parts, "no power of 2") for parts in (0, -2, 3, 2048, 1.0, True, None)),
        (("waypoints",), [], "as many controls as waypoints"),
        (("controls",), [[0.0] * 20], "as many controls as waypoints"),
        (("requirement", "separation"), -1.0, "a size is negative"),
        (("requirement", "margin"), -1.0, "a size is negative"),
        (("requirement", "sigmas"), -1.0, "a size is negative"),
        (("bounds", 0), -1.0, "a size is negative"),
        (("wind", "std"), -1.0, "a size is negative"),
        *((("intruders", 0, n), -1.0, "a size is negative") for n in (3, 6, 7, 8)),
        (("intruders", 0, 9), 0.0, "a separation is not positive"),
        (("intruders", 0, 9), -1.0, "a separation is not positive"),
        (("requirement", "separation"), 0.0, "a separation is not positive"),
        (("excluded", 0, 5), -1.0, "a vertical separation is negative"),
        (("apart", 0, 8), -1.0, "a vertical separation is negative"),
        (("limits", "speed_min"), 101.0, "speed_min is above"),
        (("levels", 0), 11.0, "a low level above"),
        (("levels", 1), 2.0, "a low level above"),
        (("apart", 0, 2), 0.5, "ends before it begins"),
        (("areas", 0, "valid"), [1.0, 1.0], r"areas\[0\].valid ends before"),
        (("areas", 0, "heights"), [2.0, 1.0], r"areas\[0\].heights ends before"),
        (("areas", 0, "valid"), [1.0], "no pair"),
        (("areas", 0, "valid"), [1.0, 2.0, 3.0], "no pair"),
        (("areas", 0, "valid"), [None, "2"], ROWS),
        (("areas", 0, "heights"), [0.0, "2"], ROWS),
        (("areas", 0, "keep"), "up", "neither out nor in"),
        (("areas", 0, "clearance"), -1.0, "negative clearance"),
        (("areas", 0, "circle", 2), 0.0, "no radius"),
        (("areas", 0, "circle"), [1.0, 2.0], ROWS),
        (("areas", 0, "circle"), [], "no rings of 3 points"),
        (("areas", 0, "rings"), [box(0.0, 0.0, 1.0, 1.0)], "both a circle and a polygon"),
        (("areas", 1, "rings", 0), [[0.0, 0.0], [1.0, 1.0]], "no rings of 3 points"),
        (("areas", 1, "rings"), [], "no rings of 3 points"),
        (("areas", 1), {}, TEXT),
        (("areas",), {}, "no list"),
        (("request", "latitude"), None, "half of an origin"),
        (("request", "longitude"), None, "half of an origin"),
        (("request", "latitude"), 90.5, "no angle to 90"),
        (("request", "longitude"), -360.5, "no angle to 360"),
        (("request", "longitude"), True, "no angle to 360"),
        (("request", "time_ns"), 1 << 63, "64 bits"),
        (("request", "time_ns"), 1.0, "64 bits"),
        (("request", "policy"), "", "no SHA-256"),
        (("request", "policy"), "0A" * 32, "no SHA-256"),
        (("request", "policy"), 5, "no SHA-256"),
    ],
)
def test_what_is_no_certificate_is_refused(path: tuple[Any, ...], value: Any, message: str) -> None:
    assert len(read(FULL).areas) == 2
    with pytest.raises(RefusedError, match=message):
        read(edited(FULL, path, value))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("own", 0), 99_999_999.0),
        (("parts",), 1),
        (("parts",), 1024),
        (("limits", "speed_min"), 100.0),
        (("levels",), None),
        (("levels",), [10.0, 1.0, 10.0, 1.0]),
        (("apart", 0, 2), 1.0),
        (("apart", 0, 0), 0.0),
        (("areas", 0, "valid"), [0.0, None]),
        (("excluded", 0, 5), 0.0),
        (("request", "policy"), None),
        (("request", "time_ns"), (1 << 63) - 1),
        (("bounds", 0), 0.0),
    ],
)
def test_numbers_at_the_ends_of_their_ranges_are_read(path: tuple[Any, ...], value: Any) -> None:
    read(edited(FULL, path, value))


CLIMBS = climbing(1_050.0, 1_000.0, profile={"climb": 1.0, "floor": 900.0, "ceiling": 1_200.0})


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("altitudes",), [1_050.0], "as many altitudes as there are waypoints"),
        (("altitudes",), [1_050.0, 1_000.0, 1_000.0], "as many altitudes as there are waypoints"),
        (("altitudes",), 1_050.0, "no list"),
        (("altitudes", 0), None, ROWS),
        (("altitudes", 0), 1e8, ROWS),
        (("climb",), None, ROWS),
        (("climb",), 1.000_001, "another climb at the request than levels"),
        *(((name,), 0.0, "not positive") for name in ("climb_max", "descent_max", "acceleration")),
        (("margin",), -1e-9, "not positive"),
        (("floor",), "900", ROWS),
        (("ceiling",), True, ROWS),
        (("ceiling",), 900.0, "floor is not below"),
        (("more",), 1.0, TEXT),
    ],
)
def test_a_profile_that_is_none_is_refused(path: tuple[Any, ...], value: Any, message: str) -> None:
    with pytest.raises(RefusedError, match=message):
        read(edited(CLIMBS, ("profile", *path), value))
    for name in CLIMBS["profile"]:
        less = {key: field for key, field in CLIMBS["profile"].items() if key != name}
        with pytest.raises(RefusedError, match=TEXT):
            read(CLIMBS | {"profile": less})


def test_a_profile_is_read() -> None:
    profile = read(CLIMBS).profile
    assert profile is not None and profile.altitudes == [1_050.0, 1_000.0]
    assert profile[1:] == (1.0, 6.0, 6.0, 1.0, 5.0, 900.0, 1_200.0)
    for name, value in (("floor", None), ("ceiling", None), ("margin", 0)):
        read(edited(CLIMBS, ("profile", name), value))
    # A climb known within an error is that of the profile in the middle.
    read(edited(CLIMBS, ("levels",), [990.0, 0.5, 1_010.0, 1.5]))
    for levels in (None, [990.0, 1.0, 1_010.0, 1.5]):
        with pytest.raises(RefusedError, match="another climb at the request than levels"):
            read(edited(CLIMBS, ("levels",), levels))


def test_a_plan_has_a_leg() -> None:
    with pytest.raises(RefusedError, match="one or more"):
        read(FULL | {"waypoints": [], "controls": []})


@pytest.mark.parametrize("field", sorted(FULL))
def test_no_field_may_be_missing(field: str) -> None:
    with pytest.raises(RefusedError):
        read({key: value for key, value in FULL.items() if key != field})
