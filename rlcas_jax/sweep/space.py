"""The space of a hyper-parameter search: keys of the training configuration, each with a range or choices."""

import json
import math
import random
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic.fields import FieldInfo

from agents.config.keys import expected, field_at, keys, nearest, shown
from agents.config.load import ConfigError
from rlcas_jax.config import TrainConfig

if TYPE_CHECKING:
    from optuna.trial import Trial

__all__ = ["Objective", "Parameter", "check", "overrides", "parse"]

Objective = Literal["success", "score"]

_TRIED = 64  # combinations with the other keys that are tried for a value that is not valid by itself
_FIXED = ("name", "seed", "evaluation", "checkpoint", "phases", "aircraft")
_SCORES = ("world.reward_violation", "world.reward_goal", "world.reward_timeout")


class Parameter(NamedTuple):
    """A key that varies: between two numbers, both included, or among choices."""

    key: str  # dotted, list items by their index
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    step: float | None = None
    whole: bool = False  # a range of whole numbers
    choices: tuple[str, ...] = ()  # as --set takes them; empty for a range

    def suggest(self, trial: "Trial") -> Any:
        """Return the value that Optuna suggests for a trial."""
        if self.choices:
            return trial.suggest_categorical(self.key, self.choices)
        if self.whole:
            return trial.suggest_int(self.key, int(self.low), int(self.high), step=int(self.step or 1), log=self.log)
        return trial.suggest_float(self.key, self.low, self.high, step=self.step, log=self.log)

    def ends(self) -> tuple[Any, ...]:
        """Return the values that are checked before the search."""
        return self.choices or (self.low, self.high)


def parse(entries: Mapping[str, Any], source: Path | str, objective: Objective) -> tuple[Parameter, ...]:
    """Read the entries of a space file.

    Args:
        entries: dotted key of the training configuration -> ``{low, high, log, step}`` or ``{choices}``.
        source: what an error sentence names.
        objective: keys that change its meaning are refused, because trials could not be compared.

    Raises:
        ConfigError: a key is unknown or fixed, or an entry is not usable.
    """
    if not entries:
        raise ConfigError(f"{source}: it names no key; expected some, such as ppo.learning_rate: {{low: .., high: ..}}")
    fixed = _FIXED + (_SCORES if objective == "score" else ())
    return tuple(_parameter(key, entry, f"{source}: {key}", fixed) for key, entry in entries.items())


def overrides(values: Mapping[str, Any]) -> list[str]:
    """Return a trial's values as the ``KEY=VALUE`` of ``--set``."""
    return [f"{key}={value}" for key, value in values.items()]


def check(space: tuple[Parameter, ...], source: Path | str, load: Callable[[list[str]], TrainConfig]) -> None:
    """Find out whether each choice and both ends of each range are valid, alone or with some values of the others.

    Args:
        space: the search space.
        source: what an error sentence names.
        load: ``KEY=VALUE`` texts -> configuration, raises ConfigError.

    Raises:
        ConfigError: a value is not.
    """
    draw = random.Random(0)
    for parameter, value in ((p, value) for p in space for value in p.ends()):
        problems = []
        for others in _combinations(space, parameter, draw):
            try:
                load(overrides(others | {parameter.key: value}))
                break
            except ConfigError as problem:
                problems.append(re.sub("^--set:? ", "", str(problem)))
        else:
            raise ConfigError(f"{source}: {problems[0]}")


def _combinations(space: tuple[Parameter, ...], but: Parameter, draw: random.Random) -> Iterator[dict[str, Any]]:
    yield {}
    others = [parameter for parameter in space if parameter is not but]
    for _ in range(_TRIED if others else 0):
        yield {parameter.key: draw.choice(parameter.ends()) for parameter in others}


def _parameter(key: str, entry: Any, where: str, fixed: tuple[str, ...]) -> Parameter:
    field = field_at(TrainConfig, key.split("."))
    if not isinstance(field, FieldInfo):
        close = nearest(key, [known.name.replace("[]", ".0") for known in keys(TrainConfig)])
        hint = f"did you mean {close}?" if close else "expected a key of the training configuration, see train --help"
        raise ConfigError(f"{where} is unknown; {hint}")
    if any(key == one or key.startswith(f"{one}.") for one in fixed):
        raise ConfigError(f"{where} cannot be searched, because trials would not be compared on equal terms")
    if not isinstance(entry, dict) or not {"choices", "low"} & set(entry):
        raise ConfigError(f"{where} is {shown(entry)}; expected {{low, high}} or {{choices}}")
    known = ("choices",) if "choices" in entry else ("low", "high", "log", "step")
    for name in entry:
        if name not in known:
            close = nearest(name, known)
            raise ConfigError(f"{where}.{name} is unknown; " + (f"did you mean {close}?" if close else f"use {known}"))
    return _choices(key, entry["choices"], where) if "choices" in entry else _range(key, entry, where, expected(field))


def _choices(key: str, values: Any, where: str) -> Parameter:
    if not isinstance(values, list) or len(values) < 2:
        raise ConfigError(f"{where}.choices is {shown(values)}; expected a list of at least 2 values")
    # A text stands as it is; JSON of anything else is YAML in one line.
    texts = tuple(value if isinstance(value, str) else json.dumps(value) for value in values)
    if len(set(texts)) < len(texts):
        raise ConfigError(f"{where}.choices is {shown(values)}; expected every value once")
    return Parameter(key, choices=texts)


def _range(key: str, entry: Mapping[str, Any], where: str, kind: str) -> Parameter:
    whole = "a whole number" in kind
    if not whole and "a number" not in kind:
        raise ConfigError(f"{where} is no number; expected {{choices: [...]}}")
    values: tuple[Any, ...] = tuple(entry.get(name) for name in ("low", "high", "step", "log"))
    low, high, step, log = values
    for name, value in (("low", low), ("high", high), ("step", step)):
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        if name == "step" and value is None:
            continue
        if not number or (whole and value % 1):
            raise ConfigError(f"{where}.{name} is {shown(value)}; expected {'a whole number' if whole else 'a number'}")
    if not low < high:
        raise ConfigError(f"{where}.low is {shown(low)}; expected less than high, {shown(high)}")
    if not isinstance(log, bool | None):
        raise ConfigError(f"{where}.log is {shown(log)}; expected true or false")
    if log and (low <= 0.0 or step is not None):
        raise ConfigError(f"{where}.log is true; expected low above 0 and no step")
    if step is not None and (step <= 0 or abs((high - low) / step - round((high - low) / step)) > 1e-9):
        raise ConfigError(f"{where}.step is {shown(step)}; expected a whole part of high less low, {high - low:g}")
    return Parameter(key, low, high, bool(log), step, whole)
