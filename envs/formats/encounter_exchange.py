"""Encounters on their way between files: what a file of ours, of Lincoln Laboratory and of DAIDALUS
can hold of them.

| | ours (.csv) | Lincoln Laboratory's (.json) | DAIDALUS' (.daa, .xyz) |
|---|---|---|---|
| encounters | many | many | one |
| intruders | many | one | many |
| their motion | straight, or one turn | rates and accelerations | positions, velocities |
| the ownship's motion | none | as the intruder's | as the intruders' |
| goal, noise | yes | no | no |
| altitudes | no | yes | yes |

Numbers are exact where the form has them. Motion is turned into events or into a row a second.
:func:`check_same` holds what a reader makes of a written file against what went in: an encounter
that another form cannot hold within :data:`EXACT` is refused.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from envs import intruder
from envs.encounters import Encounter, EncounterError
from envs.formats.encounter_file import Row
from envs.formats.lincoln_file import EVENTS
from envs.frames import Air
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.traffic.track_units import FOOT
from envs.traffic.tracks import Track, at_times
from envs.trees import take

EXACT = 1.0  # m


class ExchangedEncounter(NamedTuple):
    """One encounter on its way between files."""

    name: str
    tracks: tuple[Track, ...]  # the ownship's first; a row a second
    goal: tuple[float, float] | None  # m; None where the form has none
    intents: tuple[Intent, ...] | None  # of each intruder; None where the form has none
    sensor: Sensor = Sensor(0.0, 0.0, 0.0)
    altitudes: bool = True  # whether they are known; otherwise those of the tracks are 0
    weight: float = 1.0
    left_out: Mapping[str, int] = {}
    """How many rows or values of the recorded tracks are not in these, by kind."""

    def straight(self, number: int) -> bool:
        """Return whether an aircraft flies straight on at its first speed, within :data:`EXACT`."""
        track = self.tracks[number]
        off = np.hypot(
            track.x - track.x[0] - track.vx[0] * track.time,
            track.y - track.y[0] - track.vy[0] * track.time,
        )
        return bool(off.max() <= EXACT)


def scenes_of(
    encounters: Encounter, names: Sequence[str], seconds: int
) -> list[ExchangedEncounter]:
    """Return encounters of ours ``[N]``, flown for some seconds: the ownship straight on, the
    intruders their turns.
    """
    times = np.arange(seconds + 1.0)
    flying = intruder.start(encounters.intruders, np)
    states = [flying.vehicle]
    for second in range(seconds):
        flying = intruder.step(flying, encounters.intent, float(second), 1.0, np)
        states.append(flying.vehicle)
    intruders: VehicleState[Air] = VehicleState(
        *(np.stack(field) for field in zip(*states, strict=True))
    )
    own, ahead = encounters.own, encounters.own.speed * times[:, None]
    x, y = own.x + ahead * np.cos(own.heading), own.y + ahead * np.sin(own.heading)
    straight: VehicleState[Air] = VehicleState(
        x, y, *(np.broadcast_to(field, ahead.shape) for field in (own.heading, own.speed))
    )
    scenes = []
    for i, name in enumerate(names):
        members = np.flatnonzero(encounters.mask[i]).tolist()
        tracks = [_track("ownship", take(straight, np.s_[:, i]), times)]
        tracks += [
            _track(f"intruder{n}", take(intruders, np.s_[:, i, k]), times)
            for n, k in enumerate(members, start=1)
        ]
        goal = float(encounters.goal_x[i]), float(encounters.goal_y[i])
        intents = tuple(
            Intent(*(float(field[i, k]) for field in encounters.intent)) for k in members
        )
        sensor = Sensor(*(float(field[i, 0]) for field in encounters.sensor))
        scenes.append(
            ExchangedEncounter(name, tuple(tracks), goal, intents, sensor, altitudes=False)
        )
    return scenes


def scenes_of_tracks(
    encounters: Sequence[tuple[str, Sequence[Track], float]],
) -> list[ExchangedEncounter]:
    """Return recorded encounters, name, tracks and weight each, with a row a second from the
    ownship's first on.

    Raises:
        EncounterError: a track begins later than the ownship's, or none lasts a second.
    """
    scenes = []
    for name, tracks, weight in encounters:
        begin, end = tracks[0].time[0], min(track.time[-1] for track in tracks)
        late = next((track for track in tracks if track.time[0] > begin), None)
        if late is not None or end - begin < 1.0:
            subject = "a track" if late is None else f"the track of {late.name!r}"
            raise EncounterError(
                f"encounter {name!r}: {subject} does not cover the ownship's first second"
            )
        times = np.minimum(np.arange(begin, end + 1e-6), end)
        rows = [at_times(track, times)._replace(time=times - begin, extra={}) for track in tracks]
        outside = sum(
            int(np.sum((track.time < begin) | (track.time > times[-1] + 1e-6))) for track in tracks
        )
        columns = sorted({column for track in tracks for column in track.extra})
        left_out = {"rows at times that not all tracks cover": outside}
        left_out |= {
            f"values of column {column}": sum(len(track.time) for track in tracks)
            for column in columns
        }
        scenes.append(
            ExchangedEncounter(name, tuple(rows), None, None, weight=weight, left_out=left_out)
        )
    return scenes


def rows_of_scenes(scenes: Sequence[ExchangedEncounter], ahead: float) -> list[list[Row]]:
    """Return scenes as rows of :func:`envs.formats.encounter_file.write_rows`.

    Where a form has no goal, it lies some seconds ahead. Intruders whose intent is not known fly
    straight on: whether that is their motion is for :func:`check_same`.
    """
    groups = []
    for scene in scenes:
        own, *intruders = map(_start, scene.tracks)
        goal = scene.goal
        if goal is None:
            reach = ahead * own.speed
            goal = own.x + reach * math.cos(own.heading), own.y + reach * math.sin(own.heading)
        intents = scene.intents or [Intent(0.0, 0.0, math.radians(3.0))] * len(intruders)
        groups.append(
            [
                Row(own, goal[0], goal[1], intruder, intent, scene.sensor)
                for intruder, intent in zip(intruders, intents, strict=True)
            ]
        )
    return groups


def check_same(
    scenes: Sequence[ExchangedEncounter],
    again: Sequence[ExchangedEncounter],
    *,
    own: bool = True,
    altitudes: bool = True,
) -> None:
    """Raise an EncounterError where scenes that were written and read again are not the same within
    :data:`EXACT`.

    ``own`` and ``altitudes`` say whether the ownship's motion and the altitudes are compared.
    """
    if [len(scene.tracks) for scene in scenes] != [len(scene.tracks) for scene in again]:
        raise EncounterError(
            f"{len(scenes)} encounters, of which {len(again)} are read again, or other aircraft"
        )
    for scene, reread in zip(scenes, again, strict=True):
        for track, copy in list(zip(scene.tracks, reread.tracks, strict=True))[0 if own else 1 :]:
            rows = min(len(track.time), len(copy.time))
            fields = ("x", "y", "altitude") if altitudes and scene.altitudes else ("x", "y")
            apart = [getattr(track, field)[:rows] - getattr(copy, field)[:rows] for field in fields]
            off = float(np.sqrt(np.sum(np.square(apart), axis=0)).max())
            if off > EXACT or rows < len(track.time):
                raise EncounterError(
                    f"encounter {scene.name!r}: this form does not hold {track.name!r}: "
                    f"{off:.1f} m off its track for {rows} of {len(track.time)} s, expected at "
                    f"most {EXACT:g} m"
                    f"{_contradiction(track)}"
                )


def _contradiction(track: Track) -> str:
    """Return in words how far a track's velocities lead from its own positions; "" within
    :data:`EXACT`.
    """
    steps = np.diff(track.time)
    led = [np.cumsum(0.5 * (speed[1:] + speed[:-1]) * steps) for speed in (track.vx, track.vy)]
    x, y = track.x[1:] - track.x[0], track.y[1:] - track.y[0]
    off = np.hypot(led[0] - x, led[1] - y)
    last = int(off.argmax())
    if not off[last] > EXACT:
        return ""
    flown, integrated = (
        float(np.hypot(*way)) for way in ((x[last], y[last]), (led[0][last], led[1][last]))
    )
    return (
        f": in {track.time[last + 1] - track.time[0]:.0f} s its positions lead {flown:.0f} m away "
        f"and its velocities {integrated:.0f} m, as where latitudes and longitudes were made on a "
        "sphere, as DAIDALUS makes them, and are read on WGS-84"
    )


def lincoln_objects(
    scenes: Sequence[ExchangedEncounter], altitude: float | None
) -> list[dict[str, Any]]:
    """Return scenes in the form of Lincoln Laboratory's files; ``altitude`` (m) is that of scenes
    that have none.

    Raises:
        EncounterError: a scene has more than one intruder or no altitude.
    """
    names = [scene.name for scene in scenes]
    # Names that are numbers are kept; where some are not, all come back as places in the file.
    numbers = range(1, len(names) + 1)
    if all(map(is_number, names)):
        numbers = [int(name) for name in names]
    return [
        _lincoln(number, scene, altitude) for number, scene in zip(numbers, scenes, strict=True)
    ]


def is_number(name: str) -> bool:
    """Return whether a name can be an encounter's number in Lincoln Laboratory's form."""
    return name.isascii() and name.isdecimal() and len(name) <= 12 and str(int(name)) == name


def _lincoln(number: int, scene: ExchangedEncounter, altitude: float | None) -> dict[str, Any]:
    """Return a scene as an object of Lincoln Laboratory's files."""
    if len(scene.tracks) != 2:
        raise EncounterError(
            f"encounter {scene.name!r} has {len(scene.tracks) - 1} intruders, expected one, "
            "because a .json file holds two aircraft"
        )
    tracks = _at_height(scene, altitude)
    states = [_lincoln_state(track) for track in tracks]
    return {
        "id": number,
        "n_ft": [float(track.y[0]) / FOOT for track in tracks],
        "e_ft": [float(track.x[0]) / FOOT for track in tracks],
        "h_ft": [float(track.altitude[0]) / FOOT for track in tracks],
        "v_ftps": [state.speed / FOOT for state in states],
        "heading_rad": [state.course for state in states],
        "runTime_s": float(tracks[0].time[-1]),
        EVENTS: [state.events.tolist() for state in states],
        "meta": {"w": scene.weight},
    }


class _LincolnState(NamedTuple):
    """How an aircraft begins, and what it is commanded."""

    speed: float  # along the path, m/s
    course: float  # rad, clockwise from north
    events: np.ndarray  # [E, 4] in the file's units


def _lincoln_state(track: Track) -> _LincolnState:
    """Return the beginning and the events of a track with a row a second."""
    ground = np.hypot(track.vx, track.vy)
    course = np.unwrap(_course(track))
    rate = track.vertical_rate
    along = np.hypot(ground, rate)
    rows = np.stack(
        [track.time[:-1], rate[:-1] / FOOT, np.diff(course), np.diff(along) / FOOT], axis=1
    )
    # An event holds until the next: rows that command the same again are left out.
    changes = np.concatenate([[True], np.any(np.abs(np.diff(rows[:, 1:], axis=0)) > 1e-12, axis=1)])
    return _LincolnState(float(along[0]), float(course[0]), rows[changes])


def _course(track: Track) -> np.ndarray:
    """Return the course of each row, clockwise from north, rad; a row that stands still has that of
    the last one that moved, or of the first one that will.
    """
    course, moving = np.arctan2(track.vx, track.vy), np.flatnonzero(np.hypot(track.vx, track.vy))
    if moving.size == 0:
        return np.zeros(course.size)
    last = np.searchsorted(moving, np.arange(course.size), side="right") - 1
    return course[moving[np.maximum(last, 0)]]


def daidalus_text(scene: ExchangedEncounter, altitude: float | None) -> str:
    """Return a scene in the form of DAIDALUS' files: local positions and velocities, a row an
    aircraft and second.

    Raises:
        EncounterError: altitudes are neither known nor given, or a name cannot stand in a file.
    """
    tracks = _at_height(scene, altitude)
    labels = [track.name for track in tracks]
    usable = all(label and not set(label) & set(" ,#\t") for label in labels)
    if not usable or len(set(labels)) < len(labels):
        raise EncounterError(
            f"encounter {scene.name!r}: names {labels}, expected different ones without blanks or "
            ", #"
        )
    lines = [
        "NAME, sx, sy, sz, vx, vy, vz, time",
        "[none], [m], [m], [m], [m/s], [m/s], [m/s], [s]",
    ]
    fields = ("x", "y", "altitude", "vx", "vy", "vertical_rate", "time")  # in this order
    for row in range(len(tracks[0].time)):
        for track in tracks:
            cells = [repr(float(getattr(track, field)[row])) for field in fields]
            lines.append(", ".join([track.name, *cells]))
    return "\n".join(lines) + "\n"


def _at_height(scene: ExchangedEncounter, altitude: float | None) -> list[Track]:
    """Return a scene's tracks with their altitudes, or with the given one (m) where they
    have none.
    """
    if scene.altitudes:
        return list(scene.tracks)
    if altitude is None:
        raise EncounterError(
            f"encounter {scene.name!r} has no altitude, expected one for this form (--altitude-ft)"
        )
    return [track._replace(altitude=np.full(len(track.time), altitude)) for track in scene.tracks]


def _track(name: str, states: VehicleState[Air], times: np.ndarray) -> Track:
    zero = np.zeros(len(times))
    vx, vy = states.speed * np.cos(states.heading), states.speed * np.sin(states.heading)
    return Track(name, times, states.x, states.y, zero, vx, vy, zero, {})


def _start(track: Track) -> VehicleState[Air]:
    """Return the state at the beginning of a track, plain numbers."""
    vx, vy = float(track.vx[0]), float(track.vy[0])
    return VehicleState(
        float(track.x[0]), float(track.y[0]), math.atan2(vy, vx), math.hypot(vx, vy)
    )
