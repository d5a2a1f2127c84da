"""One encounter flown by ArduPlane's simulation, and what came of it.

The simulation stands still while a plan is sought, so that a loaded machine changes nothing.
"""

import argparse
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from envs.formats.local_frame import LocalFrame
from ros_bridge.mavlink.clocks import Spent
from ros_bridge.mavlink.link import Link
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.options import options_of
from ros_bridge.mavlink.program import Program
from ros_bridge.mavlink.sitl import HOME, Leg, Sitl
from ros_bridge.mavlink.steering import Steered

SEPARATION, VERTICAL = 200.0, 50.0
"""m: closer than both at once is a loss."""

_AVOIDANCE = {
    "ADSB_TYPE": 1,
    "AVD_ENABLE": 1,
    "AVD_F_RCVRY": 1,  # back to what was flown before
    "AVD_F_TIME": 40,
    "AVD_F_DIST_XY": 250,
    "AVD_F_DIST_Z": 60,
    "AVD_W_TIME": 60,
    "AVD_W_DIST_XY": 500,
}
AVOIDANCES = {
    "climb": {**_AVOIDANCE, "AVD_F_ACTION": 2},
    "sideways": {**_AVOIDANCE, "AVD_F_ACTION": 3},
    "perpendicular": {**_AVOIDANCE, "AVD_F_ACTION": 4},
}
"""ArduPilot's own avoidance, and back to the mission: by height, horizontally, and both at once."""

_ABOVE_SEA = "--traffic-altitude", "msl"
KNOWN = "--unknown-position-std", "5", "--unknown-velocity-std", "0.2", *_ABOVE_SEA  # m, m/s
"""Options of the program where the traffic is known as a good receiver knows it, and above sea
level, which ADSB_VEHICLE cannot say. 5 m and 0.2 m/s are one sigma of NACp 10 and of NACv 4 (95 %
within 10 m and 0.3 m/s). Without them the program's defaults for what is unknown count.
"""

_BOTH = "--maneuvers", "both", "--vertical-separation", f"{VERTICAL:g}"
OURS = {
    "ours": (*KNOWN, *_BOTH),
    "ours_horizontal": KNOWN,
    "ours_altitude": (*_ABOVE_SEA, *_BOTH),
    "ours_unknown": (),
}
"""The program with --fly: with accuracies of the traffic that a good receiver gives, where plans
may climb and where they keep the height; where plans may climb, told nothing but what the traffic's
altitudes are above; and at its defaults.
"""

BEGIN, GOAL = 1_100.0, 6_000.0
"""m east of home: where the clock begins, and where the mission ends by default."""

_AT_GOAL = 60.0  # m before the goal, from which on it is reached
_BEYOND = 3_000.0  # m, from the goal to the mission's last waypoint
_WATCHING, _UNGUIDED = 3, 5  # reports of position in a step, where nothing of ours is flown
_LONGEST = 420.0  # s
_NEAR = 10.0  # m from the mission's height, within which the aircraft is at it
_TOO_LATE = 100.0  # m beyond the beginning, at which a flight cannot begin any more
_STILL = 15.0  # s of real time without a message, after which a flight has failed
_ABOVE = 620.0  # m above mean sea level
_BESIDE = 25.0  # m from the mission's legs, within which the aircraft is on them


class Intruder(NamedTuple):
    """An intruder: where it would be in the conflict, and how it comes there."""

    course: float  # rad counter-clockwise from east, at the conflict
    speed: float  # m/s
    cpa: float  # s after the start, at which it is nearest to the mission's aircraft
    miss: float  # m to the left of its own course, by which it passes
    turn_at: float = math.inf  # s after the start
    turn: float = 0.0  # rad
    turn_rate: float = 0.1  # rad/s
    climb: float = 0.0  # m/s
    level: float = 0.0  # m above the mission's height, at ``cpa``
    # s after the start, between which nobody reports it
    silence: tuple[float, float] = (math.inf, math.inf)

    def above(self, time: float) -> float:
        """Return its altitude at a time, s after the start, m above mean sea level."""
        return _ABOVE + self.level + self.climb * (time - self.cpa)


class Encounter(NamedTuple):
    """What is flown."""

    number: int
    intruders: tuple[Intruder, ...]
    wind: float  # m/s
    wind_from: float  # degrees
    turbulence: float = 0.0  # m/s
    fence: tuple[tuple[float, float], ...] = ()  # m east and north of home
    keep_in: bool = False  # whether the fence is to be stayed in, or kept out of
    cruise: float = 22.0  # of the mission over the ground, m/s: by it the intruders come
    goal: float = GOAL  # m east of home
    legs: tuple[Leg, ...] = ()  # of the mission after its item 1; (): straight to the goal and on
    home: tuple[float, float, float] = HOME  # latitude and longitude, degrees, and height, m


class Row(NamedTuple):
    """The state at a moment, s after the start; m and m/s."""

    time: float
    x: float
    y: float
    above: float
    airspeed: float
    speed: float
    mode: int


class Result(NamedTuple):
    """What came of a flight."""

    rows: tuple[Row, ...]
    separation: float  # smallest horizontal distance at the same height, m
    lost: bool
    breached: bool  # whether it violated the fence
    arrived: float | None  # s; None: not in time
    on_mission: float  # s in AUTO
    on_track: float  # s on the mission's legs, as seen from above
    at_height: float  # s at the mission's height
    path: float  # m
    steered: tuple[Steered, ...]  # what our follower was at and told, each period
    taken_over: int  # how often
    texts: tuple[str, ...]
    planned: tuple[Spent, ...]  # what our plans took from their requests


def place_of(intruder: Intruder, time: float, cruise: float) -> tuple[float, float, float]:
    """Return x, y, m, and the course of an intruder, rad, at a time."""
    x, y = BEGIN + cruise * intruder.cpa, 0.0
    cosine, sine = math.cos(intruder.course), math.sin(intruder.course)
    x, y = x - intruder.miss * sine, y + intruder.miss * cosine
    if time <= intruder.turn_at:
        way = intruder.speed * (time - intruder.cpa)
        return x + way * cosine, y + way * sine, intruder.course
    flown = intruder.speed * (intruder.turn_at - intruder.cpa)
    x, y = x + flown * cosine, y + flown * sine
    turned = math.copysign(
        min(abs(intruder.turn), intruder.turn_rate * (time - intruder.turn_at)), intruder.turn
    )
    radius = math.copysign(intruder.speed / intruder.turn_rate, intruder.turn)
    course = intruder.course + turned
    x += radius * (math.sin(course) - sine)
    y -= radius * (math.cos(course) - cosine)
    straight = intruder.speed * max(
        time - intruder.turn_at - abs(intruder.turn) / intruder.turn_rate, 0.0
    )
    return x + straight * math.cos(course), y + straight * math.sin(course), course


def apart(row: Row, intruder: Intruder, cruise: float) -> float:
    """Return the horizontal distance to an intruder at a row of a flight, m."""
    return math.dist((row.x, row.y), place_of(intruder, row.time, cruise)[:2])


def fly(  # noqa: PLR0913 - all that a flight is
    encounter: Encounter,
    method: str,
    *,
    instance: int = 7,
    speedup: float = 20.0,
    until: float = _LONGEST,
    more: Sequence[str] = (),
    watch: Callable[[Sitl, float, Row], None] | None = None,
    parameters: Mapping[str, float] = MappingProxyType({}),
    stall: float = math.inf,
) -> Result:
    """Fly an encounter.

    Args:
        encounter: what is flown.
        method: ``mission``, or a name of :data:`OURS` or :data:`AVOIDANCES`.
        instance: of the simulation.
        speedup: times real time at most.
        until: s, after which the flight ends.
        more: options of the program.
        watch: called with each row.
        parameters: of the autopilot, set before its start.
        stall: s of its time that the simulation may go on unseen, on a machine that is busy.

    Raises:
        RuntimeError: it went on unseen for longer, or says nothing any more.
    """
    all_parameters = {
        **parameters,
        "SIM_WIND_SPD": encounter.wind,
        "SIM_WIND_DIR": encounter.wind_from,
        "SIM_WIND_TURB": encounter.turbulence,
        **AVOIDANCES.get(method, {}),
    }
    frame = LocalFrame(encounter.home[0], encounter.home[1])
    with Sitl(instance, speedup, all_parameters, encounter.home) as sitl:
        sitl.upload([Leg(100.0, 0.0, 60.0, 22, 15.0), *_legs(encounter)])
        if encounter.fence:
            sitl.upload_fence(encounter.fence, keep_in=encounter.keep_in)
        sitl.take_off()
        sitl.rate(33, 1e5)  # GLOBAL_POSITION_INT
        sitl.rate(74, 1e5)  # VFR_HUD
        sitl.rate(0, 2e5)  # HEARTBEAT
        program = None
        if method in OURS:
            sitl.set("SIM_SPEEDUP", 1.0)  # it goes on while the program begins
            program = program_beside(sitl, more, OURS[method])
            sitl.set("SIM_SPEEDUP", speedup)
        try:
            return _fly(encounter, sitl, program, frame, until, watch, stall)
        finally:
            if program is not None:
                program.close()


def program_beside(sitl: Sitl, more: Sequence[str] = (), traffic: Sequence[str] = KNOWN) -> Program:
    """Return the program with --fly beside a simulation, with options that say how exactly the
    traffic is known, and more options; --connect may be one of them.
    """
    words = f"--simulated --fly --quiet --separation {SEPARATION:g}"
    address = [] if "--connect" in more else ["--connect", sitl.address]
    options: argparse.Namespace = options_of([*words.split(), *traffic, *address, *more])
    link = Link(options.connect, system=options.system, simulated=True)
    program = Program(link, options)
    program.show()
    return program


def _positions(program: Program | None) -> int:
    """Return after how many reports of its position the simulation is to stand still."""
    if program is None:
        return _UNGUIDED
    return 1 if program.view.control.flies else _WATCHING


def advance(sitl: Sitl, positions: int) -> list[Any]:
    """Let the simulation go on until it has reported its position so often, and return what it has
    sent.
    """
    with sitl.awake():
        messages = [sitl.station.recv_match(blocking=True, timeout=0.05)]
        until = time.monotonic() + 0.2 * positions
        while positions and time.monotonic() < until:
            message = sitl.station.recv_match(blocking=True, timeout=0.005)
            messages.append(message)
            positions -= message is not None and message.get_type() == "GLOBAL_POSITION_INT"
    messages += iter(sitl.station.recv_match, None)  # what is there, until it is None
    return [message for message in messages if message is not None]


class _Log:
    """What the simulation has reported of a flight."""

    def __init__(self, encounter: Encounter, frame: LocalFrame) -> None:
        self.rows: list[Row] = []
        self.texts: list[str] = []
        self.arrived: float | None = None  # at the goal, s; None: not yet
        self._encounter, self._frame = encounter, frame
        self._began: float | None = None  # on the simulation's clock, s; None: not yet
        self._airspeed, self._mode = 0.0, -1
        self._long: dict[tuple[int, int], int] = {}  # where texts stand, by sender and number

    def take(self, message: Any) -> Row | None:
        """Take in a message, and return the row that it completes; None: none."""
        kind = message.get_type()
        if kind == "VFR_HUD":
            self._airspeed = message.airspeed
        elif kind == "HEARTBEAT" and message.get_srcComponent() == 1:
            self._mode = message.custom_mode
        elif kind == "STATUSTEXT":
            self._take_text(message)
        elif kind == "GLOBAL_POSITION_INT":
            return self._take_position(message)
        return None

    def over(self, until: float) -> bool:
        """Return whether the flight has arrived, or lasted longer than ``until``, s."""
        return bool(self.rows) and (self.rows[-1].time > until or self.arrived is not None)

    def _take_text(self, message: Any) -> None:
        """Take in a text, or a further part of a long one, which has the same number."""
        number = message.get_srcSystem(), message.id
        if message.chunk_seq and number in self._long:
            self.texts[self._long[number]] += message.text
        else:
            self._long[number] = len(self.texts)
            self.texts.append(message.text)

    def _take_position(self, message: Any) -> Row | None:
        at = self._frame.place(1e-7 * message.lat, 1e-7 * message.lon)
        x, y, clock = float(at.x), float(at.y), 1e-3 * message.time_boot_ms
        if self._began is None and x >= BEGIN + _TOO_LATE:
            raise RuntimeError(f"encounter {self._encounter.number}: it was {x:.0f} m on its way")
        if self._began is None and x >= BEGIN:
            self._began = clock
        if self._began is None:
            return None
        seconds, speed = clock - self._began, 0.01 * math.hypot(message.vx, message.vy)
        row = Row(seconds, x, y, 1e-3 * message.alt, self._airspeed, speed, self._mode)
        self.rows.append(row)
        if self.arrived is None and x >= self._encounter.goal - _AT_GOAL:
            self.arrived = seconds
        return row


def _fly(
    encounter: Encounter,
    sitl: Sitl,
    program: Program | None,
    frame: LocalFrame,
    until: float,
    watch: Callable[[Sitl, float, Row], None] | None,
    stall: float,
) -> Result:
    log = _Log(encounter, frame)
    traffic_sent_at, heard_at = -1.0, time.monotonic()
    while not log.over(until):
        sitl.beat()
        if program is not None:
            program.turn(0.0)
        before = log.rows[-1].time if log.rows else 0.0
        for message in advance(sitl, _positions(program)):
            heard_at = time.monotonic()
            row = log.take(message)
            if row is None:
                continue
            if row.time - before > stall:
                raise RuntimeError(f"encounter {encounter.number}: the machine is too busy")
            if row.time - traffic_sent_at >= 1.0:
                traffic_sent_at = row.time
                _traffic(encounter, sitl, row.time)
            if watch is not None:
                watch(sitl, row.time, row)
        if time.monotonic() - heard_at > _STILL:
            raise RuntimeError(f"encounter {encounter.number}: the simulation says nothing")
    return _judge(encounter, log, program)


def _traffic(encounter: Encounter, sitl: Sitl, seconds: float) -> None:
    """Send where the intruders are."""
    for number, intruder in enumerate(encounter.intruders):
        if intruder.silence[0] <= seconds < intruder.silence[1]:
            continue
        x, y, course = place_of(intruder, seconds, encounter.cruise)
        track = 90.0 - math.degrees(course)
        above = intruder.above(seconds)
        sitl.traffic(0xA00001 + number, x, y, track, intruder.speed, above, intruder.climb)


def _judge(encounter: Encounter, log: _Log, program: Program | None) -> Result:
    rows, fence = log.rows, encounter.fence
    least, lost = math.inf, False
    for row in rows:
        for intruder in encounter.intruders:
            distance = apart(row, intruder, encounter.cruise)
            if abs(row.above - intruder.above(row.time)) < VERTICAL:
                least = min(least, distance)
                lost = lost or distance < SEPARATION
    pairs = list(itertools.pairwise(rows))
    return Result(
        rows=tuple(rows),
        separation=least,
        lost=lost,
        breached=bool(fence)
        and any(_inside(row.x, row.y, fence) is not encounter.keep_in for row in rows),
        arrived=log.arrived,
        on_mission=sum(b.time - a.time for a, b in pairs if a.mode == Mode.AUTO),
        on_track=sum(b.time - a.time for a, b in pairs if off_track(encounter, a) <= _BESIDE),
        at_height=sum(b.time - a.time for a, b in pairs if abs(a.above - _ABOVE) <= _NEAR),
        path=sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairs),
        steered=() if program is None else tuple(program.steered),
        taken_over=sum(a.mode != Mode.GUIDED and b.mode == Mode.GUIDED for a, b in pairs),
        texts=tuple(log.texts),
        planned=() if program is None else tuple(program.planned),
    )


def _legs(encounter: Encounter) -> tuple[Leg, ...]:
    """Return the mission after its item 1."""
    goal = encounter.goal
    return encounter.legs or (Leg(400.0, 0.0), Leg(goal, 0.0), Leg(goal + _BEYOND, 0.0))


def off_track(encounter: Encounter, row: Row) -> float:
    """Return how far a row of a flight is from the mission's legs, as seen from above, m."""
    places = [(leg.east, leg.north) for leg in _legs(encounter)]
    return min(_off_leg((row.x, row.y), a, b) for a, b in itertools.pairwise(places))


def _off_leg(
    place: tuple[float, float], begin: tuple[float, float], end: tuple[float, float]
) -> float:
    """Return how far a place is from a leg, m."""
    x, y = end[0] - begin[0], end[1] - begin[1]
    along = ((place[0] - begin[0]) * x + (place[1] - begin[1]) * y) / max(x * x + y * y, 1e-9)
    along = min(max(along, 0.0), 1.0)
    return math.dist(place, (begin[0] + along * x, begin[1] + along * y))


def _inside(x: float, y: float, polygon: Sequence[tuple[float, float]]) -> bool:
    """Return whether a point is inside a polygon: a ray from it crosses an odd number of edges."""
    crossings = sum(
        (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
        for a, b in itertools.pairwise((*polygon, polygon[0]))
    )
    return crossings % 2 == 1
