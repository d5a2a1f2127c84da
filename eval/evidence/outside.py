"""How often the monitor of the input says ``outside_domain``: ``python -m eval.evidence.outside
--data DIR``.

Flights of the policy among nominal traffic, whose reports are then changed as sensors, links and
other traffic do it.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial, reduce
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from agents.assurance.inputs import believed, blank, update
from agents.assurance.thresholds import Cause, Thresholds
from agents.planner.request.options import Options
from agents.policy import novelty
from agents.policy.domain import excess, traffic
from agents.policy.inference import Policy
from agents.policy.set_features import SetInputs
from commands.command import Parser, run_cli
from commands.files import write_file
from envs.aircraft import Aircraft, Ratios, new_aircraft
from envs.angles import wrap
from envs.draws import normals
from envs.encounters import Encounter, pad
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.perception import Sensor, carry_back, perceive
from envs.scenarios import scenario
from envs.starts import OF_INTRUDERS, encounters_of_seed, join
from envs.tracking.tracker import Reports, Sightings, belief, observe
from envs.trees import map_leaves, take
from envs.wind import NO_WIND
from eval.stats.intervals import share

_BEGIN = 10  # time steps of true reports before a shift begins
_NOVEL_EVERY = 5  # time steps
_STARTS = 200  # encounters of each scenario and aircraft whose starts make the box
_FLOWN = 4  # of these, those whose flights do


Random: TypeAlias = np.random.Generator


class Flights(NamedTuple):
    """Flights at T times, the ownship ``[T, N]``, intruders ``[T, N, K]``; nan after the end of a
    flight.
    """

    own: VehicleState[Air]
    seen: VehicleState[Air]
    """As reported."""
    true: VehicleState[Air]
    goal: tuple[np.ndarray, np.ndarray]
    std: tuple[float, float]
    """Declared, of position and velocity, m and m/s."""


def fly_reported(starts: Encounter, policy: Policy, aircraft: Aircraft, seed: int) -> Flights:
    """Fly encounters by the policy, and report their intruders with the noise of their sensors."""
    from eval.flights.simulate import ByPolicy, fly
    from eval.flights.trajectories import TrajectoryRecorder

    recorder = TrajectoryRecorder(starts)
    resolver = ByPolicy(policy.for_aircraft(aircraft, outside="allow"))
    fly(starts, resolver, aircraft, recorder=recorder)
    flown = recorder.stack()
    others: VehicleState[Air] = VehicleState(
        *(np.where(starts.mask, field, np.nan) for field in flown.intruders)
    )
    sensor = starts.sensor
    std = float(np.max(sensor.position_std)), float(np.max(sensor.velocity_std))
    seen = _report(others, sensor, aircraft.dt, seed) if max(std) > 0.0 else others
    return Flights(flown.own, seen, others, (starts.goal_x, starts.goal_y), std)


def _report(others: VehicleState[Air], sensor: Sensor, dt: float, seed: int) -> VehicleState[Air]:
    """Return the reports of intruders ``[T, N, K]``, time steps of dt, s, apart."""
    first = _at(others, 0)
    before = carry_back(first, dt, np), carry_back(first, 2.0 * dt, np)
    steps, count, most = others.x.shape
    reports = []
    for number in range(steps):
        now = _at(others, number)
        noise = np.moveaxis(normals(seed, 0, count, (4, most), stream=number + 1), 1, 0)
        reports.append(perceive(now, *before, sensor, noise, dt, np))
        before = now, before[0]
    return map_leaves(lambda *fields: np.stack(fields), *reports)


def _at(states: VehicleState[Air], step: int) -> VehicleState[Air]:
    """Return states ``[T, ...]`` at one of their times."""
    return map_leaves(lambda field: field[step], states)


def flag(flights: Flights, policy: Policy, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Return which flights are flagged, and for which reason, bool ``[N]``: as the assured loop
    sees them.
    """
    thresholds = Thresholds.for_plans(Options.for_aircraft(aircraft)).in_wind(NO_WIND)
    count, most = flights.seen.x.shape[1:]
    memory = blank(count, most, np.full(count, aircraft.limits.speed_max))
    causes, new = np.zeros(count, np.int32), np.zeros(count, bool)
    box = novelty.shipped_box(policy.sha256)
    sightings: Sightings[Air] | None = None
    wrong = np.zeros(count, bool)
    for number, (own, reported) in enumerate(_steps(flights)):
        mask = np.isfinite(reported.x)
        time = number * aircraft.dt
        sightings = observe(sightings, Reports(reported, *flights.std), time, mask)
        wrong |= (_contradict(sightings, time, thresholds.intruder_age) & mask).any(axis=-1)
        given = believed(time, own, sightings, mask, thresholds.turn_time)
        memory, _own, _traffic, _causes, of_each = update(memory, given, thresholds)
        causes |= np.bitwise_or.reduce(of_each, axis=-1)
        if box is not None and number % _NOVEL_EVERY == 0:
            rows = np.flatnonzero(mask.any(axis=-1))
            moment = _Moment(
                own, given.intruders, mask & np.isfinite(given.intruders.x), flights.goal
            )
            beyond = novelty.excess(box, _inputs(rows, moment, aircraft))
            new[rows] |= (beyond[0] > 0.0).any(axis=-1) | (beyond[1] > 0.0).any(axis=(-1, -2))
    outside = (causes & int(Cause.OUTSIDE_RANGE)) != 0
    return {"range": outside, "consistency": wrong, "novelty": new}


def _contradict(sightings: Sightings[Air], time: float, oldest: float) -> np.ndarray:
    """Return of which intruders positions and velocities differ, scatter by more than they declare,
    or stand still for longer than ``oldest``, s, bool ``[N, K]``.
    """
    tracks = sightings.tracks
    declared, shown = tracks.newest, tracks.agreement
    found = belief(tracks).bias > 0.0
    found |= shown.position_std > declared.position_std
    found |= shown.velocity_std > declared.velocity_std
    return np.asarray(found | (time - sightings.time > oldest))


class _Moment(NamedTuple):
    """What the network sees of flights ``[N]`` at a time."""

    own: VehicleState[Air]
    seen: VehicleState[Air]  # [N, K]
    mask: np.ndarray  # which intruders exist, bool [N, K]
    goal: tuple[np.ndarray, np.ndarray]  # m
    # D over the intruders' own separations, [N, K]; None: 1
    distance_scale: np.ndarray | None = None


def _inputs(rows: np.ndarray, moment: _Moment, aircraft: Aircraft) -> SetInputs:
    """Return the network's inputs of some flights of all."""
    own, seen, mask, goal, distance_scale = take(moment, rows)
    there: VehicleState[Air] = VehicleState(*(np.where(mask, field, 0.0) for field in seen))
    return novelty.inputs_of(own, there, mask, goal, aircraft, distance_scale)


def _steps(flights: Flights) -> Iterator[tuple[VehicleState[Air], VehicleState[Air]]]:
    """Yield the ownships and the reports of each time."""
    for number in range(len(flights.own.x)):
        yield _at(flights.own, number), _at(flights.seen, number)


def inside(flights: Flights, aircraft: Aircraft) -> np.ndarray:
    """Return which flights have intruders that truly stay inside the operating domain, bool
    ``[N]``.
    """
    allowed, true = traffic(aircraft), flights.true
    turn = np.abs(wrap(np.diff(true.heading, axis=0), np)) / aircraft.dt
    fast = (
        excess(allowed["intruder_speed"], np.nan_to_num(true.speed, nan=aircraft.limits.speed_max))
        > 0.0
    )
    sharp = excess(allowed["intruder_turn_rate"], np.nan_to_num(turn)) > 0.0
    return np.asarray(~(fast | np.concatenate([sharp, sharp[-1:]])).any(axis=(0, 2)))


# Shifts: each takes the reports and random numbers, and returns other reports, from some seconds
# on.


def _fly_at_pace(
    seen: VehicleState[Air], random: Random, aircraft: Aircraft, pace: tuple[float, float]
) -> VehicleState[Air]:
    """Let each fly its path at another speed, so that places and velocities agree."""
    speed = random.uniform(*pace, seen.x.shape[1:]) * aircraft.limits.speed_max
    factor = speed / seen.speed[0]
    x, y = (field[0] + factor * (field - field[0]) for field in (seen.x, seen.y))
    return seen._replace(x=x, y=y, speed=seen.speed * factor)


def _fly_turns(seen: VehicleState[Air], random: Random, aircraft: Aircraft) -> VehicleState[Air]:
    """Let each turn on and on, at two to four times the greatest rate of the domain."""
    rate = random.uniform(2.0, 4.0, seen.x.shape[1:]) * random.choice([-1.0, 1.0], seen.x.shape[1:])
    angle = rate * aircraft.limits.yaw_rate_max * aircraft.dt
    late = np.maximum(np.arange(len(seen.x)) - _BEGIN, 0)[:, None, None]
    heading = seen.heading[0] + angle * late
    chord = seen.speed * aircraft.dt * np.sinc(np.where(late > 0, angle, 0.0) / (2.0 * math.pi))
    middle = heading - np.where(late > 0, 0.5 * angle, 0.0)
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)])[:, 1:]
    x, y = (
        np.concatenate([start[:1], start[0] + np.cumsum(way, 0)])
        for start, way in zip(seen[:2], steps, strict=True)
    )
    return VehicleState(x, y, wrap(heading, np), seen.speed)


def _displace(seen: VehicleState[Air], random: Random, aircraft: Aircraft) -> VehicleState[Air]:
    """Displace each for good, by half a separation to three."""
    angle, far = (
        random.uniform(*ends, seen.x.shape[1:]) for ends in ((-math.pi, math.pi), (0.5, 3.0))
    )
    far = far * aircraft.separation
    later = (np.arange(len(seen.x)) >= _BEGIN)[:, None, None]
    return seen._replace(
        x=seen.x + later * far * np.cos(angle), y=seen.y + later * far * np.sin(angle)
    )


def _of_time(
    seen: VehicleState[Air],
    random: Random,
    aircraft: Aircraft,
    when: Callable[[np.ndarray, Random], np.ndarray],
) -> VehicleState[Air]:
    """Report the states of other times than the stamps say."""
    wanted = when(np.arange(len(seen.x)), random)
    early, ends = np.minimum(wanted, 0)[:, None, None] * aircraft.dt, np.isnan(seen.x)
    found = map_leaves(lambda field: np.where(ends, np.nan, field[np.maximum(wanted, 0)]), seen)
    way = found.speed * early
    return found._replace(
        x=found.x + way * np.cos(found.heading), y=found.y + way * np.sin(found.heading)
    )


def _noisier(seen: VehicleState[Air], random: Random, aircraft: Aircraft) -> VehicleState[Air]:
    """Add noise, so that it is three times what the scenario ``noisy`` declares."""
    extra, allowed = math.sqrt(8.0) * random.standard_normal((4, *seen.x.shape)), traffic(aircraft)
    place, drift = allowed["position_std"][1], allowed["velocity_std"][1]
    vx = seen.speed * np.cos(seen.heading) + drift * extra[2]
    vy = seen.speed * np.sin(seen.heading) + drift * extra[3]
    return VehicleState(
        seen.x + place * extra[0], seen.y + place * extra[1], np.arctan2(vy, vx), np.hypot(vx, vy)
    )


SHIFTS: dict[str, Callable[[VehicleState[Air], Random, Aircraft], VehicleState[Air]]] = {
    "intruders at 1.5 to 2.5 of the greatest speed": partial(_fly_at_pace, pace=(1.5, 2.5)),
    "intruders at up to 0.3 of it": partial(_fly_at_pace, pace=(0.02, 0.3)),
    "turns at 2 to 4 times the greatest rate": _fly_turns,
    "place jumps by 0.5 to 3 separations": _displace,
    "velocity in knots": lambda seen, *_: seen._replace(speed=1.943844 * seen.speed),
    "velocity with its axes exchanged": lambda seen, *_: seen._replace(
        heading=wrap(0.5 * math.pi - seen.heading, np)
    ),
    "heading with the wrong sign": lambda seen, *_: seen._replace(heading=wrap(-seen.heading, np)),
    "frozen, with new stamps": partial(_of_time, when=lambda step, _: np.minimum(step, _BEGIN)),
    "each repeated for 5 s, with new stamps": partial(_of_time, when=lambda step, _: step // 5 * 5),
    "stamps off by up to 4 s": partial(
        _of_time, when=lambda step, random: step - random.integers(0, 5, step.size)
    ),
    "stamps of a clock twice as fast": partial(_of_time, when=lambda step, _: step // 2),
    "noise of three times what is declared": _noisier,
    "a constant delay of 5 s, not declared": partial(_of_time, when=lambda step, _: step - 5),
}
"""By what they do. The last one cannot be seen: nothing in the reports contradicts it."""


def measure_rates(count: int, seed: int, data: Path | None, policy: Policy) -> dict[str, Any]:
    """Return the rates: of alarms in nominal flights, and of detections by shift."""
    result: dict[str, Any] = {"nominal": {}, "shifts": {}}
    one = policy.aircraft
    bases = {}
    for name, starts in _nominal_starts(count, seed, data, one).items():
        flights = bases[name] = fly_reported(starts, policy, one, seed)
        within = inside(flights, one)
        flagged = {reason: each[within] for reason, each in flag(flights, policy, one).items()}
        result["nominal"][name] = _rates(flagged, within.sum())
        result["nominal"][name]["outside"] = int(np.count_nonzero(~within))
    random = np.random.default_rng(seed)
    for name, shift in SHIFTS.items():
        base = bases["`noisy`" if shift is _noisier else "`maneuvering`"]
        changed = base._replace(seen=shift(base.seen, random, one))
        result["shifts"][name] = _rates(flag(changed, policy, one), count)
    return result


def _nominal_starts(
    count: int, seed: int, data: Path | None, aircraft: Aircraft
) -> dict[str, Encounter]:
    """Return the encounters of nominal traffic by what they are called; those of public data where
    its folder is known.
    """
    from eval.config import TracksConfig, TrafficConfig
    from eval.flights.sources import draw, read_model_traffic, read_tracks

    scenarios = {
        "`circle`": scenario("circle", aircraft),
        "`maneuvering`": scenario("maneuvering", aircraft),
        "`noisy`": scenario("noisy", aircraft, turn_rate=aircraft.limits.yaw_rate_max),
        "`multi`, 2 to 6": scenario("multi", aircraft, intruders=(2, 6)),
    }
    starts = {
        name: encounters_of_seed(sampled, seed, 0, count) for name, sampled in scenarios.items()
    }
    if data is not None:
        path = data / "encounter_models/uncor_1200code_v2p1.txt"
        model = read_model_traffic(path, TrafficConfig(), aircraft)
        starts["Lincoln's model"] = draw(model, seed, 0, count)[0]
        path = data / "lincoln_lab/encounters.json"
        recorded = read_tracks(path, aircraft, TracksConfig())
        starts["recorded, Lincoln Laboratory"] = recorded.starts
    return starts


def _rates(found: dict[str, np.ndarray], count: int) -> dict[str, Any]:
    """Return the share of flagged flights, and how many there are for each reason."""
    any_of = reduce(np.logical_or, found.values())
    return {"flagged": share(np.count_nonzero(any_of), int(count), 0.95)} | {
        name: int(np.count_nonzero(each)) for name, each in found.items()
    }


def training_box(policy: Policy, count: int, seed: int) -> novelty.Box:
    """Return the box of the network's inputs in flights of the scenarios that it was trained with,
    of so many aircraft.

    A scenario of the user's own must have been registered: nothing that the policy file names is
    imported (``ConfigError``).
    """
    sizes = policy.inputs.own_size, policy.inputs.intruder_size
    low: list[np.ndarray] = [np.full(size, np.inf) for size in sizes]
    high = [-each for each in low]
    for number in range(count):
        aircraft = _of_family(policy, seed, number)
        starts = _training_starts(policy, aircraft, seed, own=number == 0)
        for moment in _moments(starts, policy, aircraft, seed):
            rows = np.flatnonzero(np.isfinite(moment.own.x))
            found = _inputs(rows, moment, aircraft)
            for place, values in enumerate((found.own, found.traffic[moment.mask[rows]])):
                low[place] = np.minimum(low[place], values.min(axis=0, initial=np.inf))
                high[place] = np.maximum(high[place], values.max(axis=0, initial=-np.inf))
        print(f"aircraft {number + 1} of {count}", flush=True)
    own, each = (np.stack(pair) for pair in zip(low, high, strict=True))
    return novelty.Box(own, each)


def _training_starts(
    policy: Policy, aircraft: Aircraft, seed: int, *, own: bool
) -> list[Encounter]:
    """Return encounters of each scenario of the policy's training for an aircraft, ``[N]`` each;
    ``own``: it is the policy's, whose traffic is as the scenario has it.
    """
    from agents.config.world import ScenarioConfig

    trained = policy.metadata["training"]["config"]
    wanted = [one for part in (trained, *trained["phases"]) for one in part.get("scenarios", ())]
    span = [speed / aircraft.limits.speed_max for speed in traffic(aircraft)["intruder_speed"]]
    starts = []
    for one in wanted:
        given = ScenarioConfig(**one).model_dump(exclude_none=True)
        given |= {"units": "aircraft", "attempts": 200}
        if not own:
            given["intruder_speed"] = span
        sampled = ScenarioConfig(**given).scenario(aircraft)
        encounters = encounters_of_seed(sampled, seed, 0, _STARTS, heeds=OF_INTRUDERS)
        starts.append(pad(_of_one_form(encounters, aircraft), policy.most, np))
    return starts


def _of_one_form(encounters: Encounter, aircraft: Aircraft) -> Encounter:
    """Return encounters of any scenario so that they can be joined: with a separation of each
    intruder, all of which are reported and take no notice of the ownship.
    """
    separation = encounters.separation
    if separation is None:
        separation = np.full(encounters.mask.shape, aircraft.separation)
    return encounters._replace(separation=separation, coverage=None, reaction=None)


def _moments(
    starts: Sequence[Encounter], policy: Policy, aircraft: Aircraft, seed: int
) -> Iterator[_Moment]:
    """Yield what the network sees at all starts, and every few steps of some flights."""
    first = reduce(join, starts)
    others: VehicleState[Air] = VehicleState(
        *(np.where(first.mask, field, np.nan) for field in first.intruders)
    )
    distance_scale = aircraft.separation / first.separation
    yield _Moment(
        first.own, others, np.isfinite(others.x), (first.goal_x, first.goal_y), distance_scale
    )
    some = reduce(join, (take(one, slice(0, _FLOWN)) for one in starts))
    flights = fly_reported(some, policy, aircraft, seed)
    for own, seen in list(_steps(flights))[::_NOVEL_EVERY]:
        distance_scale = aircraft.separation / some.separation
        yield _Moment(own, seen, np.isfinite(seen.x), flights.goal, distance_scale)


def _of_family(policy: Policy, seed: int, number: int) -> Aircraft:
    """Return the policy's own aircraft, the two at the ends of all ranges of the family, then
    random ones.
    """
    if number == 0:
        return policy.aircraft
    if number > len(("low", "high")):
        from eval.family.aircraft import draw_aircraft

        return draw_aircraft(seed, number).aircraft()
    family, fast = policy.metadata["family"], policy.aircraft.limits.speed_max
    unit = policy.aircraft.time_unit
    slow, brake, gain, radius = (family[name][number - 1] for name in Ratios._fields)
    limits = Limits(
        speed_min=slow * fast,
        speed_max=fast,
        acceleration_min=brake * fast / unit,
        acceleration_max=gain * fast / unit,
        yaw_rate_max=1.0 / (radius * unit),
    )
    return new_aircraft(limits, policy.aircraft.separation)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the rates, or make the box anew, and print what was found as JSON."""
    from commands.command import whole
    from eval.runner.options import extension_option, load_extensions

    parser = Parser(prog="python -m eval.evidence.outside", description=__doc__)
    add = parser.add_argument
    add(
        "--encounters",
        type=whole(1),
        default=400,
        metavar="N",
        help="of each kind, or aircraft (default: 400)",
    )
    add("--seed", type=whole(0), default=0, metavar="N", help="of the encounters (default: 0)")
    add(
        "--data",
        type=Path,
        metavar="DIR",
        help="folder of public data; without it those encounters are left out",
    )
    add("--box", type=Path, metavar="FILE", help="write the box of the inputs in training instead")
    extension_option(parser)
    options: argparse.Namespace = parser.parse_args(arguments)
    load_extensions(options.extension)
    policy = Policy.load()
    if options.box is not None:
        box = training_box(policy, options.encounters, options.seed)
        bounds = {"own": box.own, "each": box.traffic}
        made = {"policy": policy.sha256} | {
            name: np.round(values, 4).tolist() for name, values in bounds.items()
        }
        write_file(options.box, json.dumps(made) + "\n")
        return 0
    print(
        json.dumps(
            measure_rates(options.encounters, options.seed, options.data, policy), allow_nan=False
        )
    )
    return 0


if __name__ == "__main__":
    run_cli("eval.evidence.outside:main")
