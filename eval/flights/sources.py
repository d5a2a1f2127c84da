"""Where encounters come from: a sampled scenario, a user's file, recorded tracks, or an encounter
model.
"""

import math
import sys
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from commands.command import visible
from envs.aircraft import Aircraft
from envs.encounters import Encounter, EncounterError, Scenario
from envs.formats import encounter_file
from envs.formats.adsb_file import is_adsb
from envs.formats.adsb_pairs import Nearby, adsb_pairs
from envs.formats.lincoln_file import read_lincoln, tracks_of
from envs.formats.track_files import read_daidalus
from envs.starts import encounters_of_seed
from envs.traffic.encounter_model import CLIMB, LAYER, read_model
from envs.traffic.model_traffic import ModelTraffic, Stratum, encounters_with
from envs.traffic.replay import Replay, replay
from envs.traffic.tracks import Repairs, TrackError, sum_of_repairs
from envs.trees import take
from eval.config import FILE, MODEL, EncountersConfig, TracksConfig, TrafficConfig

_DONE = {
    "not_finite": "rows without a valid value dropped",
    "out_of_order": "rows out of order dropped",
    "filled": "rows missing in gaps",
    "stale": "repeated positions dropped",
    "impossible": "rows that no aircraft could fly dropped",
    "split": "flights divided",
    "velocity": "velocities taken from positions",
}

Source: TypeAlias = Scenario | Encounter | Replay | ModelTraffic
"""A scenario to draw from, the encounters of a file, recorded ones, or a model's traffic to draw
from.
"""


def read_source(
    config: EncountersConfig, aircraft: Aircraft
) -> tuple[Source, tuple[str, ...] | None]:
    """Return what a configuration names, and the names of the encounters where it is a finite
    number of them.

    A file that cannot be used raises ``ConfigError``, ``EncounterError`` or ``TrackError``.
    """
    if config.file is None:
        return config.sampled_scenario(aircraft), None
    if config.prefix == MODEL:
        return read_model_traffic(config.file, config.traffic(), aircraft), None
    if config.prefix == FILE:
        source, names = encounter_file.read(config.file, aircraft)
        return source, tuple(names)
    recorded = read_tracks(config.file, aircraft, config.tracks)
    return recorded, recorded.names


def read_model_traffic(path: Path, how: TrafficConfig, aircraft: Aircraft) -> ModelTraffic:
    """Return the traffic of a model's file; a bad one, or own speeds beyond the limits, raise
    ``EncounterError``.
    """
    limits, unit = aircraft.limits, aircraft.separation
    numbers = {
        "own_speed": (limits.speed_min, limits.speed_max),
        "miss": unit,
        "min_initial_separation": unit,
    }
    numbers |= {name: value for name, value in how if value is not None}
    numbers["field_of_view"] = math.radians(numbers.pop("field_of_view_deg"))
    numbers["strata"] = tuple(Stratum(*stratum) for stratum in how.strata)
    if how.latency > 2.0 * aircraft.dt:
        raise EncounterError(
            f"latency is {how.latency:g} s; expected at most two time steps of the aircraft, "
            f"{2.0 * aircraft.dt:g} s"
        )
    low, high = numbers["own_speed"]
    if low < limits.speed_min or high > limits.speed_max:
        reach = f"{limits.speed_min:g} to {limits.speed_max:g} m/s, the ownship's limits"
        raise EncounterError(
            f"own_speed is [{low:g}, {high:g}] m/s; expected a range within {reach}"
        )
    model = read_model(path)
    if how.vertical_miss is not None:
        names = [variable.name for variable in model.initial]
        for name in (LAYER, CLIMB):
            if name not in names or model.boundaries[names.index(name)] is None:
                raise EncounterError(
                    f"{path} has no {name!r} with edges of its bins; expected vertical_miss null"
                )
    return ModelTraffic(model, aircraft, **numbers)


def read_tracks(path: Path, aircraft: Aircraft, how: TracksConfig) -> Replay:
    """Return the encounters of a file of recorded tracks; its name's end and its beginning say of
    which kind it is.

    A file that cannot be used, or of which no encounter can be flown, raises ``TrackError``.
    """
    weights: Mapping[str, float] | None = None
    repairs, grounded = Repairs(), Counter[str]()
    if path.suffix in (".daa", ".xyz"):
        (own, *others), repairs = read_daidalus(path, repair=how.repair, max_gap=how.max_gap)
        encounters = [(path.stem, own, others)]
    elif path.name.endswith((".json", ".json.gz")):
        if is_adsb(path):
            nearby = Nearby(how.within, how.vertical, how.lead)
            encounters, repairs = adsb_pairs(
                path,
                nearby,
                aircraft,
                repair=how.repair,
                max_gap=how.max_gap,
                grounded=grounded,
            )
        else:
            read = read_lincoln(path, repair=how.repair)
            repairs = sum_of_repairs([encounter.repairs for encounter in read])
            weights = {str(encounter.number): encounter.weight for encounter in read}
            flown = ((str(encounter.number), tracks_of(encounter)) for encounter in read)
            encounters = [(name, own, [other]) for name, (own, other) in flown]
    else:
        raise TrackError(f"{path} ends in {path.suffix!r}; expected .json, .json.gz, .daa or .xyz")
    recorded = replay(
        encounters,
        aircraft,
        how.ahead,
        weights=weights,
        repairs=repairs,
        altitudes=how.altitudes,
    )
    if not grounded:
        return recorded
    grounded_text = f"{grounded.total()} reports of {len(grounded)} aircraft on the ground"
    return recorded._replace(left_out=(grounded_text, *recorded.left_out))


def draw(
    source: Source, seed: int, first: int, count: int, *, heeds: Collection[str] = ()
) -> tuple[Encounter, np.ndarray]:
    """Return the encounters ``first .. first + count - 1`` and their weights, 1 where there are
    none; ``heeds`` as of :func:`envs.starts.encounters_of_seed`.

    One that meets the scenario's conditions in none of its attempts raises ``EncounterError``.
    """
    if isinstance(source, ModelTraffic):
        return encounters_with(source, seed, first, count)
    if isinstance(source, Replay):
        return take((source.starts, source.weights), slice(first, first + count))
    if isinstance(source, Scenario):
        starts = encounters_of_seed(source, seed, first, count, heeds=heeds)
        return starts, np.ones(count)
    return take(source, slice(first, first + count)), np.ones(count)


def most_intruders(source: Source) -> int:
    """Return the greatest number of intruders of an encounter."""
    if isinstance(source, Scenario):
        return source.intruders[1]
    if isinstance(source, ModelTraffic):
        return 1
    mask = source.starts.mask if isinstance(source, Replay) else source.mask
    return int(np.max(np.count_nonzero(mask, axis=-1)))


def describe_tracks(source: Source) -> dict[str, Any]:
    """Return what a summary says of recorded tracks: encounters left out, and repairs; of others
    none were needed.
    """
    if not isinstance(source, Replay):
        return {"left_out": [], "repairs": None}
    return {"left_out": list(source.left_out), "repairs": source.repairs._asdict()}


def say(source: Source) -> None:
    """Print which recorded encounters are left out and what was repaired, if anything was."""
    description = describe_tracks(source)
    for sentence in description["left_out"]:
        print(f"left out: {visible(sentence)}", file=sys.stderr)
    repaired = [
        f"{count} {_DONE[name]}" for name, count in (description["repairs"] or {}).items() if count
    ]
    if repaired:
        print(f"repaired: {', '.join(repaired)}", file=sys.stderr)
