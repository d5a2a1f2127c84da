"""Live ADS-B: what a receiver's lines and documents mean, and Debian's dump1090 at the other end of
the line.
"""

import json
import math
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.request.request import Altitude
from ros_bridge.core.feeds.aircraft_json import AircraftJson
from ros_bridge.core.feeds.base_station import BaseStation
from ros_bridge.core.feeds.traffic import LATEST, Traffic
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.reports import Report
from ros_bridge.transport.receivers import Receiver, check_sources

T0 = 1_800_000_000
OWN = Report("4b0000", T0 * SECOND, 47.0, 8.0, 60.0, 0.0, Altitude(1_500.0, "pressure"))
ROW = {
    "hex": "4b1234",
    "lat": 47.1,
    "lon": 8.2,
    "gs": 120.0,
    "track": 90.0,
    "alt_baro": 5000,
    "seen_pos": 0.5,
}
KNOT, FOOT = 1852.0 / 3600.0, 0.3048


def document(second: float, *rows: Any, **changes: Any) -> str:
    return json.dumps({"now": T0 + second, "aircraft": list(rows) or [ROW | changes]})


def line(kind: int, second: float, address: str = "4B1234", **fields: Any) -> str:
    """Return a line whose clock is that of another time zone."""
    at = (
        time.strftime("%Y/%m/%d,%H:%M:%S", time.gmtime(T0 + 7_200 + int(second)))
        + f".{round(second % 1 * 1e3):03d}"
    )
    names = (
        "call",
        "alt",
        "gs",
        "track",
        "lat",
        "lon",
        "climb",
        "squawk",
        "alert",
        "emergency",
        "spi",
        "ground",
    )
    values = ",".join(str(fields.get(name, "")) for name in names)
    return f"MSG,{kind},1,1,{address},1,{at},{at},{values}"


def read(reader: Any, *timed_texts: tuple[float, str]) -> list[Report | FieldError]:
    """Return what a reader makes of texts and their arrivals, s."""
    return [
        report
        for second, text in timed_texts
        for report in reader.reports_of(text, round((T0 + second) * SECOND))
    ]


def reports(*documents: str, own: Report | None = OWN) -> tuple[list[Any], dict[str, int]]:
    """Return what is found in documents, one a second after an empty one, and what was left out."""
    traffic = Traffic("4b0000")
    traffic.own = own
    empty = json.dumps({"now": T0, "aircraft": []})
    read_reports = read(AircraftJson(traffic), *enumerate([empty, *documents]))
    return read_reports, dict(+traffic.counts)


def test_a_document_becomes_reports_of_the_time_of_their_positions() -> None:
    (report,), left_out = reports(document(1.0, nac_p=9, nac_v=2, geom_rate=600, flight="SWR12K"))
    assert report.callsign == "SWR12K"
    assert (report.identifier, report.time) == ("4b1234", T0 * SECOND + SECOND // 2)
    assert (report.east, report.north) == pytest.approx((120.0 * KNOT, 0.0), abs=1e-9)
    assert report.altitude.value == pytest.approx(5000 * FOOT)
    assert report.altitude.vertical_speed == pytest.approx(3.048)
    assert report.position_std == pytest.approx(30.0 / math.sqrt(-2.0 * math.log(0.05)), rel=1e-3)
    assert left_out == {}


def test_lines_of_an_aircraft_are_put_together() -> None:
    reader = BaseStation(Traffic(""))
    place = {"lat": 47.1, "lon": 8.2, "alt": 5000}
    first, second = read(
        reader,
        (0.1, line(3, 0.0, **place)),
        (0.2, line(4, 0.1, gs=120, track=180, climb=-64)),
        (0.3, line(1, 0.2, call="SWR12K  ")),
        (0.6, line(3, 0.5, **place)),
    )
    assert second.callsign == "SWR12K"
    assert "speed has not been received" in str(first) and first.sighting.place == (47.1, 8.2)
    assert (second.identifier, second.time) == ("4b1234", T0 * SECOND + 6 * SECOND // 10)
    assert (second.east, second.north) == pytest.approx((0.0, -120.0 * KNOT), abs=1e-9)
    (old,) = read(reader, (9.6, line(3, 9.5, **place)))
    assert old.field == "adsb 4b1234.velocity_age"


def test_an_altitude_of_an_old_line_is_none_of_a_new_position() -> None:
    reader, place = BaseStation(Traffic("")), {"lat": 47.1, "lon": 8.2}
    read(reader, (0.0, line(5, 0.0, alt=38_000)))
    for second, known in ((2.5, True), (60.0, False), (600.0, False)):
        moving, placed = line(4, second, gs=120, track=180), line(3, second, **place)
        (report,) = read(reader, (second, moving), (second, placed))
        assert isinstance(report, Report) and (report.altitude is not None) == known
    (report,) = read(reader, (601.0, line(3, 601.0, alt=5_000, **place)))
    assert isinstance(report, Report) and report.altitude is not None


def test_what_is_no_traffic_is_left_out_and_counted() -> None:
    own = ROW | {"hex": "4B0000"}
    unplaced = {"hex": "4b0003", "alt_baro": 3000, "seen": 1.0}
    taxiing = {"gs": 20.0}
    assert reports(
        document(
            1.0,
            ROW | taxiing | {"alt_baro": "ground"},
            ROW | taxiing | {"altitude": "ground", "alt_baro": None},
            own,
            unplaced,
        )
    ) == (
        [],
        {"on the ground": 2, "own echo": 1, "without a position": 1},
    )
    reader = BaseStation(Traffic("4B0000"))
    place = {"lat": 47.1, "lon": 8.2}
    assert (
        read(
            reader,
            (0.0, line(2, 0.0, gs=9, track=80, **place)),
            (0.1, line(3, 0.1, "4b0000", **place)),
        )
        == []
    )
    assert (
        read(reader, (0.2, line(4, 0.2, gs=9, track=80)), (0.3, line(3, 0.3, ground=-1, **place)))
        == []
    )
    assert len(read(reader, (0.5, line(3, 0.5, **place)))) == 1  # it has taken off


@pytest.mark.parametrize(
    "changes",
    [
        {"gs": 110.0},
        {"gs": 20.0, "geom_rate": -640},
        {"gs": 20.0, "alt_geom": 17_000},
        {"gs": 20.0, "alt_geom": 4_900},  # as high as the ownship
        {"gs": 0.0, "category": "C3"},  # a tethered balloon
    ],
)
def test_a_ground_flag_that_speed_or_height_contradicts_removes_no_aircraft(
    changes: dict[str, Any],
) -> None:
    own = Report("4b0000", T0 * SECOND, 47.0, 8.0, 60.0, 0.0, Altitude(1_500.0, "wgs84"))
    (report,), left_out = reports(document(1.0, alt_baro="ground", **changes), own=own)
    assert (report.identifier, left_out) == ("4b1234", {})


def test_a_flag_of_a_line_is_put_aside_too_and_what_lands_is_on_the_ground() -> None:
    traffic, place = Traffic(""), {"lat": 47.1, "lon": 8.2}
    reader = BaseStation(traffic)
    flying = line(3, 0.0, gs=110, track=180, climb=-640, ground=-1, **place)
    landed = line(2, 9.0, gs=20, track=180, **place)
    assert len(read(reader, (0.0, flying))) == 1
    assert len(traffic.doubted) == 1
    assert read(reader, (9.0, landed), (19.0, line(2, 19.0, **place))) == []
    assert traffic.counts["on the ground"] == 2


def test_a_position_by_multilateration_is_traffic() -> None:
    """Its lines have three fields more than BaseStation's: stations, nothing, error."""
    moving = {"alt": 4000, "gs": 110, "track": 180, "climb": 64, "lon": 8.0}
    lines = [line(3, second, lat=47.05 - 5e-4 * second, **moving) for second in range(3)]
    read_reports = read(
        BaseStation(Traffic("")),
        *((n, item.replace("MSG", "MLAT") + ",5,,60") for n, item in enumerate(lines)),
    )
    assert [item.identifier for item in read_reports] == ["4b1234"] * 3
    assert read_reports[-1].north == pytest.approx(-110.0 * KNOT)


@pytest.mark.parametrize("code", ["nac_p", "nac_v"])
def test_no_category_of_accuracy_is_better_than_a_higher_one(code: str) -> None:
    spreads = []
    for value in range(5):
        (report,), _ = reports(document(1.0, **{code: value}))
        spreads.append(report.position_std if code == "nac_p" else report.velocity_std)
    assert spreads == sorted(spreads, reverse=True)


@pytest.mark.parametrize("row", [{"hex": "zz"}, {}])
def test_a_place_under_no_address_is_told_and_costs_no_other_aircraft(row: dict[str, str]) -> None:
    nameless = {name: value for name, value in ROW.items() if name != "hex"} | row
    wrong, report = sorted(
        reports(document(1.0, nameless, ROW))[0], key=lambda item: str(type(item))
    )
    assert report.identifier == "4b1234"
    assert wrong.sighting.place == (47.1, 8.2)


def test_a_clock_that_steps_back_hides_no_aircraft() -> None:
    """As where the autopilot, or a simulation, begins anew."""
    traffic = Traffic("")
    reader = AircraftJson(traffic)
    assert len(read(reader, (99.0, document(1.0)), (100.0, document(2.0)))) == 1
    reader.begin_anew()
    assert len(read(reader, (5.0, document(3.0)))) == 1


@pytest.mark.parametrize(
    ("changes", "copied"),
    [
        ({}, True),
        ({"hex": "4b7777", "type": "tisb_icao"}, True),
        ({"type": "adsb_other"}, False),
        ({"lon": 8.02}, False),
        ({"gs": 160.0}, False),
        ({"alt_baro": 5600}, False),
    ],
)
def test_a_track_of_radar_at_the_ownship_is_its_copy(changes: dict[str, Any], copied: bool) -> None:
    row = {
        "hex": "~2abcde",
        "type": "tisb_trackfile",
        "lat": 47.001,
        "lon": 8.001,
        "gs": 120.0,
        "track": 88.0,
        "seen_pos": 0.0,
    }
    read_reports, left_out = reports(document(1.0, row | {"alt_baro": 4900} | changes))
    assert (read_reports == [], left_out == {"copy of the ownship": 1}) == (copied, copied)
    assert len(reports(document(1.0, row | {"alt_baro": 4900} | changes), own=None)[0]) == 1


@pytest.mark.parametrize(
    ("reference", "chosen"), [("pressure", "pressure"), ("wgs84", "wgs84"), ("msl", "wgs84")]
)
def test_the_altitude_is_that_which_compares_with_the_own_one(reference: str, chosen: str) -> None:
    own = Report("4b0000", T0 * SECOND, 47.0, 8.0, 60.0, 0.0, Altitude(1_500.0, reference))
    (report,), _ = reports(document(1.0, alt_geom=5400), own=own)
    assert report.altitude.reference == chosen
    (report,), _ = reports(document(1.0), own=own)
    assert report.altitude.reference == "pressure"


def test_a_position_that_stays_is_not_passed_on_again() -> None:
    read_reports, left_out = reports(
        document(1.0), document(2.0, seen_pos=1.5), document(3.0, seen_pos=2.45), document(4.0)
    )
    assert [report.time for report in read_reports] == [
        T0 * SECOND + SECOND // 2,
        T0 * SECOND + 7 * SECOND // 2,
    ]
    assert left_out == {"repeated position": 2}


def test_a_document_that_is_not_renewed_says_nothing() -> None:
    traffic = Traffic("")
    reader = AircraftJson(traffic)
    assert read(reader, *((second, document(-9e4)) for second in range(3))) == []
    assert traffic.counts["repeated document"] == 2
    reader.begin()
    assert read(reader, (4.0, document(-9e4))) == []


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"gs": None}, "speed"),
        ({"track": ""}, "track"),
        ({"gs": 1e4}, "speed"),
        ({"seen_pos": -1.0}, "seen_pos"),
        ({"seen_pos": "old"}, "seen_pos"),
    ],
)
def test_an_aircraft_without_a_velocity_is_sighted(changes: dict[str, Any], field: str) -> None:
    (problem,), _ = reports(document(1.0, **changes))
    assert problem.field == f"adsb 4b1234.{field}"
    assert (problem.sighting.identifier, problem.sighting.place) == ("4b1234", (47.1, 8.2))


def test_an_age_below_zero_by_rounding_is_none() -> None:
    (report,), _ = reports(document(1.0, seen_pos=-0.1))
    assert (report.identifier, report.time) == ("4b1234", (T0 + 1) * SECOND)


@pytest.mark.parametrize(
    "garbage",
    [
        "",
        "<html>",
        "[1]",
        "7",
        '{"now": 1}',
        '{"now": "x", "aircraft": []}',
        '{"now": Infinity, "aircraft": []}',
        '{"now": 5, "aircraft": 5}',
        '{"now": 5, "aircraft": [5]}',
        '{"now": 5, "aircraft": [{}]}',
        "[" * 20_000,
    ],
)
def test_garbage_is_one_error_and_nothing_else(garbage: str) -> None:
    problems = read(AircraftJson(Traffic("")), (0.0, garbage))
    assert [problem.field for problem in problems] == ["document"]
    wrong = read(
        BaseStation(Traffic("")),
        (0.0, garbage),
        (0.0, "MSG,3,1,1,4B12"),
        (0.0, line(3, 0.0, "4b123g")),
    )
    assert [problem.field for problem in wrong] == ["line"] * (3 if garbage else 2)


def test_values_that_are_none_are_refused_one_by_one() -> None:
    rows = [
        ROW | {"lat": [1]},
        ROW | {"hex": "zz"},
        ROW | {"nac_p": [], "tisb": 5, "type": None, "hex": "4b0001"},
    ]
    outcomes, _ = reports(document(1.0, *rows))
    assert [type(outcome) for outcome in outcomes] == [FieldError, FieldError, Report]


def test_what_was_queued_is_late_by_as_much_and_not_fresh() -> None:
    reader, place = BaseStation(Traffic("")), {"lat": 47.1, "lon": 8.2}
    read(reader, (0.0, line(4, 0.0, gs=120, track=180)))
    (late,) = read(reader, (8.0, line(3, 1.0, **place)))
    assert late.time == (T0 + 1) * SECOND
    with pytest.raises(TimeoutError, match="late"):
        read(reader, (LATEST + 5.0, line(3, 2.0, **place)))
    reader.begin()
    assert (
        len(read(reader, (50.0, line(4, 2.1, gs=120, track=180)), (50.1, line(3, 2.2, **place))))
        == 1
    )


@pytest.mark.parametrize(
    "source", ["localhost:30003", "tcp://", "udp://h:1", "tcp://h:99999", "tcp://h:1/x", "file://"]
)
def test_an_address_that_is_none_is_refused(source: str) -> None:
    with pytest.raises(ValueError, match=r"^adsb is .*expected tcp://HOST:30003"):
        check_sources(source)


# A receiver at the other end.


def free_ports(count: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [server.getsockname()[1] for server in sockets]
    for server in sockets:
        server.close()
    return ports


def eventually(holds: Callable[[], Any], patience: float = 120.0) -> Any:
    end = time.monotonic() + patience
    while not (result := holds()):
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.05)
    return result


class Sky:
    """Aircraft whose transponders a real dump1090 hears, by frames encoded as DO-260B has them."""

    def __init__(self, raw: int) -> None:
        self._raw = socket.create_connection(("127.0.0.1", raw))

    def transmit(self) -> None:
        """Send what traffic, an aircraft on the ground, the ownship and its track by TIS-B transmit
        in a second.
        """
        for odd in (0, 1):
            frames = [_position(0x4B1234, 47.1, 8.2, odd), _velocity(0x4B1234, 100, -50)]
            frames += [
                _frame(0x4B9999, 6 << 51 | 10 << 36 | odd << 34 | _place(47.01, 8.01, odd, 90.0))
            ]
            frames += [_position(0x4B0000, 47.0, 8.0, odd), _velocity(0x4B0000, 117, 0)]
            frames += [_position(0x2ABCDE, 47.0, 8.0, odd, 1), _velocity(0x2ABCDE, 115, 2, 1)]
            self._raw.sendall("".join(frames).encode())
            time.sleep(0.4)

    def close(self) -> None:
        self._raw.close()


def _frame(address: int, message: int, tisb: int = 0) -> str:
    bits = (
        ((18 << 27 | 2 << 24) if tisb else (17 << 27 | 5 << 24) | 0) << 56 | address << 56 | message
    )
    remainder = bits << 24
    for at in range(remainder.bit_length() - 1, 23, -1):
        remainder ^= (remainder >> at & 1) * (0x1FFF409 << at - 24)
    return f"*{bits << 24 | remainder:028X};\n"


def _place(latitude: float, longitude: float, odd: int, turn: float = 360.0) -> int:
    wide = 1.0 - (1.0 - math.cos(math.pi / 30.0)) / math.cos(math.radians(latitude)) ** 2
    zones = math.floor(math.tau / math.acos(wide))
    parts = []
    for angle, size in ((latitude, turn / (60 - odd)), (longitude, turn / (zones - odd))):
        parts.append(math.floor(2**17 * (angle % size) / size + 0.5) % 2**17)
    return parts[0] << 17 | parts[1]


def _position(address: int, latitude: float, longitude: float, odd: int, tisb: int = 0) -> str:
    feet = (4900 + 1000) // 25
    altitude = (feet & 0x7F0) << 1 | 0x10 | feet & 0xF
    return _frame(
        address,
        11 << 51 | tisb << 48 | altitude << 36 | odd << 34 | _place(latitude, longitude, odd),
        tisb,
    )


def _velocity(address: int, east_kt: int, north_kt: int, tisb: int = 0) -> str:
    east, north = ((value < 0) << 10 | abs(value) + 1 for value in (east_kt, north_kt))
    return _frame(
        address, 19 << 51 | 1 << 48 | tisb << 47 | east << 32 | north << 21 | 1 << 10, tisb
    )


@pytest.fixture
def dump1090(tmp_path: Path) -> Iterator[tuple[Callable[[], Any], int, Sky]]:
    """Yield how to start Debian's dump1090 again, its port, and what it hears; its documents are in
    ``tmp_path``.
    """
    program = shutil.which("dump1090-mutability") or shutil.which(
        "dump1090-mutability", path="/usr/bin"
    )
    if program is None:
        pytest.skip("dump1090-mutability is not installed")
    raw, sbs = free_ports(2)
    options = [
        "--net-only",
        "--quiet",
        "--net-bind-address",
        "127.0.0.1",
        "--lat",
        "47",
        "--lon",
        "8",
    ]
    options += [
        "--write-json",
        str(tmp_path),
        "--net-ri-port",
        str(raw),
        "--net-sbs-port",
        str(sbs),
    ]
    options += [word for port in ("ro", "bi", "bo") for word in (f"--net-{port}-port", "0")]
    start = partial(
        subprocess.Popen, [program, *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    with start() as running:
        eventually(lambda: _listens(raw))
        sky = Sky(raw)
        running_now = [running]

        def restart() -> None:
            running_now[-1].terminate()
            running_now[-1].wait()
            sky.close()
            running_now.append(start())
            eventually(lambda: _listens(raw))
            sky.__init__(raw)

        try:
            yield restart, sbs, sky
        finally:
            sky.close()
            running_now[-1].terminate()
            running_now[-1].wait()


def _listens(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def drain(receiver: Receiver, reader: Any) -> list[Report | FieldError]:
    outcomes: list[Report | FieldError] = []
    while not receiver.heard.empty():
        item = receiver.heard.get()
        if item is None:
            reader.begin()
        else:
            outcomes += reader.reports_of(item[1], item[0])
    return outcomes


def own_now() -> Report:
    return Report(
        "4b0000", time.time_ns(), 47.0, 8.0, 117 * KNOT, 0.0, Altitude(4900 * FOOT, "pressure")
    )


def is_traffic(report: Any) -> bool:
    assert isinstance(report, Report), report
    return (
        report.identifier == "4b1234"
        and abs(report.latitude - 47.1) < 1e-4
        and math.hypot(report.east - 100 * KNOT, report.north + 50 * KNOT) < 2.0
        and abs(time.time_ns() - report.time) < 5 * SECOND
    )


@pytest.mark.slow
def test_lines_of_a_real_receiver_become_reports_and_again_after_its_restart(dump1090: Any) -> None:
    restarted, port, sky = dump1090
    traffic = Traffic("4b0000")
    reader, receiver = BaseStation(traffic), Receiver(f"tcp://127.0.0.1:{port}", time.time_ns)
    receiver.start()
    try:
        for _ in range(2):
            eventually(lambda: receiver.problem == "")
            read_reports: list[Any] = []
            while not read_reports:
                sky.transmit()
                traffic.own = own_now()
                read_reports = [
                    outcome for outcome in drain(receiver, reader) if isinstance(outcome, Report)
                ]
            assert all(map(is_traffic, read_reports))
            assert traffic.counts["on the ground"] and traffic.counts["own echo"]
            restarted()
    finally:
        receiver.stop()
    assert (
        "closed" in receiver.problem
        or "cannot be read" in receiver.problem
        or receiver.problem == ""
    )


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["http", "file"])
def test_documents_of_a_real_receiver_become_reports(
    scheme: str, dump1090: Any, tmp_path: Path
) -> None:
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None: ...

    _, _, sky = dump1090
    traffic = Traffic("4b0000")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = (
            f"http://127.0.0.1:{server.server_port}" if scheme == "http" else f"file://{tmp_path}"
        )
        reader, receiver = AircraftJson(traffic), Receiver(f"{base}/aircraft.json", time.time_ns)
        receiver.start()
        read_reports: list[Any] = []
        end = time.monotonic() + 120.0
        while len(read_reports) < 2 or not traffic.counts["copy of the ownship"]:
            assert time.monotonic() < end, (traffic.counts, receiver.problem)
            sky.transmit()
            traffic.own = own_now()
            read_reports += [
                outcome for outcome in drain(receiver, reader) if isinstance(outcome, Report)
            ]
        receiver.stop()
        receiver.join()
        server.shutdown()
    assert all(map(is_traffic, read_reports))
    assert traffic.counts["on the ground"] and traffic.counts["own echo"]


def test_a_receiver_that_is_not_there_or_sends_no_lines_is_named() -> None:
    (free,) = free_ports(1)
    receiver = Receiver(f"tcp://127.0.0.1:{free}", time.time_ns)
    receiver.start()
    eventually(lambda: "refused" in receiver.problem)
    receiver.stop()
    with socket.create_server(("127.0.0.1", 0)) as server:
        receiver = Receiver(f"tcp://127.0.0.1:{server.getsockname()[1]}", time.time_ns)
        receiver.start()
        connection, _ = server.accept()
        with connection:
            connection.sendall(b"\x1a2" * 5000)
            eventually(lambda: "no lines" in receiver.problem)
        receiver.stop()


def test_a_translator_passes_live_traffic_on_and_says_what_is_wrong() -> None:
    graph = pytest.importorskip("tests.ros_bridge.graph")
    from diagnostic_msgs.msg import DiagnosticArray
    from rlcas_msgs.msg import AircraftState

    from ros_bridge.nodes.translator import Translator
    from ros_bridge.transport import qos

    with pytest.raises(ValueError, match="adsb and traffic_source nav_sat_fix are both given"):  # noqa: SIM117
        with graph.running_beside(
            Translator, adsb="tcp://h", traffic_source="nav_sat_fix", traffic_id="n1"
        ):
            pass
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        graph.running_beside(
            Translator, adsb=f"tcp://127.0.0.1:{server.getsockname()[1]}", diagnostics_period=0.2
        ) as (
            _,
            client,
        ),
    ):
        states = client.hear_traffic()
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        connection, _ = server.accept()
        with connection:
            connection.sendall(b"no such line\n")
            client.spin(lambda: health and "line is" in health[-1].status[0].message)
            connection.sendall(f"{line(3, 0.0, lat=47.1, lon=8.2)}\n".encode())
            client.spin(lambda: states)
            assert (states[-1].id, states[-1].valid) == ("4b1234", AircraftState.VALID_POSITION)
            lines = (line(4, 0.5, gs=100, track=90), line(3, 0.6, lat=47.1, lon=8.2, alt=5000))
            connection.sendall("".join(f"{text_line}\n" for text_line in lines).encode())
            state = client.spin(
                lambda: states[-1] if states[-1].valid & AircraftState.VALID_VELOCITY else None
            )
            assert state.velocity.x == pytest.approx(100 * KNOT)
            assert state.altitude_reference == AircraftState.ALTITUDE_PRESSURE
        client.spin(lambda: health[-1].status[0].message.endswith("has closed the connection"))
