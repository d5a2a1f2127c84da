"""GDL 90: the worked examples of its specification (Garmin AT 560-1058-00, revision A), and an
encoder written from that alone.
"""

import math
from typing import Any

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from hypothesis import given
from hypothesis import strategies as st

from agents.planner.request.request import Altitude
from ros_bridge.core.feeds.gdl90 import Datagram, Gdl90, checksum
from ros_bridge.core.feeds.traffic import LATEST, Traffic
from ros_bridge.core.fields import SECOND, FieldError, identifier
from ros_bridge.core.reports import FASTEST, USUAL, Report

KNOT, FOOT = 1852.0 / 3600.0, 0.3048
SALEM = bytes.fromhex(
    "14 00 AB4549 1FEF15 A88978 0F09 A9 07B001 20 01 4E38323556202020 00"
)  # section 3.5.2
HEARTBEAT = bytes.fromhex("00 81 41 DBD0 0802")  # section 2.2.4


# The encoder.


def crc(message: bytes) -> int:
    """Return the checksum bit by bit: the remainder of the message by x^16 + x^12 + x^5 + 1."""
    register = 0
    for byte in message:
        for bit in range(7, -1, -1):
            top_bit, register = register >> 15, (register << 1 | byte >> bit & 1) & 0xFFFF
            register ^= 0x1021 * top_bit
    return register


def framed(*messages: bytes) -> bytes:
    frames = b""
    for message in messages:
        body = message + crc(message).to_bytes(2, "little")
        stuffed = b"".join(
            bytes([0x7D, byte ^ 0x20]) if byte in (0x7D, 0x7E) else bytes([byte]) for byte in body
        )
        frames += b"\x7e" + stuffed + b"\x7e"
    return frames


def heartbeat(second: int, *, utc: bool = True) -> bytes:
    bits = (second >> 16 & 1) << 7 | utc
    return bytes([0, 0x81, bits]) + (second & 0xFFFF).to_bytes(2, "little") + b"\0\0"


def aircraft(kind: int = 20, **fields: Any) -> bytes:
    """Return a message 10 or 20; fields that are not given are those of a light aircraft."""
    values = {
        "type": 0,
        "address": 0x4B1234,
        "latitude": 47.1,
        "longitude": 8.2,
        "feet": 5000,
        "airborne": 1,
        "extrapolated": 0,
        "direction": 1,
        "nic": 8,
        "nac": 9,
        "knots": 120,
        "fpm": 0,
        "track": 90.0,
        "category": 1,
        "callsign": "HBABC",
        "emergency": 0,
    } | fields
    turn = round(values["track"] * 256 / 360) % 256
    feet, knots, fpm = values["feet"], values["knots"], values["fpm"]
    level = 0xFFF if feet is None else (feet + 1000) // 25
    speed = 0xFFF if knots is None else min(knots, 0xFFE)
    rate = 0x800 if fpm is None else round(fpm / 64) & 0xFFF
    misc = values["airborne"] << 3 | values["extrapolated"] << 2 | values["direction"]
    bits = [(kind, 8), (0, 4), (values["type"], 4), (values["address"], 24)]
    angles = values["latitude"], values["longitude"]
    bits += [(round(angle * 2**23 / 180) & 0xFFFFFF, 24) for angle in angles]
    bits += [
        (level, 12),
        (misc, 4),
        (values["nic"], 4),
        (values["nac"], 4),
        (speed, 12),
        (rate, 12),
    ]
    bits += [(turn, 8), (values["category"], 8)]
    number = 0
    for value, width in bits:
        number = number << width | value
    return number.to_bytes(19, "big") + values["callsign"].ljust(8).encode() + bytes(1)


def read(
    *arrivals: tuple[float, bytes], own: str = "", traffic: Traffic | None = None
) -> tuple[list[Any], Traffic]:
    """Return what is made of datagrams and their arrivals, s."""
    traffic = traffic or Traffic(own)
    reader = Gdl90(traffic)
    reports = [
        reported
        for second, content in arrivals
        for reported in reader.reports_of(
            Datagram("10.0.0.1:4000", content), round(second * SECOND)
        )
    ]
    return reports, traffic


def report(**fields: Any) -> Any:
    (reported,), _ = read((100.0, framed(heartbeat(7), aircraft(**fields))))
    return reported


# The specification's examples.


def test_the_checksum_is_that_of_the_specification() -> None:
    assert checksum(HEARTBEAT) == crc(HEARTBEAT) == 0x8BB3
    assert framed(HEARTBEAT) == bytes.fromhex("7E 00 81 41 DB D0 08 02 B3 8B 7E")
    assert checksum(SALEM) == crc(SALEM)


def test_bytes_are_stuffed_as_in_the_specification() -> None:
    for escaped, plain in ((b"\x02\x7d\x5e", b"\x02\x7e"), (b"\x03\x7d\x5d", b"\x03\x7d")):
        assert escaped in framed(plain)


def test_the_worked_example_of_a_traffic_report() -> None:
    (reported,), _ = read((100.0, framed(HEARTBEAT, SALEM)))
    assert isinstance(reported, Report)
    assert reported.identifier == f"{0o52642511:06x}" == "ab4549"
    assert reported.place == pytest.approx((44.90708, -122.99488), abs=180 / 2**23)
    assert reported.altitude == Altitude(5000 * FOOT, "pressure", pytest.approx(64 * FOOT / 60))
    assert reported.speed == pytest.approx(123 * KNOT)
    assert math.degrees(math.atan2(reported.east, reported.north)) == pytest.approx(45.0)
    assert reported.position_std == pytest.approx(30.0 / 2.448)  # HFOM below 30 m
    assert (reported.category, reported.callsign, reported.time) == (1, "N825V", 100 * SECOND)


@pytest.mark.parametrize(
    ("angle", "code"),
    [(0.0, "000000"), (45.0, "200000"), (-45.0, "e00000"), (90.0, "400000"), (-180.0, "800000")],
)
def test_angles_are_those_of_the_specification(angle: float, code: str) -> None:
    message = aircraft(latitude=10.0, longitude=angle)
    assert message[8:11].hex() == code
    assert report(latitude=10.0, longitude=angle).longitude == angle


@pytest.mark.parametrize(
    ("feet", "code"), [(-1000, 0x000), (0, 0x028), (1000, 0x050), (None, 0xFFF)]
)
def test_altitudes_are_those_of_the_specification(feet: int | None, code: int) -> None:
    assert aircraft(feet=feet)[11] << 4 | aircraft(feet=feet)[12] >> 4 == code
    altitude = report(feet=feet).altitude
    assert altitude is None if feet is None else altitude.value == pytest.approx(feet * FOOT)


@pytest.mark.parametrize(("fpm", "code"), [(64, 1), (-64, 0xFFF), (None, 0x800)])
def test_vertical_speeds_are_those_of_the_specification(fpm: int | None, code: int) -> None:
    message = aircraft(fpm=fpm)
    assert (message[15] & 0xF) << 8 | message[16] == code
    climb = report(fpm=fpm).altitude.vertical_speed
    assert climb is None if fpm is None else climb == pytest.approx(fpm * FOOT / 60)


# What becomes of it.


@given(
    st.integers(1, 2**24 - 1),
    st.floats(-89.0, 89.0),
    st.floats(-179.9, 179.9),
    st.integers(-40, 3_000),
    st.integers(0, 700),
    st.integers(-200, 200),
    st.integers(0, 255),
)
def test_what_is_encoded_is_read(
    address: int,
    latitude: float,
    longitude: float,
    level: int,
    knots: int,
    rate: int,
    turn: int,
) -> None:
    reported = report(
        address=address,
        latitude=latitude,
        longitude=longitude,
        feet=25 * level,
        knots=knots,
        fpm=64 * rate,
        track=turn * 360 / 256,
    )
    assert reported.identifier == f"{address:06x}"
    assert reported.place == pytest.approx((latitude, longitude), abs=1.1e-5)
    assert reported.altitude.value == pytest.approx(25 * level * FOOT)
    track = math.radians(turn * 360 / 256)
    velocity = knots * KNOT * math.sin(track), knots * KNOT * math.cos(track)
    assert (reported.east, reported.north) == pytest.approx(velocity, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "name"),
    [(0, "4b1234"), (1, "~4b1234"), (2, "4b1234"), (3, "~4b1234"), (4, "gdl90-4:4b1234"),
     (9, "gdl90-9:4b1234")],
)  # fmt: skip
def test_a_name_says_whose_address_it_is(kind: int, name: str) -> None:
    reported = report(type=kind)
    assert reported.identifier == name == identifier("", name)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"direction": 0}, "track"),
        ({"direction": 2}, "track is a magnetic heading"),
        ({"direction": 3}, "track is a true heading"),
        ({"knots": None}, "speed"),
        ({"knots": 4094}, "speed"),
        ({"fpm": 32_640}, "vertical_speed"),
        ({"latitude": 91.0}, "latitude"),
        ({"extrapolated": 1}, "position is extrapolated"),
    ],
)
def test_what_cannot_be_planned_with_is_sighted(changes: dict[str, Any], field: str) -> None:
    reported = report(**changes)
    assert isinstance(reported, FieldError)
    assert str(reported).startswith(f"gdl90 4b1234.{field}")
    assert reported.sighting is not None and reported.sighting.identifier == "4b1234"
    assert (reported.sighting.place is None) == (field == "latitude")


def test_what_stands_still_needs_no_track() -> None:
    reported = report(direction=0, knots=0)
    assert (reported.east, reported.north) == (0.0, 0.0)


def test_an_unknown_accuracy_stays_unknown() -> None:
    reported = report(nac=0)
    assert reported.position_std is None and reported.velocity_std is None
    assert report(nac=13).position_std is None
    assert report(nac=5).position_std == pytest.approx(926 / 2.448)
    assert reported.time_std > 1.0


def test_a_coarse_track_counts_where_it_is_more_than_what_is_unknown() -> None:
    reported = report(knots=450)
    assert reported.velocity_std > USUAL.velocity_std
    assert reported.velocity_std > 450 * KNOT * math.radians(360 / 256) / math.sqrt(3.0)


def test_what_is_no_traffic_is_left_out_and_counted() -> None:
    messages = [
        aircraft(airborne=0, knots=10, feet=1400),
        aircraft(category=18, knots=10, feet=1400),
        aircraft(type=4, knots=10, feet=1400),
        aircraft(type=5),
        aircraft(latitude=0.0, longitude=0.0, nic=0),
        bytes([30]) + bytes(21),
        bytes([101, 0]) + bytes(37),  # ForeFlight's identification
        bytes([101, 1]) + bytes(10),  # and its attitude
        bytes([11]) + bytes(4),
        bytes([7]) + bytes(435),
        b"SX" + bytes(27),  # Stratux's own
    ]
    reports, traffic = read((100.0, framed(*messages)))
    assert reports == []
    assert +traffic.counts == {
        "on the ground": 3,
        "ground station": 1,
        "without a position": 1,
        "report of UAT as received (GDL 90 message 30 or 31)": 1,
    }


@pytest.mark.parametrize("changes", [{"knots": 110}, {"fpm": -640}, {"category": 19, "knots": 0}])
def test_a_flag_of_the_ground_that_others_contradict_removes_no_aircraft(
    changes: dict[str, Any],
) -> None:
    assert isinstance(report(**{"airborne": 0, "knots": 20, **changes}), Report)


def test_the_ownship_is_no_traffic_whoever_says_which_it_is() -> None:
    own = aircraft(10, address=0x4B0001)
    echo = aircraft(address=0x4B0001, latitude=47.1005)
    reports, traffic = read((100.0, framed(heartbeat(7), own, echo, aircraft())))
    assert [reported.identifier for reported in reports] == ["4b1234"]
    assert traffic.counts == {"own echo": 1}
    reports, traffic = read((100.0, framed(heartbeat(7), echo)), own="4B0001")
    assert reports == [] and traffic.counts == {"own echo": 1}


def test_another_aircraft_of_the_address_that_a_device_has_counts() -> None:
    """As where it was set up in another aircraft, which flies."""
    own = aircraft(10, address=0x4B0001)
    second_aircraft = aircraft(address=0x4B0001, latitude=47.2)
    reports, traffic = read((100.0, framed(heartbeat(7), own, second_aircraft)))
    assert [reported.identifier for reported in reports] == ["4b0001"]
    assert traffic.doubted == {"of the ownship's address, but elsewhere": 1}
    nowhere = aircraft(10, address=0x4B0001, latitude=0.0, longitude=0.0, nic=0)
    assert read((100.0, framed(heartbeat(7), nowhere, second_aircraft)))[0] == []


def test_a_display_gets_the_ownship_too() -> None:
    traffic = Traffic("", shows_own=True)
    own = aircraft(10, address=0x4B0001)
    reports, _ = read((100.0, framed(heartbeat(7), own, aircraft())), traffic=traffic)
    assert [traffic.is_own(reported.identifier) for reported in reports] == [True, False]


@pytest.mark.parametrize(("kind", "copied"), [(0, False), (2, True), (3, True)])
def test_a_track_of_radar_at_the_ownship_is_its_copy(kind: int, copied: bool) -> None:
    traffic = Traffic("4b0001")
    altitude = Altitude(5000 * FOOT, "pressure")
    traffic.own = Report("4b0001", 100 * SECOND, 47.1, 8.2, 120 * KNOT, 0.0, altitude)
    shadow = framed(heartbeat(7), aircraft(type=kind, address=0xABCDEF))
    reports, _ = read((100.0, shadow), traffic=traffic)
    assert (reports == []) == copied == bool(traffic.counts["copy of the ownship"])


def test_what_is_extrapolated_is_left_to_the_tracker() -> None:
    """Only of an aircraft that nothing else was heard of a place is told."""
    reports, traffic = read(
        (100.0, framed(heartbeat(7), aircraft())),
        (101.0, framed(heartbeat(8), aircraft(extrapolated=1))),
        (102.0, framed(heartbeat(9), aircraft(extrapolated=1, address=0x4B9999))),
    )
    assert [type(reported) for reported in reports] == [Report, FieldError]
    assert reports[1].sighting.identifier == "4b9999"
    assert traffic.counts == {"position that the receiver has extrapolated": 1}


def test_reports_hold_when_their_second_began() -> None:
    reports, _ = read(
        (100.0, framed(heartbeat(7))),
        (100.4, framed(aircraft())),
        (103.9, framed(heartbeat(8), aircraft())),  # queued for 2.9 s
        (107.0, framed(aircraft())),  # without a heartbeat
    )
    assert [reported.time / SECOND for reported in reports] == pytest.approx([100.0, 101.0, 107.0])


def test_midnight_is_no_jump_and_a_jump_is_found() -> None:
    reports, _ = read(
        (100.0, framed(heartbeat(86_399), aircraft())),
        (101.0, framed(heartbeat(0), aircraft())),
    )
    assert [reported.time / SECOND for reported in reports] == [100.0, 101.0]
    with pytest.raises(TimeoutError, match="late"):
        read((100.0, framed(heartbeat(50))), (100.0 + LATEST + 2.0, framed(heartbeat(51))))
    reports, _ = read(
        (100.0, framed(heartbeat(50, utc=False), aircraft())),
        (101.0, framed(heartbeat(5, utc=False), aircraft())),
    )
    assert [reported.time / SECOND for reported in reports] == [100.0, 101.0]


def test_a_position_without_an_address_is_told() -> None:
    reported = report(address=0)
    assert isinstance(reported, FieldError) and reported.sighting is not None
    assert reported.sighting.place == pytest.approx((47.1, 8.2), abs=1e-4)


@pytest.mark.parametrize(
    ("garbage", "field"),
    [
        (b"", "datagram"),
        (b"$PFLAA,0*00\r\n", "datagram"),
        (b"\x7e\x00\x7e", "message"),
        (b"\x7e" + HEARTBEAT + b"\0\0\x7e", "message"),
        (framed(SALEM)[:-5], "message"),
        (framed(SALEM[:-1]), "message 20"),
        (framed(HEARTBEAT + b"\0"), "message 0"),
        (b"\x7e\x7d\x7e", "message"),
    ],
)
def test_garbage_is_one_error(garbage: bytes, field: str) -> None:
    reports, _ = read((0.0, garbage))
    assert [reported.field for reported in reports] == [field]
    assert reports[0].sighting is None


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


@given(
    st.lists(st.one_of(st.binary(max_size=80), st.binary(max_size=40).map(lambda b: b"\x7e" + b)))
)
def test_no_bytes_raise(contents: list[bytes]) -> None:
    reports, _ = read(*((float(n), content) for n, content in enumerate(contents)))
    assert all(map(is_possible, reports))


@given(st.lists(st.tuples(st.sampled_from((10, 20)), st.binary(min_size=27, max_size=27))))
def test_no_message_raises_or_leaves_the_range(messages: list[tuple[int, bytes]]) -> None:
    framed_messages = [framed(bytes([kind]) + body) for kind, body in messages]
    reports, _ = read(*((float(n), content) for n, content in enumerate(framed_messages)))
    assert all(map(is_possible, reports))


@given(st.binary(max_size=60))
def test_the_checksum_is_the_one_of_bits(message: bytes) -> None:
    assert len(message) < 2 or checksum(message) == crc(message)


def test_of_many_senders_the_latest_stay() -> None:
    traffic = Traffic("")
    reader = Gdl90(traffic)
    for number in range(1_000):
        list(reader.reports_of(Datagram(f"10.0.0.{number}:1", framed(heartbeat(7))), number))
    assert len(reader._senders) == 8
