"""The data of the page's script: which encounters are points and flights, small enough for the
page.

Numbers are little-endian and base64: float32 for the columns of the points, int16 times a scale for
flights.
"""

import base64
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from commands.command import visible
from envs.areas import Area
from eval.flights.among_areas import outlines
from eval.plots.style import BREACH, LOSS, MARKERS, spread
from eval.report.bands import TRACKS, bands_data, wind_data
from eval.report.flights import Replayed
from eval.report.folder import Run

_FINEST = 0.5  # smallest step of a position on the page, m
_TEXTS = (
    "verdict",
    "verdict_method",
    "plan_status",
    "plan_source",
    "baseline_outcome",
    "policy_outcome",
)
_NUMBERS = (
    "distance_m",
    "bearing_deg",
    "relative_heading_deg",
    "min_separation_m",
    "horizontal_miss_m",
    "vertical_miss_m",
    "altitude_deviation_m",
    "climbs",
    "vertical_distance_m",
    "intruder_climb_m_s",
    "time_of_min_separation_s",
    "duration_s",
    "path_excess",
    "goal_distance_m",
    "heading_reversals",
    "baseline_min_separation_m",
    "policy_min_separation_m",
    "plan_min_separation_m",
    "replans",
    "backup_s",
    "areas",
    "min_area_clearance_m",
    "area_breach_s",
    "intruders",
    "own_speed_m_s",
    "intruder_speed_m_s",
    "t_cpa_s",
    "d_cpa_m",
)
NEAR = 1.05  # a success that came nearer than this times the required separation is a close success
NEAREST, OTHERS, POINTS = 200, 100, 20_000
"""At most so many close successes and other successes are replayed; at most so many encounters are
points.
"""


class Choice(NamedTuple):
    """Encounters of one group that are replayed."""

    group: str
    numbers: np.ndarray  # of the encounters, in the order of their importance
    total: int  # encounters in the group


def choose(run: Run, most: int, requested: Sequence[int] = ()) -> list[Choice]:
    """Return the groups of encounters to replay, at most so many in all: those wanted and the most
    important first.
    """
    kinds, separation = run.kinds, run.table["min_separation_m"]
    success = kinds == "success"
    near = success & (separation < NEAR * run.rules.separation)
    nearest = np.flatnonzero(near)
    nearest = nearest[np.argsort(separation[nearest], kind="stable")]
    # Failures that count, what no policy could have solved, and a look at how it usually goes.
    groups = (
        ("asked for", np.array(requested, dtype=int), most),
        ("failures", np.flatnonzero(np.isin(kinds, (LOSS, BREACH, "time-out"))), most),
        ("proven unresolvable", np.flatnonzero(kinds == "proven unresolvable"), most),
        ("close successes", nearest, NEAREST),
        ("other successes", np.flatnonzero(success & ~near), OTHERS),
    )
    room, before, chosen = most, np.array([], dtype=int), []
    for name, members, bound in groups:
        fresh = members[~np.isin(members, before)]
        count = min(room, bound, len(fresh))
        numbers = fresh[:count] if name == "close successes" else spread(fresh, count)
        before, room = np.concatenate([before, numbers]), room - count
        chosen.append(Choice(name, numbers, len(members)))
    return [choice for choice in chosen if choice.total]


def points(run: Run, replayed: np.ndarray) -> np.ndarray:
    """Return the numbers of the encounters that are points: all, or those replayed, failures and an
    even sample.
    """
    numbers = np.arange(len(run.kinds))
    if len(numbers) <= POINTS:
        return numbers
    failures = np.setdiff1d(np.flatnonzero(run.kinds != "success"), replayed)
    first = np.concatenate([replayed, spread(failures, POINTS // 2)])
    remaining = np.setdiff1d(numbers, first)
    return np.sort(np.concatenate([first, spread(remaining, max(0, POINTS - len(first)))]))


def page_data(
    run: Run, numbers: np.ndarray, flights: Mapping[int, Mapping[str, Any]]
) -> dict[str, Any]:
    """Return all that the script reads, in JSON types: encounters that are points, ascending, and
    flights by number.
    """
    table, rules = run.table, run.rules
    kinds = list(MARKERS)
    codes = np.array([kinds.index(kind) for kind in run.kinds[numbers]], np.uint8)
    texts = {}
    for name in (column for column in _TEXTS if column in table):
        words, places = np.unique(table[name][numbers].astype(str), return_inverse=True)
        texts[name] = {"words": words.tolist(), "codes": _pack(places.astype(np.uint8))}
    named = any(name is not None for name in table["name"])
    return {
        "required": rules.separation,
        "near": NEAR * rules.separation,
        "goal_radius": rules.goal_radius,
        "kinds": kinds,
        "commanded": run.config.mode == "policy",
        "dt": run.rules.dt,
        "tracks_deg": TRACKS.tolist(),
        "count": len(numbers),
        "number": _pack(numbers.astype("<i4")),
        "kind": _pack(codes),
        "columns": {
            name: _pack(table[name][numbers].astype("<f4")) for name in _NUMBERS if name in table
        },
        "texts": texts,
        "names": [None if name is None else visible(name) for name in table["name"][numbers]]
        if named
        else None,
        "flights": {str(number): flight for number, flight in flights.items()},
    }


def flight_data(flight: Replayed) -> dict[str, Any]:
    """Return one flight in JSON types; positions are relative to its origin and rounded to its
    scale, m.
    """
    track = flight.track
    origin = np.round(0.5 * (track.own.min(axis=1) + track.own.max(axis=1)))
    scale, packed = _pack_flight(flight, origin)
    data: dict[str, Any] = {
        "steps": len(track.separation),
        "intruders": len(track.intruders),
        "scale": scale,
        "goal": [
            round(place - middle, 1) for place, middle in zip(track.goal, origin, strict=True)
        ],
        "packed": packed,
    }
    if not flight.matches_table:
        data["differs"] = True
    if flight.plan is not None:
        x, y, time = flight.plan
        data["plan"] = [np.round(row, 1).tolist() for row in (x - origin[0], y - origin[1], time)]
    if flight.plan_status is not None:
        data["plan_status"] = flight.plan_status
    if flight.bands is not None:
        data["bands"] = bands_data(flight.bands)
    if flight.wind is not None:
        data["wind"] = wind_data(flight.wind)
    if track.required is not None:
        data["required"] = np.round(track.required, 1).tolist()
    if track.areas:
        data["areas"] = [_area_data(area, origin) for area in track.areas]
    if flight.witness is not None:
        data["witness"] = {
            "points": flight.witness.path.shape[1],
            "arrival": round(flight.witness.arrival, 1),
            "separation": round(flight.witness.separation, 1),
        }
    return data


def _pack_flight(flight: Replayed, origin: np.ndarray) -> tuple[float, str]:
    """Return the scale of a flight, m, and its numbers, base64 of int16: own places from the
    origin, m, intruders', separations and the witness's places by the scale, then yaw rates in
    millidegrees per second and accelerations in mm/s^2.
    """
    track = flight.track
    path = np.zeros((2, 0)) if flight.witness is None else flight.witness.path
    own, traffic, also = (
        (place - origin[:, None]).ravel() for place in (track.own, track.intruders, path)
    )
    metres = [own, traffic, track.separation, also]
    largest = max(float(np.max(np.abs(part), initial=0.0)) for part in metres)
    scale = max(_FINEST, math.ceil(largest / 32_767.0 / _FINEST) * _FINEST)
    rates = [np.degrees(flight.yaw_rate) * 1e3, flight.acceleration * 1e3]
    whole = np.concatenate([part / scale for part in metres] + rates)
    return scale, _pack(np.clip(np.round(whole), -32_768, 32_767).astype("<i2"))


def _area_data(area: Area, origin: np.ndarray) -> dict[str, Any]:
    rings = [np.round(ring - origin, 1).tolist() for ring in outlines(area, 0.0)]
    return {"rings": rings, "velocity": list(area.velocity)}


def json_text(data: Any) -> str:
    """Return JSON that may stand inside a script element: nothing in it can end the element or
    begin another.
    """
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)  # ASCII
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _pack(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
