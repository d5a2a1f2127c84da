"""Sentences of a FLARM, built by the rules of its data port (FTD-012)."""

import math
from typing import Any

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from hypothesis import given
from hypothesis import strategies as st

from envs.formats.local_frame import displacement
from ros_bridge.core.feeds.flarm import Flarm
from ros_bridge.core.feeds.traffic import LATEST, Traffic
from ros_bridge.core.fields import SECOND, FieldError, identifier
from ros_bridge.core.reports import FASTEST, USUAL, Report

HOME = 47.0 + 7.5 / 60.0, 8.0 + 12.25 / 60.0
KNOT = 1852.0 / 3600.0


def sentence(body: str) -> str:
    """Return a sentence with its checksum."""
    total = 0
    for character in body.encode():
        total ^= character
    return f"${body}*{total:02X}\r"


def rmc(clock: str = "120000.00", status: str = "A") -> str:
    return sentence(f"GPRMC,{clock},{status},4707.500,N,00812.250,E,80.0,270.0,290926,,,A")


def gga(height: float = 1200.0, quality: int = 1) -> str:
    return sentence(f"GPGGA,120000.00,4707.500,N,00812.250,E,{quality},08,1.0,{height},M,47.0,M,,")


def pflaa(*more: object, **fields: Any) -> str:
    """Return PFLAA; ``more`` are the fields of newer versions."""
    values = {
        "alarm": 0,
        "north": -1234,
        "east": 1234,
        "vertical": 220,
        "kind": 2,
        "id": "DD8F12",
        "track": 180,
        "turn": "",
        "speed": 30,
        "climb": -1.4,
        "type": 1,
    } | fields
    return sentence("PFLAA," + ",".join(map(str, (*values.values(), *more))))


def read(
    *arrivals: tuple[float, str], own: str = "", traffic: Traffic | None = None
) -> tuple[list[Any], Traffic]:
    """Return what is made of sentences and their arrivals, s."""
    traffic = traffic or Traffic(own)
    reader = Flarm(traffic)
    reports = [
        reported
        for second, text in arrivals
        for reported in reader.reports_of(text, round((1_000 + second) * SECOND))
    ]
    return reports, traffic


def report(*more: object, **fields: Any) -> Any:
    (reported,), _ = read((0.0, rmc()), (0.0, gga()), (0.1, pflaa(*more, **fields)))
    return reported


def test_a_checksum_is_that_of_the_data_port() -> None:
    assert sentence("PFLAA,0,-1388,-330,465,2,DD8E8B,78,,44,2.8,2") == (
        "$PFLAA,0,-1388,-330,465,2,DD8E8B,78,,44,2.8,2*6F\r"
    )


def test_the_example_of_the_data_port_becomes_a_report_of_the_second_of_the_fix() -> None:
    reported = report()
    assert isinstance(reported, Report)
    assert reported.identifier == "flarm:dd8f12" == identifier("", reported.identifier)
    assert displacement(*HOME, *reported.place) == pytest.approx((1234.0, -1234.0), abs=1e-3)
    assert (reported.east, reported.north) == pytest.approx((0.0, -30.0), abs=1e-9)
    assert (reported.altitude.value, reported.altitude.reference) == (1420.0, "msl")
    assert reported.altitude.vertical_speed == -1.4
    assert reported.altitude.error == pytest.approx(22.0)
    assert (reported.position_std, reported.velocity_std, reported.category) == (None, None, 9)
    assert reported.time == 1_000 * SECOND and reported.time_std > 0.5


@given(
    st.integers(-30_000, 30_000),
    st.integers(-30_000, 30_000),
    st.integers(-900, 3_000),
    st.integers(0, 359),
    st.integers(1, 300),
    st.integers(-300, 300),
)
def test_what_is_encoded_is_read(
    north: int, east: int, above: int, track: int, speed: int, climb: int
) -> None:
    reported = report(
        north=north, east=east, vertical=above, track=track, speed=speed, climb=climb / 10
    )
    assert displacement(*HOME, *reported.place) == pytest.approx((east, north), abs=1e-3)
    assert reported.altitude.value == pytest.approx(1200.0 + above)
    assert reported.altitude.vertical_speed == pytest.approx(climb / 10)
    angle = math.radians(track)
    velocity = speed * math.sin(angle), speed * math.cos(angle)
    assert (reported.east, reported.north) == pytest.approx(velocity, abs=1e-9)
    assert reported.velocity_std is None or reported.velocity_std > USUAL.velocity_std


@pytest.mark.parametrize(
    ("kind", "identity", "name", "callsign"),
    [
        (1, "4B1234", "4b1234", ""),
        (1, "4B1234!HBABC", "4b1234", "HBABC"),
        (2, "DD1234", "flarm:dd1234", ""),
        (0, "DD1234", "flarm-random:dd1234", ""),
        (3, "DD1234", "flarm-random:dd1234", ""),
    ],
)
def test_a_name_says_whose_identification_it_is(
    kind: int, identity: str, name: str, callsign: str
) -> None:
    reported = report(kind=kind, id=identity)
    assert (reported.identifier, reported.callsign) == (name, callsign)


def test_nobody_is_placed_by_an_own_fix_that_is_unknown_old_or_lost() -> None:
    for before in (
        [],
        [(-2.5, rmc())],
        [(0.0, rmc()), (0.1, rmc(status="V"))],
        [(0.0, rmc()), (0.1, sentence("PFLAU,1,1,0,1,0,,0,,,"))],
    ):
        (reported,), _ = read(*before, (0.2, pflaa()))
        assert isinstance(reported, FieldError) and "own place is unknown" in str(reported)
        assert reported.sighting is not None and reported.sighting.identifier == "flarm:dd8f12"
        assert reported.sighting.place is None
    (reported,), _ = read((0.0, rmc()), (0.1, pflaa()))
    assert reported.altitude is None
    (reported,), _ = read((0.0, rmc()), (0.0, gga(quality=0)), (0.1, pflaa()))
    assert reported.altitude is None


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"track": ""}, "track"),
        ({"speed": ""}, "speed"),
        ({"speed": 500}, "speed"),
        ({"track": 700}, "track"),
        ({"climb": "x"}, "climb"),
        ({"vertical": -10_283}, "altitude"),
        ({"north": "x"}, "relative_north"),
    ],
)
def test_what_cannot_be_planned_with_is_sighted(changes: dict[str, Any], field: str) -> None:
    reported = report(**changes)
    assert isinstance(reported, FieldError) and reported.field == f"flarm:dd8f12.{field}"
    assert reported.sighting is not None and reported.sighting.identifier == "flarm:dd8f12"
    assert (reported.sighting.place is None) == (field == "relative_north")


def test_what_is_no_traffic_is_left_out_and_counted() -> None:
    reports, traffic = read(
        (0.0, rmc()),
        (0.0, gga()),
        (0.0, sentence("PFLAU,3,1,2,1,2,-30,2,-32,755,5A77B1")),
        (0.1, pflaa(east="", kind="", id="", track="", speed="", climb="")),
        (0.1, pflaa(kind=1, id="4B0001")),
        (0.1, pflaa(speed=0, climb=0.0, vertical=-300)),
        (0.1, sentence("PGRMZ,3937,F,2")),
        (0.1, sentence("PFLAE,A,0,0")),
        (0.1, ""),
        own="4B0001",
    )
    assert reports == []
    assert +traffic.counts == {
        "FLARM's own alarm, which decides nothing": 1,
        "without a position": 1,
        "own echo": 1,
        "on the ground": 1,
    }


@pytest.mark.parametrize("kind", ["3", "7", "B", "D", "F"])
def test_what_stands_still_may_fly(kind: str) -> None:
    reported = report(speed=0, track="", climb=0.0, type=kind)
    assert (reported.east, reported.north) == (0.0, 0.0)


def test_a_position_without_an_identification_is_told() -> None:
    reported = report(id="")
    assert isinstance(reported, FieldError) and reported.sighting is not None
    assert reported.sighting.place is not None


def test_newer_versions_tell_the_source() -> None:
    traffic = Traffic("")
    traffic.own = report(kind=1, id="4B0001")
    shadow = pflaa(0, 4, "", kind=1, id="ABCDEF")
    reports, _ = read((0.0, rmc()), (0.0, gga()), (0.1, shadow), traffic=traffic)
    assert reports == [] and traffic.counts["copy of the ownship"] == 1
    assert isinstance(report(1, 0, -71.5), Report)  # the no-track flag forbids to publish it
    assert isinstance(report(0, 1, ""), Report)


def test_a_display_gets_the_ownship_too() -> None:
    traffic = Traffic("", shows_own=True)
    reports, _ = read((0.0, gga()), (0.0, rmc()), (0.1, pflaa()), traffic=traffic)
    assert [traffic.is_own(reported.identifier) for reported in reports] == [True, False]
    own = reports[0]
    assert own.place == pytest.approx(HOME)
    assert (own.east, own.north) == pytest.approx((-80 * KNOT, 0.0), abs=1e-9)
    assert own.altitude.value == 1200.0


def test_what_was_queued_is_late_by_as_much() -> None:
    (reported,), _ = read((0.0, rmc("235959.00")), (4.0, rmc("000001.00")), (4.1, pflaa()))
    assert reported.time == 1_002 * SECOND
    with pytest.raises(TimeoutError, match="late"):
        read((0.0, rmc("120000.00")), (LATEST + 2.0, rmc("120001.00")))


@pytest.mark.parametrize(
    "garbage",
    [
        "hello",
        "$PFLAA,0*00",
        "$PFLAA,0,1,2,3",
        pflaa().replace("DD8F12", "DD8F13"),
        "\x1a2\x00",
        "$*00 ",
        "PASS?",
    ],
)
def test_garbage_is_one_error(garbage: str) -> None:
    reports, _ = read((0.0, garbage))
    assert [reported.field for reported in reports] == ([] if garbage == "$*00 " else ["sentence"])


def is_possible(reported: Any) -> bool:
    if isinstance(reported, FieldError):
        sighting = reported.sighting
        return sighting is None or sighting.place is None or abs(sighting.place[0]) <= 90.0
    level = reported.altitude
    return (
        abs(reported.latitude) <= 90.0
        and abs(reported.longitude) <= 180.0
        and reported.speed <= FASTEST + 1e-6
        and (level is None or -1_000.0 <= level.value <= 30_000.0)
        and reported.identifier == identifier("", reported.identifier)
    )


_VALUE = st.one_of(st.just(""), st.integers(-40_000, 40_000).map(str), st.text(max_size=6))


@given(st.lists(st.text(max_size=40)), st.sampled_from(["", "$PFLAA,", "$GPRMC,", "$GPGGA,"]))
def test_no_text_raises(texts: list[str], begins: str) -> None:
    timed_texts = ((float(n), begins + text) for n, text in enumerate(texts))
    reports, _ = read((0.0, rmc()), (0.0, gga()), *timed_texts)
    assert all(map(is_possible, reports))


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["PFLAA", "PFLAU", "GPRMC", "GNGGA"]), st.lists(_VALUE, max_size=16)
        )
    )
)
def test_no_fields_raise_or_leave_the_range(sentences: list[tuple[str, list[str]]]) -> None:
    timed_texts = [
        (0.01 * n, sentence(",".join((kind, *more)))) for n, (kind, more) in enumerate(sentences)
    ]
    reports, _ = read((0.0, rmc()), (0.0, gga()), *timed_texts)
    assert all(map(is_possible, reports))
