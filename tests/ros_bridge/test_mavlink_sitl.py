"""The program beside ArduPlane's own simulation: it resolves an encounter, never fights an
operator, and where it dies the autopilot flies on."""

import math
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from benchmarks.ardupilot.relay import Relay
from benchmarks.ardupilot.situations import SITUATIONS, fly_situation
from commands.command import InputError
from envs.formats.local_frame import LocalFrame
from envs.traffic.track_units import KNOT
from ros_bridge.mavlink.flight import SEPARATION, VERTICAL, Encounter, Intruder, apart, fly
from ros_bridge.mavlink.link import Link
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.options import VERTICAL_MARGIN
from ros_bridge.mavlink.sitl import HOME, Leg, Sitl, SitlError, folder, place
from ros_bridge.mavlink.state import RECOVERED

ROOT = Path(__file__).parents[2]
try:
    folder()
except SitlError as problem:
    pytest.skip(str(problem), allow_module_level=True)

pytestmark = pytest.mark.slow
INSTANCE, PORT = 3, 5_792  # of the simulation, and where the program connects to it
ADDRESS = f"tcp:127.0.0.1:{PORT}"
MISSION = 620.0  # m above mean sea level
ONCOMING, EAST_OF_HOME = 0xABC123, 1_000.0
# The failsafe that brings the mission back where the program dies (docs/howto/mavlink.md).
FAILSAFE = {"FS_GCS_ENABL": 1, "MAV_GCS_SYSID": 245, "FS_LONG_ACTN": 4, "FS_LONG_TIMEOUT": 10}


class Sky:
    """An aircraft on its mission, and another that comes towards it; reports once a second."""

    def __init__(self, sitl: Sitl) -> None:
        self.sitl, self.mode, self.texts = sitl, -1, []
        self.time = self.east = self.north = 0.0
        self.least = float("inf")
        self.tell: Callable[..., object] = sitl.traffic
        self._frame = LocalFrame(HOME[0], HOME[1])
        self._began: float | None = None
        self._told = 0.0

    def turn(self, seconds: float = 0.05) -> None:
        """Take in what the autopilot sends for so long, and send the other's reports."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.sitl.beat()
            message = self.sitl.station.recv_match(blocking=True, timeout=0.02)
            if message is None:
                continue
            kind = message.get_type()
            if kind == "HEARTBEAT" and message.get_srcComponent() == 1:
                self.mode = message.custom_mode
            elif kind == "STATUSTEXT":
                self.texts.append(message.text)
            elif kind == "GLOBAL_POSITION_INT":
                # Not LOCAL_POSITION_NED: its origin is where the estimator began, not home.
                self.time = 1e-3 * float(message.time_boot_ms)
                at = self._frame.place(1e-7 * message.lat, 1e-7 * message.lon)
                self.east, self.north = float(at.x), float(at.y)
                self._meet()

    def _meet(self) -> None:
        if self._began is None:
            if self.east < EAST_OF_HOME:
                return
            self._began = self.time
        passed = self.time - self._began
        oncoming = EAST_OF_HOME + 22.0 * 60.0, 25.0 * (60.0 - passed)
        apart = ((self.east - oncoming[0]) ** 2 + (self.north - oncoming[1]) ** 2) ** 0.5
        self.least = min(self.least, apart)
        if self.time - self._told >= 1.0:
            self._told = self.time
            self.tell(ONCOMING, *oncoming, 180.0, 25.0, 620.0)

    def until(self, mode: int, seconds: float) -> float:
        """Wait for a mode, for so many seconds of the autopilot's at most, and return how long."""
        began, limit = self.time, time.monotonic() + 60.0
        while self.mode != mode:
            self.turn()
            if self.time - began > seconds or time.monotonic() > limit:
                pytest.fail(f"mode {mode} did not come, it is {self.mode}: {self.texts}")
        return self.time - began


@contextmanager
def encounter(
    *options: str, address: str = ADDRESS, **parameters: float
) -> Generator[tuple[Sky, Any]]:
    """Give an aircraft on its mission and the program beside it."""
    with Sitl(INSTANCE, 4.0, FAILSAFE | parameters) as sitl:
        sitl.upload([Leg(100.0, 0.0, 60.0, 22, 15.0), Leg(400.0, 0.0), Leg(6_000.0, 0.0)])
        sitl.take_off()
        sitl.rate(33, 1e5)
        sitl.rate(0, 2e5)
        command = [sys.executable, "-m", "ros_bridge.mavlink", "--connect", address]
        command += ["--simulated", "--separation", "200", "--deadline", "0.2"]
        command += ["--unknown-position-std", "5", "--unknown-velocity-std", "0.2", *options]
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        try:
            yield Sky(sitl), process
        finally:
            process.kill()
            process.communicate()


@pytest.mark.parametrize("in_flight", [False, True])
def test_an_encounter_is_resolved_beside_a_fence_and_the_mission_flown_on(in_flight: bool) -> None:
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    # Without the fence the plan leads through it.
    fence = ((1_300.0, 150.0), (2_600.0, 150.0), (2_600.0, 700.0), (1_300.0, 700.0))
    waiting = [fence] if in_flight else []

    def upload(sitl: Sitl, seconds: float, row: Any) -> None:
        if waiting:
            with sitl.awake():
                sitl.upload_fence(waiting.pop(), keep_in=False)

    # The simulation stands still while the program computes: a loaded machine changes nothing.
    meeting = Encounter(0, (crossing,), 0.0, 300.0, 0.0, () if in_flight else fence)
    flight = fly(meeting, "ours_horizontal", instance=INSTANCE, until=140.0, watch=upload)
    assert not [row for row in flight.rows if 1_300.0 < row.x < 2_600.0 and row.y > 150.0]
    assert flight.separation >= SEPARATION
    assert flight.taken_over == 1
    assert flight.rows[-1].mode == Mode.AUTO
    assert any("back to AUTO" in text for text in flight.texts)
    assert in_flight == any("fence has changed: 1 areas" in text for text in flight.texts)


@pytest.mark.parametrize("climb", [0.0, 2.5])
def test_an_aircraft_ahead_is_passed_above_or_below_on_the_missions_track(climb: float) -> None:
    """It comes head-on at the mission's height, or climbs to it."""
    ahead = Intruder(math.pi, 25.0, 60.0, 0.0, climb=climb)
    meeting = Encounter(0, (ahead,), 4.0, 300.0, goal=8_000.0)
    flight = fly(meeting, "ours", instance=INSTANCE, speedup=10.0, until=330.0)
    assert not flight.lost and flight.taken_over == 1
    guided = [row for row in flight.rows if row.mode == Mode.GUIDED]
    assert max(abs(row.above - MISSION) for row in guided) > VERTICAL
    # On the mission's ground track all the time, and back at its height before AUTO.
    assert flight.on_track == pytest.approx(flight.rows[-1].time, abs=0.5)
    assert abs(guided[-1].above - MISSION) < 5.0
    assert flight.rows[-1].mode == Mode.AUTO
    back = [row for row in flight.rows if row.time > guided[-1].time]
    assert max(abs(row.above - MISSION) for row in back) < 5.0
    assert max(abs(period.above) for period in flight.steered) < 0.5 * VERTICAL_MARGIN
    assert any(" m/s, climb to " in text or " m/s, descend to " in text for text in flight.texts)


def test_a_backup_that_climbs_is_flown_and_the_missions_altitude_given_back() -> None:
    situation = SITUATIONS["climbing_backup"]
    flight, meeting = fly_situation(situation, INSTANCE), situation.encounter()
    assert not flight.lost and not flight.breached and flight.taken_over == 1
    assert "RLCAS: backup, climbing" in flight.texts
    assert not any("not assured" in text for text in flight.texts if "backup" in text)
    late = meeting.intruders[1]  # turns in where nothing can be planned
    nearest = min(flight.rows, key=lambda row: apart(row, late, meeting.cruise))
    # It would have been lost at the height of the plan that was flown until then.
    assert apart(nearest, late, meeting.cruise) < SEPARATION
    before = max(row.above for row in flight.rows if row.time < late.turn_at)
    assert before - late.above(0.0) < VERTICAL < nearest.above - late.above(0.0)
    assert max(abs(period.above) for period in flight.steered) < 0.5 * VERTICAL_MARGIN
    assert flight.rows[-1].mode == Mode.AUTO
    assert abs(flight.rows[-1].above - MISSION) < 5.0


def test_a_program_that_did_not_keep_up_says_so_and_calls_nothing_safe_for_a_while() -> None:
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    stalled: list[float] = []

    def stall(sitl: Sitl, seconds: float, row: Any) -> None:
        """Let the simulation go on for a while without the program, before it would take over."""
        if seconds > 5.0 and not stalled:
            stalled.append(seconds)
            with sitl.awake():
                began = sitl.wait("GLOBAL_POSITION_INT").time_boot_ms
                while sitl.wait("GLOBAL_POSITION_INT").time_boot_ms < began + 3_000:
                    pass

    flight = fly(
        Encounter(0, (crossing,), 0.0, 300.0),
        "ours_horizontal",
        instance=INSTANCE,
        until=45.0,
        watch=stall,
    )
    assert any(text.startswith("RLCAS: late by") for text in flight.texts)
    taken_over_at = next(row.time for row in flight.rows if row.mode == Mode.GUIDED)
    assert taken_over_at > stalled[0] + 3.0 + RECOVERED
    assert flight.taken_over == 1


def test_a_foreign_mode_ends_it_at_once_and_a_killed_program_leaves_the_mission_to_fly() -> None:
    with encounter("--fly") as (sky, process):
        sky.until(Mode.GUIDED, 150.0)
        sky.turn(1.0)
        sky.sitl.command(176, 1.0, float(Mode.LOITER))
        assert sky.until(Mode.LOITER, 5.0) < 5.0
        began = time.monotonic()
        while not any("commanding ends" in text for text in sky.texts):
            sky.turn(0.02)
            assert time.monotonic() - began < 1.0
        sky.turn(2.0)
        assert sky.mode == Mode.LOITER
        assert process.poll() is None


def test_traffic_that_only_another_receiver_hears_is_flown_round() -> None:
    def line(number: int, east: float, north: float, track: float, speed: float, _: float) -> str:
        latitude, longitude = place(east, north)
        now = datetime.fromtimestamp(sky.time, UTC)
        clock = [f"{now:%Y/%m/%d}", f"{now:%H:%M:%S.%f}"[:-3]]
        fields = ["MSG", "3", "1", "1", f"{number:06X}", "1", *clock, *clock]
        fields += ["", "2000", f"{speed / KNOT:.2f}", f"{track:.2f}"]
        fields += [f"{latitude:.6f}", f"{longitude:.6f}", "0", "", "", "", "", "0"]
        return ",".join(fields) + "\r\n"

    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with encounter("--fly", "--adsb", address) as (sky, process):
            server.settimeout(60.0)
            receiver, _ = server.accept()
            with receiver:
                sky.tell = lambda *values: receiver.sendall(line(*values).encode())
                sky.until(Mode.GUIDED, 150.0)
                assert any(f"{ONCOMING:06x} in" in text for text in sky.texts)
                assert process.poll() is None


def test_where_the_program_dies_the_autopilots_failsafe_brings_the_mission_back() -> None:
    with encounter("--fly") as (sky, process):
        sky.until(Mode.GUIDED, 150.0)
        sky.turn(0.5)
        process.kill()
        assert sky.until(Mode.AUTO, 30.0) < 20.0
        sky.turn(1.0)
        assert sky.mode == Mode.AUTO


def test_a_program_that_hears_nothing_falls_silent_so_that_the_failsafe_acts() -> None:
    relay = Relay(PORT)
    with encounter("--fly", address=relay.address) as (sky, process):
        sky.until(Mode.GUIDED, 150.0)
        sky.turn(0.5)
        relay.lose(to_program=True, to_autopilot=False)
        # Five seconds of our clock, at four times real time, and the failsafe's ten.
        assert sky.until(Mode.AUTO, 60.0) < 50.0
        assert process.poll() is None
    relay.cut()


def test_a_target_that_a_ground_station_sets_in_guided_is_flown_to() -> None:
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    waiting = [30.0]
    target = place(2_000.0, 3_000.0)

    def send_away(sitl: Sitl, seconds: float, row: Any) -> None:
        if waiting and seconds > waiting[0]:
            waiting.clear()
            at = (round(1e7 * degrees) for degrees in target)
            # MAV_CMD_DO_REPOSITION above mean sea level.
            sitl.station.mav.command_int_send(
                1, 1, 0, 192, 0, 0, -1.0, 1.0, 0.0, math.nan, *at, 620.0
            )

    flight = fly(
        Encounter(0, (crossing,), 0.0, 300.0),
        "ours_horizontal",
        instance=INSTANCE,
        until=60.0,
        watch=send_away,
    )
    assert any("target set by others, commanding ends" in text for text in flight.texts)
    assert flight.rows[-1].mode == Mode.GUIDED
    assert flight.rows[-1].y > 200.0
    assert flight.steered[-1].time - flight.steered[0].time < 25.0


@pytest.mark.parametrize("item", [None, 4, 2])
def test_an_item_that_a_ground_station_sets_in_guided_is_where_auto_goes_on(
    item: int | None,
) -> None:
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    waiting, flown_to = [30.0], list[int]()

    def set_item(sitl: Sitl, seconds: float, row: Any) -> None:
        if waiting and seconds > waiting[0] and item is not None:
            waiting.clear()
            sitl.command(224, float(item))  # MAV_CMD_DO_SET_MISSION_CURRENT
        if seconds > 130.0 and not flown_to:
            with sitl.awake():
                flown_to.append(sitl.wait("MISSION_CURRENT").seq)

    flight = fly(
        Encounter(0, (crossing,), 0.0, 300.0),
        "ours_horizontal",
        instance=INSTANCE,
        until=135.0,
        watch=set_item,
    )
    assert flight.separation >= SEPARATION
    assert flight.taken_over == 1
    assert flight.rows[-1].mode == Mode.AUTO
    assert flown_to == [item or 3]
    expected = f"RLCAS: item {item} set by others: AUTO goes on there"
    assert flight.texts.count(expected) == (item is not None)


ELSEWHERE = Leg(100.0, 0.0, 60.0, 22, 15.0), Leg(400.0, 0.0), Leg(1_600.0, 3e3), Leg(3e3, 6e3)


@pytest.mark.parametrize("in_guided", [False, True])
def test_a_mission_that_is_uploaded_in_flight_counts_whatever_its_length(in_guided: bool) -> None:
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    waiting = [30.0 if in_guided else 2.0]

    def upload(sitl: Sitl, seconds: float, row: Any) -> None:
        if waiting and seconds > waiting[0]:
            waiting.clear()
            with sitl.awake():
                sitl.upload(ELSEWHERE)

    flight = fly(
        Encounter(0, (crossing,), 0.0, 300.0),
        "ours_horizontal",
        instance=INSTANCE,
        until=130.0,
        watch=upload,
    )
    # In AUTO the autopilot flies on to where the current item was, until that is set anew.
    assert flight.separation >= SEPARATION
    assert flight.taken_over == 1
    assert flight.rows[-1].mode == Mode.AUTO
    assert flight.rows[-1].y > 500.0
    expected = "RLCAS: mission changed by others: AUTO flies it"
    assert flight.texts.count(expected) == in_guided


def test_the_autopilots_own_avoidance_set_in_flight_ends_it_and_auto_is_back() -> None:
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    waiting = [25.0]

    def forbid(sitl: Sitl, seconds: float, row: Any) -> None:
        if waiting and seconds > waiting[0]:
            waiting.clear()
            sitl.station.mav.param_set_send(1, 1, b"AVD_ENABLE", 1.0, 9)

    flight = fly(
        Encounter(0, (crossing,), 0.0, 300.0),
        "ours_horizontal",
        instance=INSTANCE,
        until=45.0,
        watch=forbid,
    )
    guided = [row.time for row in flight.rows if row.mode == Mode.GUIDED]
    assert guided[0] < 25.0 < guided[-1] < 28.0
    assert flight.rows[-1].mode == Mode.AUTO
    assert any("off: back to AUTO" in text for text in flight.texts)
    off = next(n for n, text in enumerate(flight.texts) if "off: back" in text)
    assert any("a00001 in" in text for text in flight.texts[off:])  # it advises


def test_it_advises_without_being_told_to_fly_and_refuses_to_fly_beside_another_avoidance() -> None:
    with encounter(ADSB_TYPE=1, AVD_ENABLE=1, AVD_F_ACTION=0) as (sky, process):
        refused = subprocess.run(
            [*process.args[:3], "--connect", sky.sitl.third_address, "--fly", "--simulated"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
        assert "AVD_ENABLE is 1; expected 0 with --fly" in refused.stderr
        limit = time.monotonic() + 40.0
        while not any("plan by" in text for text in sky.texts):
            sky.turn()
            assert time.monotonic() < limit
            assert sky.mode in (-1, Mode.AUTO)


def test_a_link_that_is_cut_is_noticed() -> None:
    with Sitl(INSTANCE, 4.0) as sitl:
        link = Link(sitl.address, simulated=True)
        link.find(10.0)
        assert link.parameters()["AIRSPEED_MIN"] == 10.0
        sitl.close()
        began = time.monotonic()
        assert list(link.receive(time.monotonic() + 0.5)) is not None
        assert time.monotonic() - began < 2.0
        with pytest.raises(InputError, match="the autopilot has not sent"):
            link.parameters()
        link.close()
