"""The program beside ArduPlane's own simulation: a mission over the antimeridian, what comes after
the last waypoint, and a link that is cut and comes back."""

import itertools
import math
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from benchmarks.ardupilot.encounters import ground_speed
from benchmarks.ardupilot.relay import Relay
from ros_bridge.mavlink.flight import SEPARATION, Encounter, Intruder, Row, fly
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.sitl import Leg, Sitl, SitlError, folder

try:
    folder()
except SitlError as problem:
    pytest.skip(str(problem), allow_module_level=True)

pytestmark = pytest.mark.slow
INSTANCE = 24
PORT = 5_762 + 10 * INSTANCE  # where the program connects to it
SOUTH, WEST = -0.5 * math.pi, math.pi
# On a loaded machine a search may take longer; the simulation stands still meanwhile.
PATIENT = ("--deadline", "1")
WIND, WIND_FROM = 8.0, 300.0
NINE = (
    Leg(400.0, 0.0),
    Leg(1_800.0, 0.0),
    Leg(3_200.0, 0.0),
    Leg(4_600.0, 0.0),
    Leg(6_200.0, 0.0),
    Leg(7_400.0, 600.0),
    Leg(9_000.0, 600.0),
)
FENCE = ((1_600.0, 150.0), (2_900.0, 150.0), (2_900.0, 800.0), (1_600.0, 800.0))


def off_the_mission(row: Row) -> float:
    """Return how far a place is from the nearest leg of the nine items, m."""
    legs = [(item.east, item.north) for item in NINE]
    return min(_distance((row.x, row.y), a, b) for a, b in itertools.pairwise(legs))


def _distance(at: Any, a: Any, b: Any) -> float:
    along = (b[0] - a[0], b[1] - a[1])
    share = ((at[0] - a[0]) * along[0] + (at[1] - a[1]) * along[1]) / math.hypot(*along) ** 2
    share = min(max(share, 0.0), 1.0)
    return math.dist(at, (a[0] + share * along[0], a[1] + share * along[1]))


def test_a_mission_over_the_antimeridian_is_kept_from_traffic_and_fence_and_flown_on() -> None:
    """Nine items at 45 degrees south in wind, with a fence and two aircraft that come from the
    north and from ahead; 180 degrees lie between the third and the fourth waypoint.
    """
    speed = ground_speed(WIND, WIND_FROM)
    intruders = (Intruder(SOUTH, 25.0, 60.0, 0.0), Intruder(WEST, 20.0, 150.0, 0.0))
    home = (-45.0, 179.962, 520.0)
    encounter = Encounter(
        number=0,
        intruders=intruders,
        wind=WIND,
        wind_from=WIND_FROM,
        fence=FENCE,
        cruise=speed,
        goal=7_300.0,
        legs=NINE,
        home=home,
    )
    reached = list[int]()

    def note(sitl: Sitl, seconds: float, row: Row) -> None:
        current = sitl.station.messages.get("MISSION_CURRENT")
        if current is not None and reached[-1:] != [current.seq]:
            reached.append(current.seq)

    flight = fly(
        encounter, "ours_horizontal", instance=INSTANCE, until=360.0, watch=note, more=PATIENT
    )
    assert flight.separation >= SEPARATION and not flight.lost
    assert not flight.breached
    assert flight.taken_over >= 1 and flight.arrived is not None
    # Every item after the one at which AUTO went on is flown, in its order.
    assert (reached == sorted(reached) and reached[-2:] == [6, 7]) or reached[-3:] == [6, 7, 8]
    back = [
        row.time
        for row, after in itertools.pairwise(flight.rows)
        if row.mode == Mode.GUIDED and after.mode == Mode.AUTO
    ]
    assert len(back) == flight.taken_over
    later = [row for row in flight.rows if row.time > back[-1] + 30.0]
    assert later and max(map(off_the_mission, later)) < 60.0  # it rounds the waypoints


@pytest.mark.parametrize("both_ways", [True, False])
def test_after_a_link_that_was_cut_the_failsafes_auto_is_watched_and_taken_over_from(
    both_ways: bool,
) -> None:
    """While a plan is flown, both ways or to the autopilot alone; when it is back another aircraft
    comes from ahead, a minute away.
    """
    relay, cut, rows = Relay(PORT), dict[str, float](), list[Row]()
    apart = [math.inf]

    def interrupt(sitl: Sitl, seconds: float, row: Row) -> None:
        rows.append(row)
        if row.mode == Mode.GUIDED and seconds > 65.0 and not cut:
            cut["from"] = seconds
            relay.lose(to_program=both_ways, to_autopilot=True)
        elif row.mode == Mode.AUTO and "from" in cut and "auto" not in cut:
            cut["auto"] = seconds
        elif "auto" in cut and "to" not in cut and seconds > cut["auto"] + 5.0:
            cut["to"] = seconds
            relay.mend()
            meet.append(Oncoming(rows[-21], row))
        for intruder in meet:
            at = intruder.place(seconds)
            apart[0] = min(apart[0], math.dist(at, (row.x, row.y)))
            if seconds - cut.get("told", 0.0) >= 1.0:
                cut["told"] = seconds
                sitl.traffic(0xB00001, *at, intruder.track, intruder.speed, row.above)

    meet = list[Oncoming]()
    failsafe = {"FS_GCS_ENABL": 1, "MAV_GCS_SYSID": 245, "FS_LONG_ACTN": 4, "FS_LONG_TIMEOUT": 3}
    flight = fly(
        Encounter(0, (Intruder(SOUTH, 25.0, 60.0, 0.0),), 0.0, 300.0),
        "ours_horizontal",
        instance=INSTANCE,
        until=240.0,
        watch=interrupt,
        more=(*PATIENT, "--connect", relay.address),
        parameters=failsafe,
    )
    relay.cut()
    assert cut["from"] < cut["auto"] < cut["to"] < 100.0
    texts = [text for text in flight.texts if text.startswith("RLCAS")]
    assert not any("set by others" in text for text in texts), texts
    guided = [row.time for row in flight.rows if row.mode == Mode.GUIDED]
    assert max(guided) > cut["to"]
    assert min(apart[0], flight.separation) >= SEPARATION
    assert flight.rows[-1].mode == Mode.AUTO


class Oncoming:
    """An aircraft that comes along the way that has just been flown, a minute before they meet."""

    def __init__(self, before: Row, row: Row) -> None:
        east, north, seconds = row.x - before.x, row.y - before.y, row.time - before.time
        own, self.speed, self._began = math.hypot(east, north) / seconds, 18.0, row.time
        self._way = -east / math.hypot(east, north), -north / math.hypot(east, north)
        away = 60.0 * (own + self.speed)
        self._from = row.x - away * self._way[0], row.y - away * self._way[1]
        self.track = math.degrees(math.atan2(*self._way))

    def place(self, seconds: float) -> tuple[float, float]:
        """Return where it is, m."""
        flown = self.speed * (seconds - self._began)
        return self._from[0] + flown * self._way[0], self._from[1] + flown * self._way[1]
