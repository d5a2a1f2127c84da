"""Equilibria of the JSBSim aircraft, found by Newton's steps on its accelerations: level, climbing
and gliding flight.

JSBSim's own trim takes 0.4 s and fails near the stall; evaluating its initial conditions takes 0.1
ms. The level equilibria at the reference altitude are stored (``data/trim.csv``), and the autopilot
feeds them forward. ``python -m envs.c208.trim`` renews the file.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from envs.c208.facts import DATA, FOOT, POUND, value
from envs.c208.fdm import Fdm
from envs.c208.model import stall_angle
from envs.c208.propulsion import Curve
from envs.edge.command import Parser, run_cli
from envs.edge.files import write_file

REFERENCE_ALTITUDE = 2500.0  # of the stored equilibria and of flights, m
REFERENCE_WEIGHT = 8807.0 * POUND  # of the stored equilibria, N
TABLE_SPEEDS = tuple(
    float(speed) for speed in range(46, 107, 3)
)  # true airspeeds of the stored equilibria, m/s
_FILE, _COLUMNS = DATA / "trim.csv", ("speed", "alpha", "elevator", "thrust")
_ITERATIONS, _EXACT = 30, 1e-8


class TrimError(RuntimeError):
    """There is no equilibrium as asked for."""


class Trim(NamedTuple):
    """An unaccelerated state with level wings, in SI units and radians; ``speed`` is the true
    airspeed.
    """

    speed: float
    alpha: float
    elevator: float  # positive with the trailing edge down
    throttle: float  # 0 to 1
    gamma: float  # climb angle
    thrust: float


_LEVEL = (
    "lat-geod-deg",
    "long-gc-deg",
    "h-sl-ft",
    "vt-fps",
    "beta-deg",
    "phi-deg",
    "psi-true-deg",
    "p-rad_sec",
    "q-rad_sec",
    "r-rad_sec",
)
"""Initial conditions of level flight but for its angles; 0 where nothing is said of them."""


def solve(
    fdm: Fdm,
    speed: float,
    altitude: float = REFERENCE_ALTITUDE,
    *,
    throttle: float | None = None,
    flaps: float = 0.0,
) -> Trim:
    """Find an equilibrium: level flight, or at a given throttle whatever climb or descent it makes.

    The true airspeed is in m/s, the geometric altitude in m, the throttle 0 to 1 and the flaps in
    degrees. The state of the aircraft is lost.

    Raises:
        TrimError: there is none below the stall and within the engine's and the elevator's range.
    """
    # Angle of attack, elevator, and the climb angle or for level flight the power. The thrust goes
    # with the square of the throttle: linear in what is solved for.
    unknown = np.array([0.05, -0.05, 0.3 if throttle is None else 0.0])
    nodes = [
        fdm.node(f"accelerations/{name}")
        for name in ("udot-ft_sec2", "wdot-ft_sec2", "qdot-rad_sec2")
    ]
    place = dict.fromkeys(_LEVEL, 0.0)
    place |= {"h-sl-ft": altitude / FOOT, "vt-fps": speed / FOOT, "psi-true-deg": 90.0}

    def parts(point: np.ndarray) -> tuple[float, float, float, float]:
        alpha, elevator, last = (float(number) for number in point)
        return (
            (alpha, elevator, last, 0.0)
            if throttle is None
            else (alpha, elevator, throttle**2, last)
        )

    def residual(point: np.ndarray) -> np.ndarray:
        alpha, elevator, power, gamma = parts(point)
        angles = {"alpha-deg": math.degrees(alpha), "gamma-deg": math.degrees(gamma)}
        controls = surfaces(elevator, math.sqrt(min(max(power, 0.0), 1.0))) | {
            "flap-cmd-norm": flaps / 30.0
        }
        fdm.initialise(place | angles, controls)
        return np.array([node.get_double_value() for node in nodes])

    for _ in range(_ITERATIONS):
        here = residual(unknown)
        if not np.isfinite(here).all():
            break
        if np.abs(here).max() < _EXACT:
            return _make_trim(fdm, speed, *parts(unknown), flaps)
        slope = np.empty((3, 3))
        for column in range(3):
            # Inwards at the end of the throttle's range, outside which nothing changes.
            step = -1e-5 if column == 2 and throttle is None and unknown[2] > 0.5 else 1e-5
            moved = unknown.copy()
            moved[column] += step
            slope[:, column] = (residual(moved) - here) / step
        if abs(np.linalg.det(slope)) < 1e-9:
            break
        unknown = unknown - np.clip(np.linalg.solve(slope, here), -0.1, 0.1)
        if throttle is None:
            unknown[2] = min(max(unknown[2], 0.0), 1.0)
    flight = "level" if throttle is None else f"at throttle {throttle:g}"
    raise TrimError(
        f"no equilibrium {flight} at {speed:.2f} m/s, {altitude:.0f} m, flaps {flaps:g} deg"
    )


def surfaces(elevator: float, throttle: float) -> dict[str, float]:
    """Return the commands of an elevator deflection (rad) and a throttle (0 to 1), the other
    surfaces at rest.
    """
    travel = value("elevator_down") if elevator > 0.0 else value("elevator_up")
    at_rest = dict.fromkeys(("aileron-cmd-norm", "rudder-cmd-norm", "flap-cmd-norm"), 0.0)
    return {
        "elevator-cmd-norm": elevator / math.radians(travel),
        **at_rest,
        "throttle-cmd-norm": throttle,
    }


def _make_trim(
    fdm: Fdm, speed: float, alpha: float, elevator: float, power: float, gamma: float, flaps: float
) -> Trim:
    low, high = -math.radians(value("elevator_up")), math.radians(value("elevator_down"))
    if alpha > stall_angle(fdm.loading.lift_slope_factor) or not low <= elevator <= high:
        raise TrimError(f"no equilibrium below the stall at {speed:.2f} m/s, flaps {flaps:g} deg")
    fdm.set("propulsion/engine/n2", 60.0 + 40.0 * math.sqrt(power))
    fdm.exec.run_ic()
    return Trim(
        speed,
        alpha,
        elevator,
        math.sqrt(power),
        gamma,
        fdm.get("propulsion/engine/thrust-lbs") * POUND,
    )


def level_table(fdm: Fdm) -> dict[str, np.ndarray]:
    """Find the level equilibria at the reference altitude, ``[N]`` each, by their names in
    :class:`Trim`.
    """
    found = [solve(fdm, speed) for speed in TABLE_SPEEDS]
    return {name: np.array([getattr(trim, name) for trim in found]) for name in _COLUMNS}


@cache
def load_stored() -> dict[str, np.ndarray]:
    """Return the level equilibria that ship: of the EX at its greatest weight, reference
    altitude.
    """
    return dict(
        zip(_COLUMNS, np.loadtxt(_FILE, delimiter=",", skiprows=2, unpack=True), strict=True)
    )


def level_curve(name: str) -> Curve:
    """Return a column of the stored equilibria over their speed."""
    return Curve(load_stored()["speed"], load_stored()[name])


def main() -> int:
    """Write the file that ships; return the exit code."""
    Parser(prog="python -m envs.c208.trim", description=__doc__).parse_args()
    lines = [
        "# Level flight of the EX at 8807 lb, 2500 m: m/s, rad, rad, N. Written by python -m "
        "envs.c208.trim."
    ]
    lines.append(",".join(_COLUMNS))
    lines += [
        ",".join(f"{number:.9g}" for number in row)
        for row in zip(*level_table(Fdm()).values(), strict=True)
    ]
    write_file(_FILE, "\n".join(lines) + "\n")
    print(f"wrote {_FILE}")
    return 0


if __name__ == "__main__":
    run_cli(main)
