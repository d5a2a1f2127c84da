"""The tracker beside Stone Soup on the same reports: ``python -m benchmarks.tracking [--peer]``.

Random flights go straight, turn once at 0.3 to 3 deg/s and go straight again; each second a report
has random errors that it declares. ``ours`` is :mod:`envs.tracking`; ``known_rates`` and
``unknown_rate`` are interacting models of Stone Soup's parts (``--peer``;
:mod:`benchmarks.stone_soup`), with our noises and chances. Each is judged while flights are
straight (``straight``, from 20 s on until the turn) and while they turn (``turn``): errors of
position and velocity, root mean squares, m and m/s; NEES of both together, 4 where errors are as
large as said. ``sees`` is how soon a turn of 1 deg/s and more is seen, s, and in how many;
``imagines`` how often a straight flight is said to turn. Times are those of one report of one
aircraft, of ours for all aircraft together in arrays, and for one after the other in plain floats
and, where numba is installed, compiled.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from benchmarks import stone_soup
from benchmarks.measure import hold_to_one_core, report, show
from commands.command import Parser, real, run_cli, whole
from commands.progress import Progress
from envs import compiled
from envs.arrays import Array
from envs.backend import FLOATS
from envs.frames import Ground
from envs.kinematics import SURROGATE, VehicleState, advance, velocity
from envs.tracking.estimate import mix
from envs.tracking.single import follow
from envs.tracking.tracker import Reports, Tracks, begin, belief, extend, restart
from envs.trees import map_leaves, take

_BEFORE = 20, 60  # s of straight flight, at least and at most
_RATES = math.radians(0.3), math.radians(3.0)  # rad/s
_MOST = math.radians(120.0)  # rad, of a turn
_SLOW = math.radians(1.0)  # rad/s, below which nobody asks when a turn is seen
_SETTLED = 20  # s, after which errors are judged
_ALL_AT_ONCE = 100  # aircraft, whose second is timed


class Flights(NamedTuple):
    """Flights second by second, and what is reported of them."""

    states: VehicleState[Ground]  # [T, N]
    reports: VehicleState[Ground]  # [T, N]
    rates: np.ndarray  # turn rate within the second before, rad/s, [T, N]
    errors: tuple[float, float]  # one sigma per axis of the reports, m and m/s


class Track(NamedTuple):
    """What one side says of all flights; axes x, vx, y, vy."""

    mean: np.ndarray  # [T, N, 4]
    covariance: np.ndarray  # [T, N, 4, 4]
    turns: np.ndarray  # whether it turns, bool, [T, N]


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--flights", type=whole(1), default=100, help="flights (default 100)")
    add("--seconds", type=whole(60, 10_000), default=120, help="of a flight (default 120 s)")
    add("--seed", type=whole(0), default=0, help="seed of flights and errors (default 0)")
    help_text = "one sigma of a reported {}, per axis, {} (default {:g})"
    position, speed = (
        help_text.format("position", "m", 30.0),
        help_text.format("velocity", "m/s", 3.0),
    )
    add("--position-std", type=real(1.0, 1e3, "m"), default=30.0, metavar="M", help=position)
    add("--velocity-std", type=real(0.3, 50.0, "m/s"), default=3.0, metavar="M/S", help=speed)
    add("--peer", action="store_true", help="beside Stone Soup; " + stone_soup.INSTALL)
    options = parser.parse_args()
    if options.peer:
        stone_soup.require()
    hold_to_one_core()
    errors = options.position_std, options.velocity_std
    flights = draw(options.flights, options.seconds, errors, options.seed)
    summary: dict[str, Any] = {
        "benchmark": "tracking",
        "flights": options.flights,
        "seconds": options.seconds,
        "position_std_m": errors[0],
        "velocity_std_m_s": errors[1],
        **reported_errors(flights),
        **figures("ours", ours(flights), flights),
        **our_times(flights),
    }
    if options.peer:
        for name, make in PEERS.items():
            track, seconds = theirs(make(*errors), flights, name)
            summary |= figures(name, track, flights) | {f"{name}_report_us": 1e6 * seconds}
    show(summary)
    report(summary, ("numpy", "stonesoup") if options.peer else ("numpy",))


PEERS: dict[str, Callable[[float, float], stone_soup.Filter]] = {
    "known_rates": stone_soup.filter_of_known_rates,
    "unknown_rate": stone_soup.filter_of_unknown_rate,
}


def draw(count: int, seconds: int, errors: tuple[float, float], seed: int) -> Flights:
    """Return random flights and their reports."""
    rng = np.random.default_rng([seed, 61])
    state: VehicleState[Ground] = VehicleState(
        rng.uniform(-1e4, 1e4, count),
        rng.uniform(-1e4, 1e4, count),
        rng.uniform(-math.pi, math.pi, count),
        rng.uniform(50.0, 100.0, count),
    )
    begins = rng.integers(*_BEFORE, count)
    rate = rng.uniform(*_RATES, count) * rng.choice([-1.0, 1.0], count)
    ends = begins + np.ceil(rng.uniform(0.25, 1.0, count) * _MOST / np.abs(rate))
    states, rates = [state], [np.zeros(count)]
    for second in range(seconds):
        rates.append(np.where((begins <= second) & (second < ends), rate, 0.0))
        state = advance(state, np.zeros(count), rates[-1], np.float64(1.0), SURROGATE, np)
        states.append(state)
    flown = map_leaves(lambda *fields: np.stack(fields), *states)
    vx, vy = velocity(flown, np)
    x, y = (part + errors[0] * rng.normal(size=part.shape) for part in (flown.x, flown.y))
    vx, vy = (part + errors[1] * rng.normal(size=part.shape) for part in (vx, vy))
    reports: VehicleState[Ground] = VehicleState(x, y, np.arctan2(vy, vx), np.hypot(vx, vy))
    return Flights(flown, reports, np.stack(rates), errors)


def vectors(states: VehicleState[Ground]) -> np.ndarray:
    """Return states ``[...]`` as ``x, vx, y, vy``, ``[..., 4]``."""
    vx, vy = velocity(states, np)
    return np.stack([states.x, vx, states.y, vy], axis=-1)


def ours(flights: Flights) -> Track:
    """Return what our tracker says."""
    steps = list(_steps(flights))
    mixtures = [mix(tracks.straight, tracks.turning, tracks.turns) for tracks in steps]
    covariance = np.zeros((*flights.rates.shape, 4, 4))
    for second, estimate in enumerate(mixtures):
        c = estimate.covariance
        for axis in (0, 2):
            covariance[second, :, axis, axis] = c.pp
            covariance[second, :, axis + 1, axis + 1] = c.vv
            covariance[second, :, axis, axis + 1] = covariance[second, :, axis + 1, axis] = c.pv
    mean = np.stack(
        [
            np.stack([estimate.x, estimate.vx, estimate.y, estimate.vy], axis=-1)
            for estimate in mixtures
        ]
    )
    return Track(mean, covariance, np.stack([belief(tracks).turn_rate != 0.0 for tracks in steps]))


def _steps(flights: Flights) -> Iterator[Tracks[Ground]]:
    """Yield the tracks after each second's reports, in arrays."""
    tracks: Tracks[Ground] | None = None
    for second in range(len(flights.rates)):
        reports = Reports(take(flights.reports, second), *map(np.float64, flights.errors))
        tracks = begin(reports) if tracks is None else take_in(tracks, reports)
        yield tracks


def take_in(tracks: Tracks[Ground], reports: Reports[Ground]) -> Tracks[Ground]:
    """Return tracks with a second's reports; what does not follow from its past begins anew."""
    extended, jumps = extend(tracks, reports, np.float64(1.0))
    if not np.any(jumps):
        return extended

    def choose(anew: Array, old: Array) -> Array:
        return np.where(jumps, anew, old)

    return map_leaves(choose, restart(extended), extended)


def theirs(filter_: stone_soup.Filter, flights: Flights, name: str) -> tuple[Track, float]:
    """Return what a filter of Stone Soup says, and the time of a report, s."""
    reports, (seconds, count) = vectors(flights.reports), flights.rates.shape
    mean, covariance = np.zeros((seconds, count, 4)), np.zeros((seconds, count, 4, 4))
    turns, spent = np.zeros((seconds, count), bool), 0.0
    with Progress("flights").start(count, word=name) as progress:
        for number in range(count):
            belief = stone_soup.begin(filter_, reports[0, number], 0.0)
            for second in range(seconds):
                began = time.perf_counter()
                if second:
                    vector = reports[second, number]
                    belief = stone_soup.extend(filter_, belief, vector, float(second))
                answer = stone_soup.answer(filter_, belief)
                spent += time.perf_counter() - began
                mean[second, number], covariance[second, number] = answer.mean, answer.covariance
                turns[second, number] = answer.turns > 0.5
            progress.show(number + 1, name)
    return Track(mean, covariance, turns), spent / (seconds * count)


def our_times(flights: Flights) -> dict[str, float]:
    """Return the times of a report in arrays, in floats and compiled, us, and of a second of a
    hundred aircraft in arrays, ms.
    """
    count = flights.rates.shape[1]
    chosen = np.arange(_ALL_AT_ONCE) % count
    repeated = flights._replace(reports=map_leaves(lambda field: field[:, chosen], flights.reports))
    times = []
    for _ in range(3):
        began = time.perf_counter()
        for tracks in _steps(repeated):
            belief(tracks)
        times.append((time.perf_counter() - began) / len(flights.rates))
    alone = min(count, 20)
    rows = [
        list(zip(*(field[:, number].tolist() for field in flights.reports), strict=True))
        for number in range(alone)
    ]
    times_of_a_report = {
        "ours_arrays_report_us": 1e6 * min(times) / _ALL_AT_ONCE,
        "ours_arrays_100_aircraft_ms": 1e3 * min(times),
    }
    before = compiled.in_use()
    compiled.use(False)
    times_of_a_report["ours_floats_report_us"] = _time_alone(rows, flights.errors)
    if compiled.prepare():
        times_of_a_report["ours_compiled_report_us"] = _time_alone(rows, flights.errors)
    compiled.use(before)
    return times_of_a_report


def _time_alone(
    flights: Sequence[Sequence[tuple[float, ...]]], errors: tuple[float, float]
) -> float:
    """Return the time of a report of one aircraft after the other, us."""
    times = []
    for _ in range(3):
        began = time.perf_counter()
        for reports in flights:
            _follow_alone(reports, errors)
        times.append(time.perf_counter() - began)
    return 1e6 * min(times) / sum(map(len, flights))


def _follow_alone(reports: Sequence[tuple[float, ...]], errors: tuple[float, float]) -> None:
    """Track one aircraft as the ROS nodes do, the newest report the origin of its map."""
    begins: Reports[Ground] = Reports(VehicleState(0.0, 0.0, *reports[0][2:]), *errors)
    tracks = begin(begins, FLOATS)
    for before, (x, y, heading, speed) in pairwise(reports):
        state: VehicleState[Ground] = VehicleState(x - before[0], y - before[1], heading, speed)
        tracks, _, _ = follow(tracks, Reports(state, *errors), 1.0)


def reported_errors(flights: Flights) -> dict[str, float]:
    """Return the root mean squares of the reports' errors."""
    off = vectors(flights.reports) - vectors(flights.states)
    return {"reports_position_m": _rms(off[..., ::2]), "reports_velocity_m_s": _rms(off[..., 1::2])}


def figures(name: str, track: Track, flights: Flights) -> dict[str, float]:
    """Return the figures of one side."""
    seconds = np.arange(len(flights.rates))[:, None]
    turning = flights.rates != 0.0
    turned = np.maximum.accumulate(turning, axis=0)
    off = track.mean - vectors(flights.states)
    squared = np.einsum("tni,tnij,tnj->tn", off, np.linalg.inv(track.covariance), off)
    summary: dict[str, float] = {}
    for phase, holds in (("straight", ~turned & (seconds >= _SETTLED)), ("turn", turning)):
        summary |= {
            f"{name}_{phase}_position_m": _rms(off[holds][:, ::2]),
            f"{name}_{phase}_velocity_m_s": _rms(off[holds][:, 1::2]),
            f"{name}_{phase}_nees": _mean(squared[holds]),
        }
    delays = _delays(track.turns, turning, np.abs(flights.rates).max(axis=0) >= _SLOW)
    noticed = delays[np.isfinite(delays)]
    return summary | {
        f"{name}_sees_median_s": float(np.median(delays)) if len(noticed) else math.nan,
        f"{name}_sees_share": len(noticed) / max(len(delays), 1),
        f"{name}_imagines_share": _mean(track.turns[~turned & (seconds >= _SETTLED)]),
    }


def _delays(turns: np.ndarray, turning: np.ndarray, fast: np.ndarray) -> np.ndarray:
    """Return how long each turn of some flights went on before it was seen, s; infinite: never."""
    begins = turning.argmax(axis=0)
    noticed = turns & turning
    return np.where(noticed.any(axis=0), noticed.argmax(axis=0) - begins + 1.0, np.inf)[
        fast & turning.any(axis=0)
    ]


def _rms(off: np.ndarray) -> float:
    """Return the root mean square of plane vectors ``[..., 2]``."""
    return math.sqrt(_mean(np.sum(off * off, axis=-1)))


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else math.nan


if __name__ == "__main__":
    run_cli(main)
