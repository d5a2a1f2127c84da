"""The true aircraft measured: ``python -m benchmarks.c208 [--plans 100] [--resets 3000]``.

Steps and ramps of the autopilot; plans of the shipped policy flown in calm air, in wind and
turbulence, and with random loadings; speed, reproducibility and memory. Cross-track errors are
those of the flight against the legs between the published waypoints, times of arrival those at the
waypoints. One core.
"""

import argparse
import hashlib
import math
import multiprocessing
import resource
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from agents.planner.planner import plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.request import Options, in_wind
from agents.policy.inference import Policy
from benchmarks.measure import hold_to_one_core, report, show
from commands.command import InputError, Parser, run_cli, whole
from envs import follower
from envs.aircraft import PAPER
from envs.c208.conditions import CALM, NOMINAL, Conditions, Loading
from envs.c208.facts import GRAVITY
from envs.c208.guidance import Path as Track
from envs.c208.guidance import follow
from envs.c208.gymnasium_env import C208Env
from envs.c208.point_mass import PointMassVehicle
from envs.c208.vehicle import LOG_COLUMNS, C208Vehicle, FlightError, StartError
from envs.follower import PERIOD, deviation, offset
from envs.frames import Air, Ground
from envs.gym.gymnasium_env import DeconflictionEnv
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from envs.waypoints import Legs, legs, repeat
from envs.waypoints import at as along
from envs.wind import NO_WIND, over_ground, through_air

_WIND = 10.0  # m/s, from any direction
_POWER_SPEEDS = 55.0, 92.0  # airspeeds between which there is power left for a plan, m/s
_ALTITUDE = 2_500.0  # of all flights, m
_BANKS = 60.0, 70.0, 95.0  # speeds at which a bank of 30 deg is demanded, m/s
_RAMPS = (60.0, 80.0), (70.0, 90.0), (90.0, 55.0)  # of the speed, m/s
_RAMP = 0.5  # m/s^2


class Plan(NamedTuple):
    """One plan to be flown."""

    own: VehicleState[Air]
    legs: Legs[Air]
    times: np.ndarray
    """Of the waypoints, s."""


class FlightErrors(NamedTuple):
    """One flight; errors without sign."""

    cross_track: np.ndarray
    """m, every period."""
    late: np.ndarray
    """s, at every waypoint."""
    altitude: np.ndarray
    """m, every period."""
    position: np.ndarray
    """Distance from where the plan is at the time, m, every period."""


def plans_of(count: int, name: str, seed: int) -> list[Plan]:
    """Return the SAFE ones of so many plans of the shipped policy."""
    encounters = encounters_of_seed(scenario(name, PAPER), seed, 0, count)
    proposals = plan_many(
        request_of(encounters, PAPER), Policy.load(), in_wind(Options.for_aircraft(PAPER), None)
    ).candidates
    safe_plans = []
    for number in np.flatnonzero(proposals.safe):
        plan_states = take(proposals.plan_states, number)
        own: VehicleState[Air] = VehicleState(*(float(field[number]) for field in encounters.own))
        safe_plans.append(Plan(own, legs(plan_states), plan_states.time[1:]))
    return safe_plans


def judge(
    plan: Plan, states: list[VehicleState[Ground]], late: list[float], altitudes: np.ndarray
) -> FlightErrors:
    """Compare the states after every period with the plan; ``late`` is about how late they
    are, s.
    """
    clock = PERIOD * np.arange(1, len(states) + 1)
    flown: VehicleState[Ground] = VehicleState(
        *(np.array(field) for field in zip(*states, strict=True))
    )
    flight = through_air(flown, NO_WIND, 0.0)  # plans are for still air
    curves = repeat(plan.legs, clock.size)
    # Begun near the place abeam: an aircraft a minute late on a winding path has several.
    deviations = deviation(curves, flight, clock - late)
    at = np.clip(np.round(plan.times / PERIOD).astype(int) - 1, 0, clock.size - 1)
    distance = np.hypot(*offset(flight, along(curves, clock)))
    return FlightErrors(
        np.abs(deviations.cross_track),
        np.abs(deviations.time + late)[at],
        np.abs(altitudes - _ALTITUDE),
        distance,
    )


def fly_plan(plan: Plan, conditions: Conditions = CALM, generic: bool = False) -> FlightErrors:
    """Fly a plan on the true aircraft, by its own guidance or by the generic follower."""
    vehicle = C208Vehicle(over_ground(plan.own, NO_WIND, 0.0), "ex", conditions)
    until = float(plan.times[-1])
    if generic:
        states, late = [], []
        for number in range(round(until / PERIOD)):
            vehicle.step(*follower.guidance(plan.legs, vehicle.state, number * PERIOD), PERIOD)
            states.append(vehicle.state)
            late.append(0.0)
    else:
        states, late = follow(vehicle, Track(plan.legs), until)
    return judge(plan, states, late, _column(vehicle.log(), "altitude")[1:])


def _column(log: np.ndarray, name: str) -> np.ndarray:
    """Return a column of a vehicle's log ``[T, 11]``, by its name in :data:`LOG_COLUMNS`."""
    return log[:, LOG_COLUMNS.index(name)]


def summary(name: str, flights: Sequence[FlightErrors]) -> dict[str, float]:
    """Return the figures of some flights, pooled."""
    cross, late, altitude, position = (
        np.concatenate(field) for field in zip(*flights, strict=True)
    )
    return {
        f"{name}_flights": len(flights),
        f"{name}_cross_track_rms_m": float(np.sqrt(np.mean(cross**2))),
        f"{name}_cross_track_p95_m": float(np.percentile(cross, 95)),
        f"{name}_cross_track_max_m": float(cross.max()),
        f"{name}_arrival_rms_s": float(np.sqrt(np.mean(late**2))),
        f"{name}_arrival_p95_s": float(np.percentile(late, 95)),
        f"{name}_arrival_max_s": float(late.max()),
        f"{name}_altitude_max_m": float(altitude.max()),
        f"{name}_position_p95_m": float(np.percentile(position, 95)),
        f"{name}_position_p99_m": float(np.percentile(position, 99)),
        f"{name}_position_max_m": float(position.max()),
    }


def wind_conditions(number: int, turbulence: Literal["none", "light", "moderate"]) -> Conditions:
    """Return 10 m/s of wind from a direction of its own."""
    angle = np.random.default_rng(number).uniform(0.0, 2.0 * math.pi)
    return Conditions(NOMINAL, _WIND * math.cos(angle), _WIND * math.sin(angle), turbulence, number)


def draw_conditions(number: int) -> Conditions:
    """Return light turbulence, wind and a loading drawn from the ranges of the true aircraft."""
    rng = np.random.default_rng(number)
    loading = Loading(
        weight=rng.uniform(6500.0, 8807.0),
        centre_of_gravity=rng.uniform(0.25, 0.38),
        inertia_factor=rng.uniform(0.7, 1.3),
        drag_factor=rng.uniform(0.92, 1.08),
        lift_slope_factor=rng.uniform(0.95, 1.05),
    )
    return wind_conditions(number, "light")._replace(loading=loading)


def within_power(plan: Plan, conditions: Conditions) -> bool:
    """Return whether the airspeed on a plan stays where the aircraft has power left."""
    speed = plan.legs.speed
    east = speed * np.cos(plan.legs.heading) - conditions.wind_east
    north = speed * np.sin(plan.legs.heading) - conditions.wind_north
    air = np.hypot(east, north)
    slowest, fastest = _POWER_SPEEDS
    return bool(air.max() <= fastest and air.min() >= slowest)


def steps() -> dict[str, float]:
    """Return how the autopilot answers steps and ramps, calm air, 2500 m."""
    hold = _fly_commands(70.0, [_Command(0.0, 0.0, 60.0)])
    answers = {
        "hold_60s_speed_change_mps": float(np.ptp(_column(hold, "speed"))),
        "hold_60s_altitude_change_m": float(np.ptp(_column(hold, "altitude"))),
    }
    for speed in _BANKS:
        log = _fly_commands(speed, [_Command(0.0, _turn_rate(30.0, speed), 30.0)])
        bank = -np.degrees(_column(log, "bank"))
        reached = np.argmax(bank >= 29.0)
        name = f"bank_30_at_{speed:.0f}"
        answers[f"{name}_time_s"] = float(_column(log, "time")[reached])
        answers[f"{name}_overshoot_deg"] = float(bank.max() - 30.0)
        answers[f"{name}_altitude_m"] = _largest_altitude_error(log)
    log = _fly_commands(70.0, [_Command(0.0, _turn_rate(40.0, 70.0), 60.0)])
    answers["bank_40_at_70_altitude_m"] = _largest_altitude_error(log)
    for first, last in _RAMPS:
        off = _ramp_errors(first, last)
        name = f"ramp_{first:.0f}_{last:.0f}"
        answers[f"{name}_rms_mps"] = float(np.sqrt(np.mean(off**2)))
        answers[f"{name}_max_mps"] = float(np.abs(off).max())
    return answers


class _Command(NamedTuple):
    """What the autopilot is told for a while."""

    acceleration: float  # m/s^2
    yaw_rate: float  # rad/s, positive to the left
    seconds: float


def _fly_commands(speed: float, commands: Sequence[_Command]) -> np.ndarray:
    """Return the log ``[T, 11]`` of commands that begin at a speed, m/s."""
    vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, speed))
    for command in commands:
        for _ in range(round(command.seconds / PERIOD)):
            vehicle.step(command.acceleration, command.yaw_rate, PERIOD)
    return vehicle.log()


def _turn_rate(bank: float, speed: float) -> float:
    """Return the turn rate of a bank, degrees, at a speed, m/s; rad/s."""
    return GRAVITY * math.tan(math.radians(bank)) / speed


def _largest_altitude_error(log: np.ndarray) -> float:
    return float(np.abs(_column(log, "altitude") - _ALTITUDE).max())


def _ramp_errors(first: float, last: float) -> np.ndarray:
    """Return how far the speed is from that of a ramp between two speeds, m/s, ``[T]``."""
    rate, lasts = math.copysign(_RAMP, last - first), abs(last - first) / _RAMP
    log = _fly_commands(first, [_Command(rate, 0.0, lasts), _Command(0.0, 0.0, 10.0)])
    ramp = first + rate * np.minimum(_column(log, "time"), lasts)
    return _column(log, "speed") - ramp


def digest(vehicle: C208Vehicle | None = None) -> str:
    """Return a hash of every number of a flight in turbulence, of a vehicle that is reset or of a
    new one.
    """
    start: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.3, 75.0)
    conditions = Conditions(NOMINAL, 6.0, -8.0, "moderate", 7)
    if vehicle is None:
        vehicle = C208Vehicle(start, "ex", conditions)
    else:
        vehicle.reset(start, conditions)
    for number in range(600):
        vehicle.step(0.2 * math.sin(0.02 * number), 0.03 * math.cos(0.013 * number), PERIOD)
    return hashlib.sha256(vehicle.log().tobytes()).hexdigest()


def reproducibility() -> dict[str, bool]:
    """Return whether a flight is the same to the last bit after a reset, in a new instance and in a
    new process.
    """
    vehicle = C208Vehicle(VehicleState(10.0, 0.0, 2.0, 60.0), "ex", Conditions(turbulence="light"))
    first = digest()
    vehicle.step(0.1, 0.02, 5.0)
    again, fresh = digest(vehicle), digest()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        other = pool.apply(digest)
    return {
        "bit_identical_after_reset": again == first,
        "bit_identical_new_instance": fresh == first,
        "bit_identical_new_process": other == first,
    }


def resident_memory() -> float:
    """Return the memory held now, MiB; where the system does not say, the largest so far."""
    status = Path("/proc/self/statm")
    if status.exists():
        return int(status.read_text().split()[1]) * resource.getpagesize() / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        2**20 if sys.platform == "darwin" else 2**10
    )


def memory_growth(resets: int) -> dict[str, float]:
    """Return how the memory grows over resets of one aircraft."""
    vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, 70.0))

    def again(count: int) -> None:
        for number in range(count):
            vehicle.reset(VehicleState(0.0, 0.0, 0.001 * number, 60.0 + number % 30), CALM)

    again(50)
    before = resident_memory()
    again(resets)
    return {"resets": resets, "growth_over_resets_mib": resident_memory() - before}


def outcomes(count: int, seed: int) -> dict[str, float]:
    """Return how often the policy solves encounters in closed loop, flown by the surrogate and by
    the aircraft.
    """
    policy = Policy.load()
    environments = {"surrogate": DeconflictionEnv(), "aircraft": C208Env()}
    solved, lost = dict.fromkeys(environments, 0), dict.fromkeys(environments, 0)
    for name, environment in environments.items():
        for number in range(count):
            observation, info = environment.reset(seed=seed, options={"encounter": number})
            while info["outcome"] == "flying":
                observation, *_, info = environment.step(policy(observation))
            solved[name] += info["outcome"] == "reached"
            lost[name] += info["outcome"] == "violation"
    figures: dict[str, float] = {"policy_encounters": count}
    for name in environments:
        figures |= {f"policy_{name}_goals": solved[name], f"policy_{name}_violations": lost[name]}
    return figures


def pace() -> dict[str, float]:
    """Return how much faster than real time the aircraft flies on one core: the median of five
    flights.
    """
    ratios: dict[str, list[float]] = {"physics": [], "autopilot": []}
    for _ in range(5):
        vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, 75.0))
        began = time.perf_counter()
        for number in range(4000):
            vehicle.step(0.0, 0.02 * math.sin(0.01 * number), PERIOD)
        middle = time.perf_counter()
        for _ in range(24_000):
            vehicle.fdm.exec.run()
        after = time.perf_counter()
        ratios["autopilot"].append(400.0 / (middle - began))
        ratios["physics"].append(400.0 / (after - middle))
    return {f"{name}_times_real_time": float(np.median(values)) for name, values in ratios.items()}


def fly_point_mass(plan: Plan) -> FlightErrors:
    """Fly a plan with the point mass that plans are made for."""
    states, late = follow(
        PointMassVehicle(over_ground(plan.own, NO_WIND, 0.0)),
        Track(plan.legs),
        float(plan.times[-1]),
    )
    return judge(plan, states, late, np.full(len(states), _ALTITUDE))


def fly_in_conditions(
    name: str, plans: Sequence[Plan], conditions_of: Callable[[int], Conditions]
) -> dict[str, Any]:
    """Return the figures of plans that are flown in conditions by their number."""
    errors, powered, lost, too_slow = [], [], [], 0
    for number, plan in enumerate(plans):
        conditions = conditions_of(number)
        try:
            flight_errors = fly_plan(plan, conditions)
        except StartError:
            # Down the wind the plan's ground speed is below the stall.
            too_slow += 1
            continue
        except FlightError as problem:
            lost.append(f"{number}: {problem}")
            continue
        errors.append(flight_errors)
        if within_power(plan, conditions):
            powered.append(flight_errors)
    figures: dict[str, Any] = {
        f"{name}_flights_lost": len(lost),
        f"{name}_flights_too_slow_to_begin": too_slow,
    }
    figures |= summary(name, errors)
    if lost:
        figures[f"{name}_reasons"] = lost
    if powered:
        figures |= summary(f"{name}_within_power", powered)
    return figures


def following_figures(plans: Sequence[Plan]) -> dict[str, Any]:
    """Return the figures of plans that are flown in calm air, in wind and turbulence, and with
    random loadings.
    """
    began = time.perf_counter()
    calm = [fly_plan(plan) for plan in plans]
    seconds = time.perf_counter() - began
    simulated = sum(float(plan.times[-1]) + 20.0 for plan in plans)
    generic = [fly_plan(plan, generic=True) for plan in plans[:20]]
    return {
        "following_times_real_time": simulated / seconds,
        **summary("calm", calm),
        **summary("calm_generic_follower", generic),
        **summary("point_mass", [fly_point_mass(plan) for plan in plans]),
        **fly_in_conditions("wind", plans, lambda number: wind_conditions(number, "none")),
        **fly_in_conditions("rough", plans, lambda number: wind_conditions(number, "moderate")),
        **fly_in_conditions("loaded", plans, draw_conditions),
    }


def main() -> None:
    """Measure and print."""
    options = _parse()
    hold_to_one_core()
    figures: dict[str, Any] = {"benchmark": "c208", "seed": options.seed}
    figures |= steps() | pace() | reproducibility()
    plans = plans_of(options.plans, options.scenario, options.seed)
    if not plans:
        raise InputError(
            f"none of {options.plans} plans of {options.scenario} is SAFE; expected more --plans"
        )
    figures |= following_figures(plans)
    if options.encounters:
        figures |= outcomes(options.encounters, options.seed)
    figures |= memory_growth(options.resets)
    show(figures)
    report(figures, ("jsbsim", "numpy"))


def _parse() -> argparse.Namespace:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--plans", type=whole(1), default=100, help="plans made; SAFE ones are flown (default 100)")
    add("--scenario", default="circle", help="scenario of the encounters (default circle)")
    add("--seed", type=whole(0), default=0, help="seed of the encounters (default 0)")
    add(
        "--resets",
        type=whole(1),
        default=3_000,
        help="resets over which memory is watched (default 3000)",
    )
    help_text = "encounters flown by the policy in closed loop (default 300)"
    add("--encounters", type=whole(0), default=300, help=help_text)
    return parser.parse_args()


if __name__ == "__main__":
    run_cli(main)
