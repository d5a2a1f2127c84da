"""Recorded tracks as encounters: the ownship begins where its track does and has a goal ahead, the
others are replayed.

Tracks are taken in the horizontal plane, all at one level, unless their altitudes are asked for.
An intruder flies on straight where its track ends, and level.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from envs.aircraft import Aircraft
from envs.altitudes import Altitudes
from envs.angles import wrap
from envs.encounters import Encounter
from envs.frames import Air
from envs.intruder import KnownFlight
from envs.kinematics import FASTEST, VehicleState, advance
from envs.perception import Sensor
from envs.traffic.tracks import Repairs, Track, TrackError, at_times


class Replay(NamedTuple):
    """Encounters of recorded intruders."""

    starts: Encounter  # [N]; in the place of an intent the intruders have a KnownFlight
    names: tuple[str, ...]
    weights: np.ndarray  # importance weights of the encounters, [N]; 1 where the file has none
    left_out: tuple[str, ...] = ()  # sentences on encounters that cannot be flown, and why
    repairs: Repairs = Repairs()


def horizon(aircraft: Aircraft) -> float:
    """Return how long a recording is kept, s: longer than any plan."""
    return 2.0 * aircraft.t_max


def replay(
    encounters: Sequence[tuple[str, Track, Sequence[Track]]],
    aircraft: Aircraft,
    ahead: float,
    *,
    weights: Mapping[str, float] | None = None,
    repairs: Repairs = Repairs(),  # noqa: B008  immutable
    altitudes: bool = False,
) -> Replay:
    """Return recorded encounters as the evaluation flies them.

    Each is a name, the ownship's track and those of its intruders, at least a second long; the goal
    lies ``ahead`` seconds ahead on the ownship's first course. Those outside the speeds of the
    aircraft or its traffic are left out, with the reason. Weights are by name; None: 1 each. With
    altitudes the ownship flies level at that of its start, the intruders at theirs.

    Raises:
        TrackError: none of the encounters can be flown.
    """
    fit, left_out = [], []
    for name, own, intruders in encounters:
        reason = _unfit(own, intruders, aircraft)
        if reason:
            left_out.append(f"{name}: {reason}")
        else:
            fit.append((name, own, intruders))
    if not fit:
        raise TrackError(
            f"no encounter can be flown; the first: {left_out[0] if left_out else 'there is none'}"
        )
    pairs = [(own, intruders) for _, own, intruders in fit]
    starts = _starts(pairs, aircraft, ahead)
    if altitudes:
        starts = starts._replace(altitudes=_altitudes(pairs, starts.mask.shape[1], aircraft))
    names = tuple(name for name, _, _ in fit)
    importance = np.ones(len(fit))
    if weights is not None:
        importance = np.array([weights[name] for name in names])
    return Replay(starts, names, importance, tuple(left_out), repairs)


def _starts(
    pairs: Sequence[tuple[Track, Sequence[Track]]], aircraft: Aircraft, ahead: float
) -> Encounter:
    """Return the encounters of ownships and their intruders, ``[N]``."""
    columns = max(len(intruders) for _, intruders in pairs)
    count, steps = len(pairs), round(horizon(aircraft) / aircraft.dt)
    own = np.zeros((4, count))
    states = np.zeros((4, count, columns, steps + 1))
    mask = np.zeros((count, columns), bool)
    for i, (mine, intruders) in enumerate(pairs):
        vx, vy = mine.vx[0], mine.vy[0]
        own[:, i] = mine.x[0], mine.y[0], np.arctan2(vy, vx), np.hypot(vx, vy)
        for k in range(columns):
            # An absent intruder repeats the first one, so that it is finite everywhere.
            intruder = intruders[k if k < len(intruders) else 0]
            states[:, i, k] = _states(intruder, mine.time[0], steps, aircraft.dt)
        mask[i, : len(intruders)] = True
    return encounters_of(VehicleState(*own), KnownFlight(*states), mask, ahead)


def _altitudes(
    pairs: Sequence[tuple[Track, Sequence[Track]]], columns: int, aircraft: Aircraft
) -> Altitudes:
    """Return the altitudes of encounters of ownships and their intruders, ``columns`` each."""
    steps = round(horizon(aircraft) / aircraft.dt)
    rows = np.zeros((len(pairs), columns, steps + 1))
    for i, (mine, intruders) in enumerate(pairs):
        times = mine.time[0] + aircraft.dt * np.arange(steps + 1)
        for k in range(columns):
            intruder = intruders[k if k < len(intruders) else 0]
            rows[i, k] = np.interp(times, intruder.time, intruder.altitude)
    return Altitudes(np.array([float(mine.altitude[0]) for mine, _ in pairs]), rows)


def encounters_of(
    own: VehicleState[Air], recording: KnownFlight, mask: np.ndarray, ahead: float
) -> Encounter:
    """Return the encounters of an ownship ``[N]``, its goal ``ahead`` seconds ahead, and recorded
    intruders.

    The recording is ``[N, K, T + 1]``, the mask of the intruders that exist ``[N, K]``.
    """
    reach = ahead * own.speed
    column = np.zeros((len(own.x), 1))
    intent: Any = recording  # in the place of an intent
    return Encounter(
        own,
        own.x + reach * np.cos(own.heading),
        own.y + reach * np.sin(own.heading),
        VehicleState(*(field[..., 0] for field in recording)),
        mask,
        intent,
        Sensor(column, column, column),
    )


def off_arcs(recording: KnownFlight, mask: np.ndarray, dt: float) -> np.ndarray:
    """Return how far recordings are from arcs at constant speed, m, ``[N]``: what is wrong by
    taking them for arcs.

    That is the largest distance between a row and where the row before leads within ``dt`` s when
    its speed and the turn to the next heading are held.
    """
    before = VehicleState(*(field[..., :-1] for field in recording))
    after = VehicleState(*(field[..., 1:] for field in recording))
    turn = wrap(after.heading - before.heading, np)
    arc = advance(before, 0.0 * turn, turn / dt, dt, FASTEST._replace(speed_min=0.0), np)
    apart = np.hypot(arc.x - after.x, arc.y - after.y).max(axis=-1, initial=0.0)
    return np.where(mask, apart, 0.0).max(axis=-1, initial=0.0)


def _unfit(own: Track, intruders: Sequence[Track], aircraft: Aircraft) -> str:
    """Return why an encounter cannot be flown, or ""."""
    limits, limit = aircraft.limits, aircraft.traffic_speed_max
    speed = float(np.hypot(own.vx[0], own.vy[0]))
    if not limits.speed_min <= speed <= limits.speed_max:
        expected = f"expected {limits.speed_min:g} to {limits.speed_max:g} m/s"
        return f"the ownship begins with {speed:.1f} m/s over the ground, {expected}"
    if not intruders:
        return "there is no intruder, expected at least one"
    for intruder in intruders:
        if not intruder.time[0] <= own.time[0] < intruder.time[-1]:
            return f"the track of {intruder.name!r} begins after the ownship's or ends before it"
        fastest = float(np.max(np.hypot(intruder.vx, intruder.vy)))
        if fastest > limit:
            return f"{intruder.name!r} flies at {fastest:.1f} m/s, expected at most {limit:g} m/s"
    return ""


def _states(track: Track, start: float, steps: int, dt: float) -> np.ndarray:
    """Return x, y, heading and speed at each time step of ``dt`` s from a start on,
    ``[4, steps + 1]``.
    """
    times = start + dt * np.arange(steps + 1)
    track_at = at_times(track, np.minimum(times, track.time[-1]))
    overtime = np.maximum(times - track.time[-1], 0.0)
    x, y = track_at.x + track_at.vx * overtime, track_at.y + track_at.vy * overtime
    return np.stack(
        [x, y, np.arctan2(track_at.vy, track_at.vx), np.hypot(track_at.vx, track_at.vy)]
    )
