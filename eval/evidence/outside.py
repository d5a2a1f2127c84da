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
from envs.encounters import Encounter, pad
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.perception import perceive_flights
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
    reported: VehicleState[Air]
    """As reported."""
    true: VehicleState[Air]
    goal: tuple[np.ndarray, np.ndarray]
    std: tuple[float, float]
    """Declared, of position and velocity, m and m/s."""


def fly_reported(starts: Encounter, policy: Policy, aircraft: Aircraft, seed: int) -> Flights:
    """Fly encounters by the policy, and report their intruders with the noise of their sensors."""
    from eval.flights.simulate import ByPolicy, fly, sensor_noise
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
    noise = sensor_noise(seed, 0, *starts.mask.shape)
    reported = perceive_flights(others, sensor, noise, aircraft.dt) if max(std) > 0.0 else others
    return Flights(flown.own, reported, others, (starts.goal_x, starts.goal_y), std)


def flag(flights: Flights, policy: Policy, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Return which flights are flagged, and for which reason, bool ``[N]``: as the assured loop
    sees them.
    """
    thresholds = Thresholds.for_plans(Options.for_aircraft(aircraft)).in_wind(NO_WIND)
    count, most = flights.reported.x.shape[1:]
    memory = blank(count, most, np.full(count, aircraft.limits.speed_max))
    causes, new = np.zeros(count, np.int32), np.zeros(count, bool)
    box = novelty.shipped_box(policy.sha256)
    sightings: Sightings[Air] | None = None
    wrong = np.zeros(count, bool)
    for number, (own, reported) in enumerate(_steps(flights)):
        mask = np.isfinite(reported.x)
        time = number * aircraft.dt
        sightings = observe(sightings, Reports(reported, *flights.std), time, mask)
        wrong |= (contradict(sightings, time, thresholds.intruder_age) & mask).any(axis=-1)
        beliefs = believed(time, own, sightings, mask)
        memory, _own, _traffic, _causes, of_each = update(memory, beliefs, thresholds)
        causes |= np.bitwise_or.reduce(of_each, axis=-1)
        if box is not None and number % _NOVEL_EVERY == 0:
            rows = np.flatnonzero(mask.any(axis=-1))
            moment = _Moment(
                own, beliefs.intruders, mask & np.isfinite(beliefs.intruders.x), flights.goal
            )
            beyond = novelty.excess(box, _inputs(rows, moment, aircraft))
            new[rows] |= (beyond[0] > 0.0).any(axis=-1) | (beyond[1] > 0.0).any(axis=(-1, -2))
    outside = (causes & int(Cause.OUTSIDE_RANGE)) != 0
    return {"range": outside, "consistency": wrong, "novelty": new}


def contradict(sightings: Sightings[Air], time: float, oldest: float) -> np.ndarray:
    """Return of which intruders positions and velocities differ, scatter by more than they declare,
    or stand still for longer than ``oldest``, s, bool ``[N, K]``.
    """
    tracks = sightings.tracks
    declared, shown = tracks.newest, tracks.agreement
    contradicted = belief(tracks).bias > 0.0
    contradicted |= shown.position_std > declared.position_std
    contradicted |= shown.velocity_std > declared.velocity_std
    return np.asarray(contradicted | (time - sightings.time > oldest))


class _Moment(NamedTuple):
    """What the network sees of flights ``[N]`` at a time."""

    own: VehicleState[Air]
    intruders: VehicleState[Air]  # [N, K]
    mask: np.ndarray  # which intruders exist, bool [N, K]
    goal: tuple[np.ndarray, np.ndarray]  # m
    # D over the intruders' own separations, [N, K]; None: 1
    distance_scale: np.ndarray | None = None


def _inputs(rows: np.ndarray, moment: _Moment, aircraft: Aircraft) -> SetInputs:
    """Return the network's inputs of some flights of all."""
    own, intruders, mask, goal, distance_scale = take(moment, rows)
    present: VehicleState[Air] = VehicleState(*(np.where(mask, field, 0.0) for field in intruders))
    return novelty.inputs_of(own, present, mask, goal, aircraft, distance_scale)


def _steps(flights: Flights) -> Iterator[tuple[VehicleState[Air], VehicleState[Air]]]:
    """Yield the ownships and the reports of each time."""
    for number in range(len(flights.own.x)):
        yield take(flights.own, number), take(flights.reported, number)


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
    reported: VehicleState[Air], random: Random, aircraft: Aircraft, pace: tuple[float, float]
) -> VehicleState[Air]:
    """Let each fly its path at another speed, so that places and velocities agree."""
    speed = random.uniform(*pace, reported.x.shape[1:]) * aircraft.limits.speed_max
    factor = speed / reported.speed[0]
    x, y = (field[0] + factor * (field - field[0]) for field in (reported.x, reported.y))
    return reported._replace(x=x, y=y, speed=reported.speed * factor)


def _fly_turns(
    reported: VehicleState[Air], random: Random, aircraft: Aircraft
) -> VehicleState[Air]:
    """Let each turn on and on, at two to four times the greatest rate of the domain."""
    rate = random.uniform(2.0, 4.0, reported.x.shape[1:]) * random.choice(
        [-1.0, 1.0], reported.x.shape[1:]
    )
    angle = rate * aircraft.limits.yaw_rate_max * aircraft.dt
    late = np.maximum(np.arange(len(reported.x)) - _BEGIN, 0)[:, None, None]
    heading = reported.heading[0] + angle * late
    chord = reported.speed * aircraft.dt * np.sinc(np.where(late > 0, angle, 0.0) / (2.0 * math.pi))
    middle = heading - np.where(late > 0, 0.5 * angle, 0.0)
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)])[:, 1:]
    x, y = (
        np.concatenate([start[:1], start[0] + np.cumsum(way, 0)])
        for start, way in zip(reported[:2], steps, strict=True)
    )
    return VehicleState(x, y, wrap(heading, np), reported.speed)


def _displace(reported: VehicleState[Air], random: Random, aircraft: Aircraft) -> VehicleState[Air]:
    """Displace each for good, by half a separation to three."""
    angle, far = (
        random.uniform(*ends, reported.x.shape[1:]) for ends in ((-math.pi, math.pi), (0.5, 3.0))
    )
    far = far * aircraft.separation
    later = (np.arange(len(reported.x)) >= _BEGIN)[:, None, None]
    return reported._replace(
        x=reported.x + later * far * np.cos(angle), y=reported.y + later * far * np.sin(angle)
    )


def _of_time(
    reported: VehicleState[Air],
    random: Random,
    aircraft: Aircraft,
    when: Callable[[np.ndarray, Random], np.ndarray],
) -> VehicleState[Air]:
    """Report the states of other times than the stamps say."""
    steps = when(np.arange(len(reported.x)), random)
    early, ends = np.minimum(steps, 0)[:, None, None] * aircraft.dt, np.isnan(reported.x)
    states = map_leaves(lambda field: np.where(ends, np.nan, field[np.maximum(steps, 0)]), reported)
    way = states.speed * early
    return states._replace(
        x=states.x + way * np.cos(states.heading), y=states.y + way * np.sin(states.heading)
    )


def _noisier(reported: VehicleState[Air], random: Random, aircraft: Aircraft) -> VehicleState[Air]:
    """Add noise, so that it is three times what the scenario ``noisy`` declares."""
    extra, allowed = (
        math.sqrt(8.0) * random.standard_normal((4, *reported.x.shape)),
        traffic(aircraft),
    )
    place, drift = allowed["position_std"][1], allowed["velocity_std"][1]
    vx = reported.speed * np.cos(reported.heading) + drift * extra[2]
    vy = reported.speed * np.sin(reported.heading) + drift * extra[3]
    return VehicleState(
        reported.x + place * extra[0],
        reported.y + place * extra[1],
        np.arctan2(vy, vx),
        np.hypot(vx, vy),
    )


SHIFTS: dict[str, Callable[[VehicleState[Air], Random, Aircraft], VehicleState[Air]]] = {
    "intruders at 1.5 to 2.5 of the greatest speed": partial(_fly_at_pace, pace=(1.5, 2.5)),
    "intruders at up to 0.3 of it": partial(_fly_at_pace, pace=(0.02, 0.3)),
    "turns at 2 to 4 times the greatest rate": _fly_turns,
    "place jumps by 0.5 to 3 separations": _displace,
    "velocity in knots": lambda reported, *_: reported._replace(speed=1.943844 * reported.speed),
    "velocity with its axes exchanged": lambda reported, *_: reported._replace(
        heading=wrap(0.5 * math.pi - reported.heading, np)
    ),
    "heading with the wrong sign": lambda reported, *_: reported._replace(
        heading=wrap(-reported.heading, np)
    ),
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
    aircraft = policy.aircraft
    bases = {}
    for name, starts in _nominal_starts(count, seed, data, aircraft).items():
        flights = bases[name] = fly_reported(starts, policy, aircraft, seed)
        within = inside(flights, aircraft)
        flagged = {
            reason: flags[within] for reason, flags in flag(flights, policy, aircraft).items()
        }
        result["nominal"][name] = _rates(flagged, within.sum())
        result["nominal"][name]["outside"] = int(np.count_nonzero(~within))
    random = np.random.default_rng(seed)
    for name, shift in SHIFTS.items():
        base = bases["`noisy`" if shift is _noisier else "`maneuvering`"]
        changed = base._replace(reported=shift(base.reported, random, aircraft))
        result["shifts"][name] = _rates(flag(changed, policy, aircraft), count)
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


def _rates(flagged: dict[str, np.ndarray], count: int) -> dict[str, Any]:
    """Return the share of flagged flights, and how many there are for each reason."""
    any_of = reduce(np.logical_or, flagged.values())
    return {"flagged": share(np.count_nonzero(any_of), int(count), 0.95)} | {
        name: int(np.count_nonzero(flags)) for name, flags in flagged.items()
    }


def training_box(policy: Policy, count: int, seed: int) -> novelty.Box:
    """Return the box of the network's inputs in flights of the scenarios that it was trained with,
    of so many aircraft.

    A scenario of the user's own must have been registered: nothing that the policy file names is
    imported (``ConfigError``).
    """
    sizes = policy.inputs.own_size, policy.inputs.intruder_size
    low: list[np.ndarray] = [np.full(size, np.inf) for size in sizes]
    high = [-bound for bound in low]
    for number in range(count):
        aircraft = _of_family(policy, seed, number)
        starts = _training_starts(policy, aircraft, seed, own=number == 0)
        for moment in _moments(starts, policy, aircraft, seed):
            rows = np.flatnonzero(np.isfinite(moment.own.x))
            inputs = _inputs(rows, moment, aircraft)
            for place, values in enumerate((inputs.own, inputs.traffic[moment.mask[rows]])):
                low[place] = np.minimum(low[place], values.min(axis=0, initial=np.inf))
                high[place] = np.maximum(high[place], values.max(axis=0, initial=-np.inf))
        print(f"aircraft {number + 1} of {count}", flush=True)
    own_bounds, traffic_bounds = (np.stack(pair) for pair in zip(low, high, strict=True))
    return novelty.Box(own_bounds, traffic_bounds)


def _training_starts(
    policy: Policy, aircraft: Aircraft, seed: int, *, own: bool
) -> list[Encounter]:
    """Return encounters of each scenario of the policy's training for an aircraft, ``[N]`` each;
    ``own``: it is the policy's, whose traffic is as the scenario has it.
    """
    from agents.config.world import ScenarioConfig

    trained = policy.metadata["training"]["config"]
    scenarios = [
        fields for part in (trained, *trained["phases"]) for fields in part.get("scenarios", ())
    ]
    span = [speed / aircraft.limits.speed_max for speed in traffic(aircraft)["intruder_speed"]]
    starts = []
    for fields in scenarios:
        settings = ScenarioConfig(**fields).model_dump(exclude_none=True)
        settings |= {"units": "aircraft", "attempts": 200}
        if not own:
            settings["intruder_speed"] = span
        sampled = ScenarioConfig(**settings).scenario(aircraft)
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
    first_encounters = reduce(join, (take(encounters, slice(0, _FLOWN)) for encounters in starts))
    flights = fly_reported(first_encounters, policy, aircraft, seed)
    for own, reported in list(_steps(flights))[::_NOVEL_EVERY]:
        distance_scale = aircraft.separation / first_encounters.separation
        yield _Moment(own, reported, np.isfinite(reported.x), flights.goal, distance_scale)


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
        content = {"policy": policy.sha256} | {
            name: np.round(values, 4).tolist() for name, values in bounds.items()
        }
        write_file(options.box, json.dumps(content) + "\n")
        return 0
    print(
        json.dumps(
            measure_rates(options.encounters, options.seed, options.data, policy), allow_nan=False
        )
    )
    return 0


if __name__ == "__main__":
    run_cli("eval.evidence.outside:main")
