"""Remote ID over MAVLink: real messages through pymavlink, and packs of the standard's encoding."""

import math
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="pymavlink is not installed; to have it: make venv")

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from ros_bridge.core.fields import SECOND, identifier
from ros_bridge.core.reports import FASTEST
from ros_bridge.mavlink import remote_id
from ros_bridge.mavlink.intake import Reading, Received, take
from ros_bridge.mavlink.link import TRAFFIC

READING = Reading({})
MAC = bytes.fromhex("aabbccddeeff")
SERIAL = b"1581F5FJD23A00B1"
NAME = "rid:1581f5fjd23a00b1"
BOOT = 100.0  # s on the autopilot's clock ...
UTC = 1_790_000_000  # ... at this time since 1970, s
PAST_HOUR = UTC % 3600

# Made by opendroneid-core-c (Open Drone ID Core C Library, Apache-2.0, commit beb5639c): the packs
# that its encodeMessagePack writes of the values beside them.
PACKS = (
    (
        "f219020212313538314635464a44323341303042310000000000000012222331fb0778161c4f80c6fa"
        "800ce50c34084a3339300500",
        {
            "status": 2,
            "direction": 21_500,
            "speed_horizontal": 1_225,
            "speed_vertical": -250,
            "latitude": 471_234_567,
            "longitude": -87_654_321,
            "altitude_barometric": 600.0,
            "altitude_geodetic": 650.5,
            "horizontal_accuracy": 10,
            "vertical_accuracy": 4,
            "barometer_accuracy": 3,
            "speed_accuracy": 3,
            "timestamp": 1234.5,
            "timestamp_accuracy": 5,
        },
    ),
    (
        "f219020212313538314635464a4432334130304231000000000000001210000000404e08ec20eb265a"
        "9808c00834086c0400000100",
        {
            "status": 1,
            "direction": 0,
            "speed_horizontal": 0,
            "speed_vertical": 0,
            "latitude": -335_000_000,
            "longitude": 1_512_500_000,
            "altitude_barometric": 100.0,
            "altitude_geodetic": 120.0,
            "horizontal_accuracy": 12,
            "vertical_accuracy": 6,
            "barometer_accuracy": 0,
            "speed_accuracy": 4,
            "timestamp": 0.0,
            "timestamp_accuracy": 1,
        },
    ),
    (
        "f219020212313538314635464a4432334130304231000000000000001223b5ff7e0000000000000000"
        "0000000034080000ffff0000",
        {
            "status": 2,
            "direction": 36_100,
            "speed_horizontal": 25_500,
            "speed_vertical": 6_300,
            "latitude": 0,
            "longitude": 0,
            "altitude_barometric": -1000.0,
            "altitude_geodetic": -1000.0,
            "horizontal_accuracy": 0,
            "vertical_accuracy": 0,
            "barometer_accuracy": 0,
            "speed_accuracy": 0,
            "timestamp": math.inf,
            "timestamp_accuracy": 0,
        },
    ),
    (
        "f219020212313538314635464a4432334130304231000000000000001233b3310c80520c3540790295"
        "401fa41f340815119f8c0f00",
        {
            "status": 3,
            "direction": 35_900,
            "speed_horizontal": 10_050,
            "speed_vertical": 600,
            "latitude": 890_000_000,
            "longitude": -1_795_000_000,
            "altitude_barometric": 3000.0,
            "altitude_geodetic": 3050.0,
            "horizontal_accuracy": 5,
            "vertical_accuracy": 1,
            "barometer_accuracy": 1,
            "speed_accuracy": 1,
            "timestamp": 3599.9,
            "timestamp_accuracy": 15,
        },
    ),
)


def wired(message: Any) -> Any:
    """Return a message as it arrives."""
    sender, receiver = dialect.MAVLink(None, 1, 1), dialect.MAVLink(None)
    (arrived,) = receiver.parse_buffer(message.pack(sender))
    return arrived


def padded(content: bytes) -> list[int]:
    return list(content.ljust(20, b"\0"))


def named(uas_id: bytes = SERIAL, mac: bytes = MAC, kind: int = 1, body: int = 2) -> Any:
    return wired(
        dialect.MAVLink_open_drone_id_basic_id_message(
            0, 0, padded(mac), kind, body, padded(uas_id)
        )
    )


def placed(mac: bytes = MAC, **fields: Any) -> Any:
    values = {
        "status": 2,
        "direction": 9_000,
        "speed_horizontal": 1_500,
        "speed_vertical": 100,
        "latitude": 471_000_000,
        "longitude": 82_000_000,
        "altitude_barometric": 500.0,
        "altitude_geodetic": 550.0,
        "height_reference": 0,
        "height": 50.0,
        "horizontal_accuracy": 10,
        "vertical_accuracy": 4,
        "barometer_accuracy": 3,
        "speed_accuracy": 3,
        "timestamp": float(PAST_HOUR),
        "timestamp_accuracy": 2,
    } | fields
    return wired(dialect.MAVLink_open_drone_id_location_message(0, 0, padded(mac), **values))


def packed(content: str) -> Any:
    pack = bytes.fromhex(content)
    messages = list(pack[3:].ljust(225, b"\0"))
    return wired(
        dialect.MAVLink_open_drone_id_message_pack_message(
            0, 0, padded(MAC), pack[1], pack[2], messages
        )
    )


def clock(unix: float = UTC) -> Any:
    return wired(dialect.MAVLink_system_time_message(round(unix * 1e6), round(BOOT * 1e3)))


def own_position(latitude: float = 47.1, longitude: float = 8.2) -> Any:
    return wired(
        dialect.MAVLink_global_position_int_message(
            round(BOOT * 1e3), round(latitude * 1e7), round(longitude * 1e7), 550_000, 50_000,
            0, 1_500, 0, 9_000,
        )
    )  # fmt: skip


def received(*messages: Any, reading: Reading = READING, since: Received | None = None) -> Received:
    """Return what is known after messages that arrive at :data:`BOOT`, or at a time of their own,
    s.
    """
    after = since or Received()
    for item in messages:
        message, second = item if isinstance(item, tuple) else (item, BOOT)
        after = take(after, message, round(second * SECOND), reading)
    return after


def report(**fields: Any) -> Any:
    track = received(clock(), named(), placed(**fields)).situation.traffic[NAME]
    return track.last if track.fault is None else track.fault


def test_a_drone_becomes_a_report_under_its_name() -> None:
    drone_report = report()
    assert drone_report.identifier == NAME == identifier("", NAME)
    assert drone_report.place == pytest.approx((47.1, 8.2))
    assert (drone_report.east, drone_report.north) == pytest.approx((15.0, 0.0), abs=1e-9)
    assert (drone_report.altitude.value, drone_report.altitude.reference) == (550.0, "wgs84")
    assert (drone_report.altitude.vertical_speed, drone_report.altitude.error) == (1.0, 10.0)
    assert drone_report.position_std == pytest.approx(10.0 / 2.448)
    assert drone_report.velocity_std == pytest.approx(1.0 / 2.448, rel=0.1)
    assert drone_report.velocity_std > 1.0 / 2.448
    assert drone_report.time == round(BOOT * SECOND)
    assert drone_report.time_std == pytest.approx(0.2 / math.sqrt(3.0))
    assert (drone_report.category, drone_report.callsign) == (14, SERIAL.decode())


@pytest.mark.parametrize(("content", "fields"), PACKS)
def test_a_pack_is_what_the_reference_encoder_made_of_the_values(
    content: str, fields: dict[str, Any]
) -> None:
    (first, basic_id), (second, where) = remote_id.unpack(packed(content))
    assert (first, second) == ("OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_LOCATION")
    identity = remote_id.basic_id(basic_id)
    assert identity is not None and identity.name == NAME
    assert {name: getattr(where, name) for name in fields} == fields
    assert remote_id.address_of(where) == MAC.hex()


def test_a_pack_is_taken_like_its_messages() -> None:
    after = received(clock(UTC - PAST_HOUR + 1_235.5), packed(PACKS[0][0]))
    (track,) = after.situation.traffic.values()
    assert track.last is not None and track.last.identifier == NAME
    assert track.last.time == round((BOOT - 1.0) * SECOND)
    on_ground = received(packed(PACKS[1][0]), packed(PACKS[2][0]))
    assert not on_ground.situation.traffic
    assert on_ground.left_out == {"on the ground": 1, "without a position": 1}
    for size, count in ((24, 2), (25, 0), (25, 10)):
        message = packed(PACKS[0][0])
        message.single_message_size, message.msg_pack_size = size, count
        assert received(message).left_out == {"without a name, unreadable": 1}


def test_the_time_is_that_of_the_hour_and_wraps_with_it() -> None:
    base = UTC - PAST_HOUR + 3600  # a full hour
    for past, stamp, age in ((2.0, 0.5, 1.5), (0.5, 3599.0, 1.5), (2.0, 2.4, 0.0), (0.0, 0.3, 0.0)):
        after = received(clock(base + past), named(), placed(timestamp=stamp))
        last = after.situation.traffic[NAME].last
        assert last is not None
        assert last.time / SECOND == pytest.approx(BOOT - age, abs=1e-5)
    track = received(clock(base + 60.0), named(), placed(timestamp=3599.0)).situation.traffic[NAME]
    assert track.fault is not None and "timestamp is 61.0 s old" in track.fault.message
    assert track.sightings[0].sighting.place is not None


def test_a_time_that_is_unknown_is_not_exact() -> None:
    worst = 1.5 / math.sqrt(3.0)
    for after in (
        received(named(), placed()),  # nobody knows UTC
        received(clock(0.0), named(), placed()),
        received(clock(), named(), placed(timestamp=65_535.0)),
        received(clock(), named(), placed(timestamp=math.nan)),
        received(clock(), named(), placed(timestamp_accuracy=0)),
    ):
        last = after.situation.traffic[NAME].last
        assert last is not None and last.time == round(BOOT * SECOND)
        assert last.time_std == pytest.approx(worst)


def test_unknown_accuracies_stay_unknown() -> None:
    drone_report = report(horizontal_accuracy=0, speed_accuracy=0, vertical_accuracy=0)
    assert (drone_report.position_std, drone_report.velocity_std) == (None, None)
    assert drone_report.altitude.error == 150.0
    assert report(horizontal_accuracy=15, speed_accuracy=9).position_std is None
    metres = (18_520, 7_408, 3_704, 1_852, 926, 555.6, 185.2, 92.6, 30, 10, 3, 1)
    for code, radius in enumerate(metres, 1):
        assert report(horizontal_accuracy=code).position_std == pytest.approx(radius / 2.448)


def test_the_altitude_is_by_pressure_where_no_other_is_known() -> None:
    altitude = report(altitude_geodetic=-1000.0).altitude
    assert (altitude.value, altitude.reference, altitude.error) == (500.0, "pressure", 25.0)
    assert report(altitude_geodetic=-1000.0, altitude_barometric=-1000.0).altitude is None
    assert report(speed_vertical=6_300).altitude.vertical_speed is None


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"direction": 36_100}, "direction is unknown"),
        ({"direction": 40_000}, "direction is 400"),
        ({"speed_horizontal": 25_500}, "speed is unknown"),
        ({"speed_horizontal": 25_425}, "speed is 254.25"),
        ({"status": 4}, "status says that the system fails"),
        ({"altitude_geodetic": math.inf}, "altitude is inf"),
        ({"latitude": 910_000_000}, "latitude is 91"),
    ],
)
def test_what_cannot_be_planned_with_is_a_fault_with_its_place(
    changes: dict[str, Any], problem: str
) -> None:
    track = received(clock(), named(), placed(**changes)).situation.traffic[NAME]
    assert track.fault is not None and f"remote id {NAME}.{problem}" in track.fault.message
    assert (track.sightings[0].sighting.place is None) == ("latitude" in changes)


def test_what_hovers_needs_no_direction_and_what_flies_is_not_on_the_ground() -> None:
    drone_report = report(speed_horizontal=0, direction=36_100)
    assert (drone_report.east, drone_report.north) == (0.0, 0.0)
    assert report(status=1, speed_horizontal=3_000).speed == pytest.approx(30.0)
    on_ground = received(clock(), named(), placed(status=1, speed_horizontal=0, speed_vertical=0))
    assert on_ground.left_out == {"on the ground": 1} and not on_ground.situation.traffic


@pytest.mark.parametrize(
    ("kind", "content", "name"),
    [
        (1, SERIAL, NAME),
        (2, b"CHE.HB-123", "rid-caa:che.hb-123"),
        (3, bytes(range(1, 17)), "rid-utm:" + bytes(range(1, 17)).hex()),
        (4, b"\x01abc", "rid-session:01616263"),
        (1, b"\xff\x01", "rid:ff01"),
    ],
)
def test_names_of_other_registers_do_not_collide(kind: int, content: bytes, name: str) -> None:
    after = received(named(content, kind=kind), placed())
    assert list(after.situation.traffic) == [name]
    assert identifier("", name) == name


def test_a_drone_that_does_not_say_its_name_goes_by_its_transmitter_after_a_while() -> None:
    after = received(placed(), (placed(), BOOT + 4.0))
    assert not after.situation.traffic
    assert after.left_out == {"drone of Remote ID that has not said its name yet": 2}
    after = received((placed(), BOOT + 6.0), since=after)
    assert list(after.situation.traffic) == ["rid-mac:aabbccddeeff"]
    after = received((named(), BOOT + 7.0), (placed(), BOOT + 7.1), since=after)
    assert list(after.situation.traffic) == [NAME]
    after = received(named(b"CHE.HB-123", kind=2), (placed(), BOOT + 8.0), since=after)
    assert list(after.situation.traffic) == [NAME]  # it keeps its first name


def test_the_own_drone_is_no_traffic() -> None:
    without = "drone of Remote ID without an address, which flies as the ownship does"
    own = received(own_position(), named(mac=b""), placed(mac=b""), named(), placed())
    assert not own.situation.traffic and own.left_out == {without: 1, "own echo": 1}
    stated = Reading({}, own_drone=remote_id.names_of(SERIAL.decode()))
    for mac in (MAC, b""):
        echo = received(own_position(), named(mac=mac), placed(mac=mac), reading=stated)
        assert not echo.situation.traffic and echo.left_out == {"own echo": 1}
    late = received(own_position(), named(), placed(), named(mac=b""), placed())
    assert not late.situation.traffic
    nameless = received(own_position(), placed(mac=b""))
    assert not nameless.situation.traffic and nameless.left_out == {without: 1}


def test_one_of_the_own_name_that_flies_elsewhere_or_otherwise_counts() -> None:
    stated = Reading({}, own_drone=remote_id.names_of(SERIAL.decode()))
    for message in (placed(latitude=472_000_000), placed(direction=27_000)):
        after = received(own_position(), named(), message, reading=stated)
        assert list(after.situation.traffic) == [NAME]


def test_drones_of_a_receiver_that_tells_no_transmitter_count() -> None:
    after = received(own_position(47.2), placed(mac=b""))
    assert list(after.situation.traffic) == ["rid-mac:unknown"]
    after = received(own_position(), named(mac=b""), placed(mac=b"", direction=27_000))
    assert list(after.situation.traffic) == [NAME]
    two = named(mac=b""), named(b"1581F5FJD23A00B2", mac=b"")
    after = received(own_position(), *two, placed(mac=b""))
    assert list(after.situation.traffic) == [NAME]
    after = received(own_position(), named(mac=b""), named(b"\1abc", b"", 4), placed(mac=b""))
    assert not after.situation.traffic  # a session beside the serial number


def test_of_many_transmitters_the_latest_are_remembered_and_none_is_hidden() -> None:
    crowd = [placed(n.to_bytes(6, "big")) for n in range(1, 400)]
    after = received(*crowd)
    assert len(after.drones) == 256
    assert "rid-mac:00000000018f" in after.situation.traffic


def test_all_messages_of_drones_are_taken_from_anybody() -> None:
    kinds = {named().get_type(), placed().get_type(), packed(PACKS[0][0]).get_type()}
    assert kinds < TRAFFIC


@given(st.binary(min_size=225, max_size=225), st.integers(0, 255), st.integers(0, 12))
def test_no_pack_raises_or_leaves_the_range(content: bytes, size: int, count: int) -> None:
    for exact in (size, 25):
        message = dialect.MAVLink_open_drone_id_message_pack_message(
            0, 0, padded(MAC), exact, count, list(content)
        )
        for second in (BOOT, BOOT + 10.0):
            after = received(clock(), (wired(message), second))
            assert all(map(is_possible, after.situation.traffic.items()))


@given(
    st.fixed_dictionaries(
        {
            "status": st.integers(0, 255),
            "direction": st.integers(0, 65_535),
            "speed_horizontal": st.integers(0, 65_535),
            "speed_vertical": st.integers(-32_768, 32_767),
            "latitude": st.integers(-(2**31), 2**31 - 1),
            "longitude": st.integers(-(2**31), 2**31 - 1),
            "altitude_barometric": st.floats(width=32),
            "altitude_geodetic": st.floats(width=32),
            "horizontal_accuracy": st.integers(0, 255),
            "vertical_accuracy": st.integers(0, 255),
            "barometer_accuracy": st.integers(0, 255),
            "speed_accuracy": st.integers(0, 255),
            "timestamp": st.floats(width=32),
            "timestamp_accuracy": st.integers(0, 255),
        }
    )
)
def test_no_location_raises_or_leaves_the_range(fields: dict[str, Any]) -> None:
    after = received(clock(), named(), placed(**fields))
    assert all(map(is_possible, after.situation.traffic.items()))


def is_possible(item: tuple[str, Any]) -> bool:
    name, track = item
    last = track.last
    if last is None:
        return track.fault is not None and name == identifier("", name)
    return (
        abs(last.latitude) <= 90.0
        and abs(last.longitude) <= 180.0
        and last.speed <= FASTEST
        and (last.altitude is None or -1_000.0 <= last.altitude.value <= 30_000.0)
        and 0.0 < last.time_std < 1.0
        and last.time <= round((BOOT + 10.0) * SECOND)
    )
