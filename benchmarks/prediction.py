"""How often aircraft are later where the tracker predicted them: ``python -m benchmarks.prediction
DATA``.

DATA is a folder of public recordings, with ``adsb`` (OpenSky's reports as of the ``traffic``
package) and ``lincoln_lab``. Reports go through the tracker at their own times, as reports that do
not declare how exact they are: with the defaults of the ROS nodes. After each of them the position
30 and 60 s later is predicted, along the course or along the turn for as long as it is expected to
last, and held against the first report after that. Two sigmas per axis should hold 95.4 % of normal
errors.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.traffic import Traffic, predict, turn_error, uncertainty
from benchmarks.measure import report, show
from commands.command import Parser, run_cli
from envs.angles import wrap
from envs.formats.adsb_file import order_flights
from envs.formats.lincoln_file import read_lincoln, tracks_of
from envs.formats.track_rows import place_of, track_of
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.tracking.tracker import TURN_STEPS, Reports, belief, lasting, observe
from envs.traffic.tracks import Track, at_times
from envs.trees import map_leaves, take
from ros_bridge.core.reports import USUAL

_AHEAD = (30.0, 60.0)  # s
_LATE = 10.0  # s after which a report is no longer of that time
_SIGMAS = 2.0
_APART = 60.0  # s between two reports of different flights
_EVERY = 10  # rows of Lincoln Laboratory's tracks, which are 0.1 s apart
# Course (rad) or speed (m/s) changed by more until then: it has manoeuvred.
_TURNED, _FASTER = np.radians(10.0), 5.0


class Grid(NamedTuple):
    """Reports of flights in a row each; fields ``[N, T]``, nan after the last."""

    time: np.ndarray  # s
    state: VehicleState[Air]


class Predictions(NamedTuple):
    """Predictions that a report has come for; fields ``[P]``."""

    off: np.ndarray  # error of the position, in sigmas, ``[2, P]``
    sigma: np.ndarray  # per axis, m
    manoeuvred: np.ndarray  # whether course or speed have changed until then, bool


def sources(data: Path) -> Iterator[tuple[str, list[Track]]]:
    """Yield the flights of each recording."""
    for name in ("calfire", "quickstart"):
        path = data / "adsb" / f"{name}.json.gz"
        flights = order_flights(path, _APART, repair=True, max_gap=_APART)
        rows = [segment for _, reports, _ in flights for segment in reports if len(segment) > 1]
        yield name, [track_of(name, segment, place_of(segment[0])) for segment in rows]
    encounters = read_lincoln(data / "lincoln_lab" / "encounters.json")
    flown = [track for encounter in encounters for track in tracks_of(encounter)]
    yield "lincoln", [at_times(track, track.time[::_EVERY]) for track in flown]


def grid(tracks: list[Track]) -> Grid:
    """Return the reports of tracks."""
    longest = max(len(track.time) for track in tracks)

    def rows(values: list[np.ndarray]) -> np.ndarray:
        return np.stack(
            [np.pad(value, (0, longest - len(value)), constant_values=np.nan) for value in values]
        )

    x, y, vx, vy = (
        rows([getattr(track, key) for track in tracks]) for key in ("x", "y", "vx", "vy")
    )
    time = rows([track.time - track.time[0] for track in tracks])
    state: VehicleState[Air] = VehicleState(x, y, np.arctan2(vy, vx), np.hypot(vx, vy))
    return Grid(time, state)


def believe(reports: Grid) -> Traffic:
    """Return what the tracker believes after each report, ``[N, T]``."""
    believed: list[Traffic] = []
    sightings = None
    for row in range(reports.time.shape[1]):
        there = np.isfinite(reports.time[:, row])
        time: Any = np.where(there, reports.time[:, row], 0.0)  # of each flight
        unknown = Reports(take(reports.state, np.s_[:, row]), 0.0, 0.0, False)
        sightings = observe(sightings, unknown, time, there)
        current = belief(sightings.tracks)
        turn_time = lasting(current.turn_rate, current.turn_std, TURN_STEPS)
        velocity_std = np.maximum(current.velocity_std, USUAL.velocity_std)
        believed.append(
            Traffic.straight(current.state, there)._replace(
                turn_rate=current.turn_rate,
                turn_time=turn_time,
                position_std=np.maximum(current.position_std, USUAL.position_std),
                velocity_std=np.hypot(
                    velocity_std, turn_error(current.state.speed, current.turn_std, turn_time)
                ),
            )
        )
    return map_leaves(lambda *fields: np.stack(fields, axis=-1), *believed)


def predictions(reports: Grid, believed: Traffic, ahead: float) -> Predictions:
    """Return what was predicted some seconds ahead, where there is a report then; what cannot be
    believed is not predicted.
    """
    count, length = reports.time.shape
    later = np.full((count, length), length - 1)
    for n, time in enumerate(reports.time):
        filled = np.count_nonzero(np.isfinite(time))
        later[n, :filled] = np.minimum(
            np.searchsorted(time[:filled], time[:filled] + ahead), length - 1
        )
    n = np.arange(count)[:, None]
    elapsed = reports.time[n, later] - reports.time
    believable = np.isfinite(believed.velocity_std)
    rows = np.nonzero((elapsed >= ahead) & (elapsed <= ahead + _LATE) & believable)
    reported, target = (rows[0], rows[1]), (rows[0], later[rows])
    tracks, before = take((believed, reports.state), reported)
    true = take(reports.state, target)
    there = predict(tracks, elapsed[rows])
    sigma = uncertainty(tracks, elapsed[rows])
    off = np.stack([there.x - true.x, there.y - true.y]) / sigma
    turned = np.abs(wrap(true.heading - before.heading, np)) > _TURNED
    return Predictions(off, sigma, turned | (np.abs(true.speed - before.speed) > _FASTER))


def figures(predicted: Predictions) -> dict[str, Any]:
    """Return the figures of predictions so far ahead."""
    covered = np.abs(predicted.off) <= _SIGMAS
    return {
        "predictions": int(predicted.sigma.size),
        "coverage": _share(covered),
        "sigma_median_m": float(np.median(predicted.sigma)),
        "manoeuvred": _share(predicted.manoeuvred),
        "coverage_manoeuvred": _share(covered[:, predicted.manoeuvred]),
        "coverage_flown_on": _share(covered[:, ~predicted.manoeuvred]),
        "misses_of_manoeuvres": _share(
            np.broadcast_to(predicted.manoeuvred, covered.shape)[~covered]
        ),
    }


def _share(holds: np.ndarray) -> float | None:
    """Return the share of what holds; None of nothing."""
    return float(holds.mean()) if holds.size else None


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("data", type=Path, metavar="DATA", help="folder of the public recordings")
    options = parser.parse_args()
    for name, tracks in sources(options.data):
        reports = grid(tracks)
        believed = believe(reports)
        for ahead in _AHEAD:
            shown = {"benchmark": "prediction", "source": name, "ahead_s": ahead}
            shown |= figures(predictions(reports, believed, ahead))
            show(shown)
            report(shown, ("numpy",))


if __name__ == "__main__":
    run_cli(main)
