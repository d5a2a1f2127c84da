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

from commands.command import Parser, run_cli
from commands.files import write_file
from envs.c208.facts import DATA, FOOT, POUND, value
from envs.c208.fdm import Fdm
from envs.c208.model import stall_angle
from envs.c208.propulsion import Curve

REFERENCE_ALTITUDE = 2500.0  # of the stored equilibria and of flights, m
REFERENCE_WEIGHT = 8807.0 * POUND  # of the stored equilibria, N
TABLE_SPEEDS = tuple(float(speed) for speed in range(46, 107, 3))
"""True airspeeds of the stored equilibria, m/s."""
_FILE, _COLUMNS = DATA / "trim.csv", ("speed", "alpha", "elevator", "thrust")
_ITERATIONS, _EXACT = 30, 1e-8


class TrimError(RuntimeError):
    """There is no equilibrium as asked for."""


class Trim(NamedTuple):
    """An unaccelerated state with level wings."""

    speed: float  # true airspeed, m/s
    alpha: float  # angle of attack, rad
    elevator: float  # rad, positive with the trailing edge down
    throttle: float  # 0 to 1
    gamma: float  # climb angle, rad
    thrust: float  # N


class _Flight(NamedTuple):
    """The flight whose equilibrium is sought."""

    speed: float  # true airspeed, m/s
    altitude: float  # geometric, m
    throttle: float | None  # 0 to 1; None: what level flight takes
    flaps: float  # degrees


class _State(NamedTuple):
    """A state on the way to an equilibrium."""

    alpha: float  # rad
    elevator: float  # rad
    power: float  # square of the throttle, in which the thrust is linear
    gamma: float  # climb angle, rad


_ACCELERATIONS = (
    "accelerations/udot-ft_sec2",
    "accelerations/wdot-ft_sec2",
    "accelerations/qdot-rad_sec2",
)
"""What is 0 in an equilibrium with level wings: forward, down and in pitch."""


def solve(
    fdm: Fdm,
    speed: float,
    altitude: float = REFERENCE_ALTITUDE,
    *,
    throttle: float | None = None,
    flaps: float = 0.0,
) -> Trim:
    """Find an equilibrium: of level flight, or with a throttle that of the climb or descent that it
    makes.

    The state of the aircraft is lost.

    Args:
        speed: true airspeed, m/s.
        altitude: geometric, m.
        throttle: 0 to 1; None: what level flight takes.
        flaps: degrees.

    Raises:
        TrimError: there is none below the stall and within the engine's and the elevator's range.
    """
    flight = _Flight(speed, altitude, throttle, flaps)
    unknown = np.array([0.05, -0.05, 0.3 if throttle is None else 0.0])
    for _ in range(_ITERATIONS):
        accelerations = _accelerations(fdm, flight, unknown)
        if not np.isfinite(accelerations).all():
            break
        if np.abs(accelerations).max() < _EXACT:
            return _make_trim(fdm, flight, _state(flight, unknown))
        slope = _slope(fdm, flight, unknown, accelerations)
        if abs(np.linalg.det(slope)) < 1e-9:
            break
        unknown = unknown - np.clip(np.linalg.solve(slope, accelerations), -0.1, 0.1)
        if throttle is None:
            unknown[2] = min(max(unknown[2], 0.0), 1.0)
    kind = "level" if throttle is None else f"at throttle {throttle:g}"
    raise TrimError(
        f"no equilibrium {kind} at {speed:.2f} m/s, {altitude:.0f} m, flaps {flaps:g} deg"
    )


def _state(flight: _Flight, unknown: np.ndarray) -> _State:
    """Return the state of three unknowns: angle of attack, elevator, and the power of level flight
    or else the climb angle.
    """
    alpha, elevator, last = (float(number) for number in unknown)
    if flight.throttle is None:
        return _State(alpha, elevator, power=last, gamma=0.0)
    return _State(alpha, elevator, power=flight.throttle**2, gamma=last)


def _accelerations(fdm: Fdm, flight: _Flight, unknown: np.ndarray) -> np.ndarray:
    """Return the accelerations of a state: forward and down, ft/s^2, and in pitch, rad/s^2."""
    state = _state(flight, unknown)
    # In this order: what JSBSim makes of one depends on those before.
    initial = {
        "lat-geod-deg": 0.0,
        "long-gc-deg": 0.0,
        "h-sl-ft": flight.altitude / FOOT,
        "vt-fps": flight.speed / FOOT,
        "beta-deg": 0.0,
        "phi-deg": 0.0,
        "psi-true-deg": 90.0,
        "p-rad_sec": 0.0,
        "q-rad_sec": 0.0,
        "r-rad_sec": 0.0,
        "alpha-deg": math.degrees(state.alpha),
        "gamma-deg": math.degrees(state.gamma),
    }
    controls = surfaces(state.elevator, math.sqrt(min(max(state.power, 0.0), 1.0)))
    fdm.initialise(initial, controls | {"flap-cmd-norm": flight.flaps / 30.0})
    return np.array([fdm.get(name) for name in _ACCELERATIONS])


def _slope(fdm: Fdm, flight: _Flight, unknown: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
    """Return how the accelerations, as they are at the unknowns, change with each of them,
    ``[3, 3]``.
    """
    slope = np.empty((3, 3))
    for column in range(3):
        # Inwards at the end of the throttle's range, outside which nothing changes.
        at_end = column == 2 and flight.throttle is None and unknown[2] > 0.5
        step = -1e-5 if at_end else 1e-5
        moved = unknown.copy()
        moved[column] += step
        slope[:, column] = (_accelerations(fdm, flight, moved) - accelerations) / step
    return slope


def surfaces(elevator: float, throttle: float) -> dict[str, float]:
    """Return the commands of an elevator deflection (rad) and a throttle (0 to 1), the other
    surfaces at rest.
    """
    travel = value("elevator_down") if elevator > 0.0 else value("elevator_up")
    return {
        "elevator-cmd-norm": elevator / math.radians(travel),
        "aileron-cmd-norm": 0.0,
        "rudder-cmd-norm": 0.0,
        "flap-cmd-norm": 0.0,
        "throttle-cmd-norm": throttle,
    }


def _make_trim(fdm: Fdm, flight: _Flight, balance: _State) -> Trim:
    """Return an equilibrium that has been found, or refuse one beyond the stall or the elevator."""
    low, high = -math.radians(value("elevator_up")), math.radians(value("elevator_down"))
    stalls = balance.alpha > stall_angle(fdm.loading.lift_slope_factor)
    if stalls or not low <= balance.elevator <= high:
        raise TrimError(
            f"no equilibrium below the stall at {flight.speed:.2f} m/s, flaps {flight.flaps:g} deg"
        )
    throttle = math.sqrt(balance.power)
    # The spool's speed of this throttle, at which the thrust is read.
    fdm.set("propulsion/engine/n2", 60.0 + 40.0 * throttle)
    fdm.exec.run_ic()
    return Trim(
        speed=flight.speed,
        alpha=balance.alpha,
        elevator=balance.elevator,
        throttle=throttle,
        gamma=balance.gamma,
        thrust=fdm.get("propulsion/engine/thrust-lbs") * POUND,
    )


def level_table(fdm: Fdm) -> dict[str, np.ndarray]:
    """Find the level equilibria at the reference altitude: columns ``[N]`` by the names of
    :class:`Trim`'s fields.
    """
    trims = [solve(fdm, speed) for speed in TABLE_SPEEDS]
    return {name: np.array([getattr(trim, name) for trim in trims]) for name in _COLUMNS}


@cache
def load_stored() -> dict[str, np.ndarray]:
    """Return the level equilibria that ship, as :func:`level_table` does: of the EX at its greatest
    weight, at the reference altitude.
    """
    columns = np.loadtxt(_FILE, delimiter=",", skiprows=2, unpack=True)
    return dict(zip(_COLUMNS, columns, strict=True))


def level_curve(name: str) -> Curve:
    """Return a column of the stored equilibria over their speed."""
    return Curve(load_stored()["speed"], load_stored()[name])


def main() -> int:
    """Write the file that ships; return the exit code."""
    Parser(prog="python -m envs.c208.trim", description=__doc__).parse_args()
    lines = [
        "# Level flight of the EX at 8807 lb, 2500 m: m/s, rad, rad, N. Written by python -m "
        "envs.c208.trim.",
        ",".join(_COLUMNS),
    ]
    lines += [
        ",".join(f"{number:.9g}" for number in row)
        for row in zip(*level_table(Fdm()).values(), strict=True)
    ]
    write_file(_FILE, "\n".join(lines) + "\n")
    print(f"wrote {_FILE}")
    return 0


if __name__ == "__main__":
    run_cli(main)
