"""Latency of guidance bands: ``python -m benchmarks.bands``.

Bands of 72 headings and of 21 speeds for one ownship among random intruders within 8 km, on one
core, look-ahead 120 s. Half of the intruders turn for 15 s; ``uncertain``: with 30 m and 3 m/s of
noise, so that the required distance grows; ``areas``: exact, and beside three areas, a disc, a
polygon of twelve corners and one that moves, all within reach. ``_cpu_`` figures count the
processor's time alone, which other work on the machine does not lengthen so much.
"""

import itertools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.assurance.bands import Bands, heading_bands, speed_bands
from agents.assurance.inputs import no_areas
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Requirement, Traffic
from benchmarks.measure import hold_to_one_core, report
from commands.command import Parser, run_cli, whole
from envs.areas import Area, Circle, Polygon
from envs.frames import Air
from envs.kinematics import C208_PUBLISHED, VehicleState

INTRUDERS = 1, 10, 100
KINDS = "exact", "uncertain", "areas"
BANDS: dict[str, Callable[..., Bands]] = {"headings": heading_bands, "speeds": speed_bands}
LOOK_AHEAD = 120.0
"""Of the bands, s."""
_NEAR = 8_000.0  # m


class Latency(NamedTuple):
    """What a call of the bands takes, median, ms."""

    wall: float
    processor: float


def traffic(count: int, *, uncertain: bool) -> Traffic:
    """Return random intruders of one ownship at the origin, ``[1, count]``."""
    generator, shape = np.random.default_rng(0), (1, count)
    state: VehicleState[Air] = VehicleState(
        generator.uniform(-_NEAR, _NEAR, shape),
        generator.uniform(-_NEAR, _NEAR, shape),
        generator.uniform(-np.pi, np.pi, shape),
        generator.uniform(30.0, 120.0, shape),
    )
    turns = np.where(np.arange(count) % 2, 0.05, 0.0)[None]
    noise = np.full(shape, float(uncertain))
    return Traffic.straight(state)._replace(
        turn_rate=turns,
        turn_time=np.where(turns > 0.0, 15.0, 0.0),
        position_std=30.0 * noise,
        velocity_std=3.0 * noise,
        age=noise,
    )


def three_areas() -> np.ndarray:
    """Return three areas within reach, counted by the ownship, object ``[1]``."""
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    away = 1_500.0 * (1.0 + 0.4 * np.sin(3.0 * angle))
    corners = np.stack([3_000.0 + away * np.cos(angle), -4_000.0 + away * np.sin(angle)], axis=1)
    ring = tuple(map(tuple, corners.tolist()))
    moving = tuple((x - 8_000.0, y + 2_000.0) for x, y in ring)
    areas = (
        Area(Circle(4_000.0, 3_000.0, 1_500.0), clearance=100.0),
        Area(Polygon(ring), clearance=100.0),
        Area(Polygon(moving), velocity=(10.0, -5.0), clearance=100.0),
    )
    active = no_areas(1)
    active[0] = tuple(ActiveArea(number, area, 0.0, 900.0) for number, area in enumerate(areas))
    return active


def measure(bands: Callable[..., Bands], count: int, kind: str, repeats: int) -> Latency:
    """Time calls after one that is not counted.

    Args:
        bands: one of :data:`BANDS`.
        count: of the intruders.
        kind: one of :data:`KINDS`.
        repeats: calls that are timed.
    """
    own = VehicleState(*(np.array([value]) for value in (0.0, 0.0, 0.3, 75.0)))
    others, requirement = traffic(count, uncertain=kind == "uncertain"), Requirement(1_000.0)
    areas = three_areas() if kind == "areas" else None
    wall, processor = [], []
    for _ in range(repeats + 1):
        began, began_cpu = time.perf_counter(), time.process_time()
        bands(own, others, requirement, C208_PUBLISHED, LOOK_AHEAD, areas=areas)
        wall.append(time.perf_counter() - began)
        processor.append(time.process_time() - began_cpu)
    return Latency(*(1e3 * float(np.median(times[1:])) for times in (wall, processor)))


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--repeats", type=whole(1), default=200, help="timed calls (default 200)")
    options = parser.parse_args()
    hold_to_one_core()
    summary: dict[str, Any] = {"repeats": options.repeats}
    with threadpool_limits(1):
        for count, kind, name in itertools.product(INTRUDERS, KINDS, BANDS):
            latency = measure(BANDS[name], count, kind, options.repeats)
            summary[f"{name}_{count}_{kind}_median_ms"] = latency.wall
            summary[f"{name}_{count}_{kind}_cpu_median_ms"] = latency.processor
    report(summary, ("numpy",))


if __name__ == "__main__":
    run_cli(main)
