"""Sweeps over what a run holds fixed: a run of its own for every value, all of them on the same encounters."""

import math
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.config.keys import nearest
from agents.config.load import ConfigError
from envs.encounters import SCENARIOS
from eval.monte_carlo import run as monte_carlo
from eval.sensitivity.bins import Run, rates, read_run, successes
from eval.stats.paired import pairs, tango

__all__ = ["PARAMETERS", "Parameter", "Sweep", "collected", "fly", "swept"]


class Parameter(NamedTuple):
    """A number of a scenario that a run holds fixed."""

    label: str
    unit: str
    values: tuple[float, ...]  # that are flown unless others are named
    largest: float
    changes: Callable[[float], dict[str, str]]
    """Value -> what is changed in the scenario, as the configuration writes it."""


_TURN_DEG = round(math.degrees(SCENARIOS["maneuvering"].heading_change))


def _turning(rate: float) -> dict[str, str]:
    # Without a rate of its own an intruder that changes its heading turns at 3 deg/s.
    return {"turn_rate_deg_s": f"{rate:g}", "heading_change_deg": str(_TURN_DEG if rate else 0)}


PARAMETERS: dict[str, Parameter] = {
    "position_std": Parameter(
        "noise of reported positions, one sigma per axis",
        "m",
        (0.0, 10.0, 30.0, 60.0, 100.0),
        1_000.0,
        lambda value: {"position_std": f"{value:g}"},
    ),
    "velocity_std": Parameter(
        "noise of reported velocities, one sigma per axis",
        "m/s",
        (0.0, 1.0, 3.0, 6.0, 10.0),
        50.0,
        lambda value: {"velocity_std": f"{value:g}"},
    ),
    "latency": Parameter(
        "age of the reports", "s", (0.0, 0.5, 1.0, 1.5, 2.0), 2.0, lambda value: {"latency": f"[{value:g}, {value:g}]"}
    ),
    "turn_rate": Parameter(
        f"largest turn rate of the intruder, which turns once by up to {_TURN_DEG}°",
        "deg/s",
        (0.0, 0.5, 1.0, 2.0, 3.0),
        3.0,
        _turning,
    ),
}
"""What can be varied; each begins without the disturbance. Distances, angles and speeds vary in every run."""

_ELSEWHERE = {
    "wind": "the surrogate has no wind",
    "turbulence": "the surrogate has no turbulence",
}


class Sweep(NamedTuple):
    """What shall be varied."""

    name: str
    values: tuple[float, ...]


def swept(text: str) -> Sweep:
    """Return what ``NAME`` or ``NAME=V1,V2,...`` asks for.

    Raises:
        ConfigError: there is no such parameter, or a value is out of its range.
    """
    name, sign, listed = text.partition("=")
    if name in _ELSEWHERE:
        raise ConfigError(
            f"--vary {name}: {_ELSEWHERE[name]}; expected a run of eval.hifi with it, such as --condition moderate, "
            "and its folder as --run"
        )
    if name not in PARAMETERS:
        close = nearest(name, PARAMETERS)
        hint = f"; did you mean {close}?" if close else ""
        raise ConfigError(f"--vary {name}: unknown; expected one of {', '.join(PARAMETERS)}{hint}")
    parameter = PARAMETERS[name]
    if not sign:
        return Sweep(name, parameter.values)
    values = []
    for part in listed.split(","):
        try:
            value = float(part)
        except ValueError:
            raise ConfigError(f"--vary {name}: {part!r} is no number; expected {name}=V1,V2,...") from None
        # Inverted, so that NaN is refused.
        if not 0.0 <= value <= parameter.largest:
            raise ConfigError(
                f"--vary {name}: {value:g} {parameter.unit}; expected 0 to {parameter.largest:g} {parameter.unit}"
            )
        values.append(value)
    if values != sorted(set(values)) or len(values) < 2:
        raise ConfigError(f"--vary {name}: {listed}; expected at least two values, rising")
    return Sweep(name, tuple(values))


def fly(sweep: Sweep, arguments: Sequence[str], out: Path, *, resume: bool) -> int:
    """Fly the run of every value into a folder of its own below ``out``.

    Args:
        sweep: what is varied.
        arguments: of ``eval.monte_carlo``, the same for all values.
        out: folder of the sweeps.
        resume: go on with runs that were begun.

    Returns:
        The exit status of the first run that did not finish, else 0.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``EncounterError``.
    """
    for value in sweep.values:
        folder = folder_of(out, sweep.name, value)
        changes = PARAMETERS[sweep.name].changes(value)
        sets = [part for key, text in changes.items() for part in ("--set", f"changes.{key}={text}")]
        again = ["--resume"] if resume and (folder / "config.yaml").is_file() else []
        # Its table for a person would come once for every value.
        with redirect_stdout(StringIO()):
            status = monte_carlo.main([*arguments, *sets, "--set", "figures=false", *again, "--out", str(folder)])
        if status:
            return status
    return 0


def folder_of(out: Path, name: str, value: float) -> Path:
    """Return the folder of one value's run."""
    return out / f"{name}_{value:g}"


def collected(sweep: Sweep, out: Path, confidence: float) -> dict[str, Any]:
    """Return what the runs of a sweep found, in JSON types.

    Beside the rates of every value stands their difference from those of the first, encounter by encounter.
    """
    parameter = PARAMETERS[sweep.name]
    runs = [read_run(folder_of(out, sweep.name, value)) for value in sweep.values]
    first = successes(runs[0])
    return {
        "name": sweep.name,
        "label": parameter.label,
        "unit": parameter.unit,
        "values": [
            {"value": value, "run": run.path.name}
            | rates(run, np.ones(len(run.table["outcome"]), bool), confidence)
            | {"difference": _differences(run, first, confidence)}
            for value, run in zip(sweep.values, runs, strict=True)
        ],
    }


def _differences(run: Run, first: dict[str, np.ndarray], confidence: float) -> dict[str, Any]:
    """Return each mode's success less that of the first value, with Tango's interval of pairs."""
    return {mode: tango(pairs(first[mode], reached), confidence)._asdict() for mode, reached in successes(run).items()}
