"""Recordings to look at again: MCAP files of the graph, and encounters that ``eval.report --save``
wrote.
"""

import bisect
import json
import math
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from commands.command import InputError
from commands.json_text import RepeatedKeyError, parse_json
from envs.areas import Keep
from envs.arrays import Float
from ros_bridge.core.fields import SECOND
from ros_bridge.display.aircraft import velocity_through_air
from ros_bridge.display.document import Document, to_json
from ros_bridge.display.draw import by_level, draw
from ros_bridge.display.picture import (
    NO_THREAT,
    DrawnAlert,
    DrawnArea,
    DrawnBands,
    DrawnIntruder,
    DrawnOwnship,
    DrawnPlan,
    DrawnPlane,
    DrawnPoint,
    Outline,
    Picture,
    Tape,
    Threat,
    WayOut,
)
from ros_bridge.display.scene import INPUTS, DisplayScene, clock_of, note, take

__all__ = ["FlightRecording", "GraphRecording", "read"]

_KEPT = 100  # scenes that are kept to begin from
_VIEWS = ("/output/path", "/output/markers")  # the plan again, for other viewers
_APART = 5.0  # s between two of them at least


class _Message(NamedTuple):
    time: float  # s from the beginning
    name: str  # of INPUTS, or "" for one that is not shown
    topic: str
    kind: str
    decode: Callable[[bytes], Any] | None
    data: bytes


class _Moment(NamedTuple):
    """What is known after some messages."""

    message_count: int  # so far
    time: float  # of the last of them, s from the beginning
    clock: int  # of the clock at that time, ns
    scene: DisplayScene


def read(path: Path, separation: float | None = None) -> "GraphRecording | FlightRecording":
    """Return a recording, or raise ``InputError``; the separation, m, where the file has none."""
    if not path.is_file():
        problem = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"{path} {problem}, expected a recording (.mcap) or an encounter (.json)")
    if path.suffix == ".json":
        return FlightRecording(path)
    return GraphRecording(path, separation)


class GraphRecording:
    """An MCAP file of the graph, in memory; ``cut`` says where it is cut, "" where it is not."""

    def __init__(self, path: Path, separation: float | None = None) -> None:
        self.name = path.name
        self._messages, self.cut = _contents(path)
        self._messages.sort(key=lambda message: message.time)
        if not any(message.name for message in self._messages):
            raise InputError(f"{path} holds no message of {', '.join(INPUTS)}")
        self.length = self._messages[-1].time
        self._times = [message.time for message in self._messages]
        self.marks: list[tuple[float, int]] = []
        step = max(_APART, self.length / _KEPT)
        scene = DisplayScene(separation=separation)
        if self.cut:
            scene = note(scene, "recording", self.cut, self._first_clock())
        moment = _Moment(0, 0.0, self._first_clock(), scene)
        self._moments = [moment]
        previous = 0
        for count in range(1, len(self._messages) + 1):
            moment = self._advance(moment, count)
            guidance = moment.scene.guidance
            threats = (
                [] if guidance is None else [*guidance.levels.values(), *guidance.areas.values()]
            )
            highest = max((level for level, _ in threats), default=0)
            if highest != previous:
                previous = highest
                self.marks.append((round(moment.time, 3), highest))
            if moment.time >= self._moments[-1].time + step:
                moment = moment._replace(scene=moment.scene.at(moment.clock))
                self._moments.append(moment)

    def _first_clock(self) -> int:
        """Return what the recording's clock shows at its beginning, ns; 0: it has none."""
        ticks = (
            message
            for message in self._messages
            if message.name == "/clock" and message.decode is not None
        )
        first = next(ticks, None)
        if first is None or first.decode is None:
            return 0
        return clock_of(first.decode(first.data)) - round(first.time * SECOND)

    def player(self) -> Callable[[float], Picture]:
        """Return what gives the picture of a time, s from the beginning."""
        moment = self._moments[0]

        def show(time: float) -> Picture:
            nonlocal moment
            count = bisect.bisect_right(self._times, time)
            place = (
                bisect.bisect_right(self._moments, count, key=lambda moment: moment.message_count)
                - 1
            )
            nearest = self._moments[place]
            if not nearest.message_count <= moment.message_count <= count:
                moment = nearest
            moment = self._advance(moment, count)
            clock = moment.clock + round((time - moment.time) * SECOND)
            return draw(moment.scene, max(clock, moment.scene.latest))

        return show

    def _advance(self, moment: _Moment, count: int) -> _Moment:
        """Return what is known after so many messages, as many or more as before."""
        first, _, clock, scene = moment
        time = moment.time
        for entry in self._messages[first:count]:
            # The clock of the recording goes on between its ticks.
            clock += round((entry.time - time) * SECOND)
            time = entry.time
            if entry.topic.endswith(_VIEWS):
                continue
            if entry.decode is None:
                scene = note(scene, entry.topic, f"{entry.kind} is not shown", clock)
                continue
            try:
                message = entry.decode(entry.data)
            except Exception as error:  # whatever a decoder makes of bytes that are no message
                scene = note(scene, entry.topic, f"cannot be read: {error or error!r}", clock)
                continue
            if entry.name == "/clock":
                clock = clock_of(message)
            elif clock == 0:
                clock = _stamp_of(message)
            scene = take(scene, entry.name, message, clock)
        return _Moment(count, time, clock, scene)


def _stamp_of(message: Any) -> int:
    """Return the time of a message that comes before any clock, ns; 0 without one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else stamp.sec * SECOND + stamp.nanosec


class _Contents(NamedTuple):
    """What a file holds."""

    messages: list[_Message]
    cut: str  # a sentence where only its beginning is whole; "": all of it is


def _contents(path: Path) -> _Contents:
    """Return the messages of a file up to where it is cut or damaged, or raise ``InputError`` where
    none is whole.
    """
    messages: list[_Message] = []
    try:
        with path.open("rb") as stream:
            messages.extend(_messages(stream))
    except OSError as problem:
        raise InputError(f"{path} cannot be read: {problem.strerror}") from problem
    except ModuleNotFoundError:
        raise
    except Exception as problem:  # whatever the libraries make of bytes that are no file
        if not messages:
            expectation = "expected one with a message that is whole"
            raise InputError(f"{path} is no whole MCAP file, {expectation}") from problem
        length = messages[-1].time
        return _Contents(messages, f"{path.name} is cut or damaged {length:.1f} s after its start")
    return _Contents(messages, "")


def _messages(stream: BinaryIO) -> Iterator[_Message]:
    """Yield the messages of a stream in their order in it."""
    from mcap.reader import NonSeekingReader
    from mcap_ros2.decoder import DecoderFactory

    factory, decoders, begin = DecoderFactory(), dict[int, Any](), None
    # Without the summary at its end, which a file that is cut has lost.
    for schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
        begin = message.log_time if begin is None else begin
        name = next((known_name for known_name in INPUTS if _is(channel.topic, known_name)), "")
        kind = "a message without a type" if schema is None else schema.name
        name = name if name and INPUTS[name].kind == kind else ""
        if name and channel.id not in decoders:
            with redirect_stderr(StringIO()):  # the library prints what it also raises
                decode = factory.decoder_for(channel.message_encoding, schema)
            decoders[channel.id] = decode
        decode = decoders.get(channel.id)
        time = (message.log_time - begin) / SECOND
        yield _Message(time, name, channel.topic, kind, decode, message.data)


def _is(topic: str, name: str) -> bool:
    """Return whether a topic is that of an input, in any namespace."""
    return topic == name or topic.endswith(f"/{name.lstrip('/')}")


class FlightRecording:
    """An encounter of an evaluation, as ``python -m eval.report --save`` writes it
    (docs/reference/display.md).
    """

    cut = ""  # it is whole, or refused

    def __init__(self, path: Path) -> None:
        try:
            document = parse_json(path.read_text(encoding="utf-8"))
            kind = document["format"], document["version"]
        except RepeatedKeyError as problem:
            raise InputError(f"{path}: {problem}, expected an encounter with it once") from None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            document, kind = {}, None
        if kind != ("rlcas-encounter", 1):
            raise InputError(f"{path} is no encounter, expected a file of eval.report --save")
        try:
            with np.errstate(all="ignore"):  # what is too large is refused below
                self._load(document)
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as problem:
            raise InputError(f"{path} is no whole encounter: {problem!r}") from problem

    def _load(self, document: Document) -> None:
        self.name = str(document["name"])
        self._dt = float(document["dt"])
        self._document = document
        own = document["own"]
        self._planes = np.array(
            [[aircraft["x"], aircraft["y"]] for aircraft in (own, *document["intruders"])]
        )
        steps = self._planes.shape[2]
        if steps < 2 or not (self._dt > 0.0 and np.isfinite(self._planes).all()):
            raise ValueError("places are not finite, or fewer than two")
        self.length = (steps - 1) * self._dt
        self._separation = float(document["separation"])
        self._separations = [
            float(intruder["separation"]) if "separation" in intruder else None
            for intruder in document["intruders"]
        ]
        self._goal = [float(coordinate) for coordinate in document["goal"]]
        self._bands = document["bands"]
        wind = document.get("wind")
        self._wind = None if wind is None else (float(wind[0]), float(wind[1]))
        for step in range(steps):  # nothing that cannot be sent is met while it is shown
            json.dumps(to_json(self._picture(step * self._dt)), allow_nan=False)
        self.marks: list[tuple[float, int]] = []
        previous = 0
        for step, levels in enumerate([] if self._bands is None else self._bands["level"]):
            highest = max(levels, default=0)
            if highest != previous:
                self.marks.append((step * self._dt, highest))
                previous = highest

    def player(self) -> Callable[[float], Picture]:
        """Return what gives the picture of a time, s from the beginning."""
        return self._picture

    def _picture(self, time: float) -> Picture:
        step = min(int(time / self._dt), self._planes.shape[2] - 2)
        own, *traffic = self._planes_at(step, time)
        row = None if self._bands is None else min(step, self._last_band())
        threats = [self._threat(row, number) for number in range(len(traffic))]
        alerts = [
            DrawnAlert(plane.id, "intruder", threat)
            for plane, threat in zip(traffic, threats, strict=True)
        ]
        return Picture(
            time=round(time, 3),
            own=DrawnOwnship(own, velocity_through_air(own.vx, own.vy, self._wind)),
            traffic=[
                DrawnIntruder(plane, threat, separation=separation)
                for plane, threat, separation in zip(
                    traffic, threats, self._separations, strict=True
                )
            ],
            separation=self._separation,
            wind=self._wind,
            plan=self._plan(time),
            goal=(*self._goal, float(self._document["goal_radius"])),
            areas=[_area_at(area, time) for area in self._document.get("areas", [])],
            bands=None if row is None else self._bands_at(row),
            alerts=by_level(alerts),
        )

    def _planes_at(self, step: int, time: float) -> list[DrawnPlane]:
        """Return the aircraft, the ownship first, on the leg of a time step at a time, s."""
        before, after = self._planes[:, :, step], self._planes[:, :, step + 1]
        speed = (after - before) / self._dt
        place = before + speed * (time - step * self._dt)
        return [
            _plane("ownship" if k == 0 else f"intruder {k}", place[k], speed[k])
            for k in range(len(place))
        ]

    def _threat(self, row: int | None, number: int) -> Threat:
        """Return what the bands of a row say of an intruder; None: there are no bands."""
        if row is None:
            return NO_THREAT
        return Threat(self._bands["level"][row][number], self._bands["loss"][row][number])

    def _last_band(self) -> int:
        return len(self._bands["track_region"]) - 1

    def _bands_at(self, row: int) -> DrawnBands:
        bands = self._bands
        track_area, speed_area = (
            bands[name][row] if name in bands else None for name in ("track_area", "speed_area")
        )
        index, after, shortfall = bands["recovery"][row]
        way_out = WayOut(bands["track_deg"][index], after, shortfall)
        return DrawnBands(
            age=0.0,
            look_ahead=bands["look_ahead"],
            tracks=Tape(bands["track_deg"], bands["track_region"][row], track_area),
            speeds=Tape(bands["speed"], bands["speed_region"][row], speed_area),
            areas=[area["name"] for area in self._document.get("areas", [])],
            recovery=None if index < 0 else way_out,
        )

    def _plan(self, time: float) -> DrawnPlan | None:
        plan = self._document["plan"]
        if plan is None:
            return None
        line = [list(point) for point in zip(plan["x"], plan["y"], plan["time"], strict=True)]
        points = [
            DrawnPoint(number, x, y, round(at - time, 1)) for number, (x, y, at) in enumerate(line)
        ]
        return DrawnPlan(revision=0, began=0.0, line=line, points=points)


def _area_at(area: Document, time: float) -> DrawnArea:
    """Return an area to be kept out of as it is at a time, s."""
    moved = np.multiply(area["velocity"], time)
    return DrawnArea(
        name=str(area["name"]),
        keep=Keep.OUT,
        valid=True,
        clearance=float(area["clearance"]),
        shape=Outline([(np.array(ring) + moved).round(1).tolist() for ring in area["rings"]]),
    )


def _plane(
    name: str, place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"]
) -> DrawnPlane:
    return DrawnPlane(
        id=name,
        callsign="",
        x=round(float(place[0]), 1),
        y=round(float(place[1]), 1),
        vx=round(float(velocity[0]), 2),
        vy=round(float(velocity[1]), 2),
        track_deg=round(math.degrees(math.atan2(velocity[0], velocity[1])) % 360.0, 1),
        speed=round(float(np.hypot(*velocity)), 1),
    )
