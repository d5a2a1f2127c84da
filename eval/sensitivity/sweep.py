"""Sweeps over what a run holds fixed: a run of its own for every value, all of them on the same
encounters.
"""

import math
from argparse import ArgumentTypeError
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.config.load import ConfigError
from commands.command import real
from commands.names import one_of
from envs.aircraft import PAPER
from envs.scenarios import scenario
from eval.monte_carlo.run import evaluate
from eval.sensitivity.bins import rates, read_run, successes
from eval.stats.paired import pairs, tango


class Parameter(NamedTuple):
    """A number of a scenario that a run holds fixed."""

    unit: str
    values: tuple[float, ...]  # that are flown unless others are named
    largest: float
    label: str


_TURN_DEG = round(math.degrees(scenario("maneuvering", PAPER).heading_change))

PARAMETERS: dict[str, Parameter] = {
    "position_std": Parameter(
        "m", (0, 10, 30, 60, 100), 1_000, "noise of reported positions, one sigma per axis"
    ),
    "velocity_std": Parameter(
        "m/s", (0, 1, 3, 6, 10), 50, "noise of reported velocities, one sigma per axis"
    ),
    "latency": Parameter("s", (0, 0.5, 1, 1.5, 2), 2, "age of the reports"),
    "turn_rate": Parameter(
        "deg/s", (0, 0.5, 1, 2, 3), 3, f"largest turn rate of the intruder, up to {_TURN_DEG}° once"
    ),
}
"""What can be varied; each begins without the disturbance. Distances, angles and speeds vary in
every run.
"""


def change_of(name: str, value: float) -> dict[str, str]:
    """Return what a value of a parameter changes in the scenario, as the configuration
    writes it.
    """
    if name == "turn_rate":
        # Without a rate of its own an intruder that changes its heading turns at the scenario's.
        return {
            "turn_rate_deg_s": f"{value:g}",
            "heading_change_deg": str(_TURN_DEG if value else 0),
        }
    return {name: f"[{value:g}, {value:g}]" if name == "latency" else f"{value:g}"}


class Sweep(NamedTuple):
    """A quantity to vary, and its values."""

    name: str
    values: tuple[float, ...]


def parse_sweep(text: str) -> Sweep:
    """Return what ``NAME`` or ``NAME=V1,V2,...`` asks for; what cannot be varied raises
    ``ConfigError``.
    """
    name, sign, listed = text.partition("=")
    if name in ("wind", "turbulence"):
        raise ConfigError(
            f"--vary {name}: the surrogate has no {name}; expected a run of eval.hifi "
            "with it as DIR"
        )
    if name not in PARAMETERS:
        raise ConfigError(f"--vary {name}: unknown; {one_of(name, PARAMETERS)}")
    parameter = PARAMETERS[name]
    if not sign:
        return Sweep(name, tuple(map(float, parameter.values)))
    try:
        values = [real(0.0, parameter.largest, parameter.unit)(part) for part in listed.split(",")]
    except ArgumentTypeError as problem:
        raise ConfigError(f"--vary {name}: {problem}") from None
    if values != sorted(set(values)) or len(values) < 2:
        raise ConfigError(f"--vary {name}: {listed}; expected at least two values, rising")
    return Sweep(name, tuple(values))


def fly(
    sweep: Sweep, keys: Mapping[str, Any], sets: Sequence[str], folder: Path, *, resume: bool
) -> None:
    """Fly the run of every value below ``folder``, or go on; the first that does not finish raises
    ``UnfinishedError``.
    """
    for value in sweep.values:
        own = [f"changes.{key}={text}" for key, text in change_of(sweep.name, value).items()]
        evaluate(keys, _folder(folder, sweep.name, value), sets=[*sets, *own], resume=resume)


def _folder(folder: Path, name: str, value: float) -> Path:
    return folder / f"{name}_{value:g}"


def collect(sweep: Sweep, folder: Path, confidence: float) -> dict[str, Any]:
    """Return in JSON types what the runs of a sweep found, and the paired differences from the
    first one's success.
    """
    parameter = PARAMETERS[sweep.name]
    runs = [read_run(_folder(folder, sweep.name, value)) for value in sweep.values]
    first = successes(runs[0])
    values = []
    for value, run in zip(sweep.values, runs, strict=True):
        apart = {
            mode: tango(pairs(first[mode], reached), confidence)
            for mode, reached in successes(run).items()
        }
        every = rates(run, np.ones(len(run.table["outcome"]), bool), confidence)
        differences = {mode: difference._asdict() for mode, difference in apart.items()}
        values.append({"value": value, "run": run.path.name} | every | {"difference": differences})
    return {"name": sweep.name, "label": parameter.label, "unit": parameter.unit, "values": values}
