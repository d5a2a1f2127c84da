"""The space of a hyper-parameter search: which keys of the training configuration vary, and between which values."""

import itertools
import json
import math
import random
import re
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from agents.config.keys import field_at, keys, nearest, shown
from agents.config.load import ConfigError
from rlcas_jax.config import TrainConfig

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

__all__ = ["Choices", "Objective", "Parameter", "Range", "check", "overrides", "parse"]

Objective = Literal["success", "score"]
Values = Mapping[str, Any]

_TRIED = 64
"""Combinations with the other keys that are tried for a value that is not valid by itself."""

_FIXED = ("name", "seed", "evaluation", "checkpoint", "world.t_max", "world.goal_radius", "world.vehicle")
_SCORES = ("world.reward_violation", "world.reward_goal", "world.reward_timeout")


class Range(NamedTuple):
    """A number that varies between two bounds, both included; its unit is that of the configuration key."""

    key: str
    """Dotted, list items by their index."""
    low: float
    high: float
    log: bool
    """Draw its logarithm evenly."""
    step: float | None
    whole: bool
    """A whole number."""

    def distribution(self) -> "BaseDistribution":
        """Return what Optuna draws from."""
        from optuna.distributions import FloatDistribution, IntDistribution

        if self.whole:
            return IntDistribution(int(self.low), int(self.high), log=self.log, step=int(self.step or 1))
        return FloatDistribution(self.low, self.high, log=self.log, step=self.step)

    def rounded(self, value: Any) -> Any:
        """Return a drawn number as a person would write it: four digits, within the bounds."""
        if self.whole:
            return value
        digits = 4 if self.step is None else 12
        return min(max(float(f"{value:.{digits}g}"), self.low), self.high)

    def text(self, value: Any) -> str:
        """Return a value as ``--set`` takes it."""
        return repr(int(value) if self.whole else float(value))

    def ends(self) -> list[Any]:
        """Return the values that are checked before the search."""
        return [int(self.low), int(self.high)] if self.whole else [self.low, self.high]


class Choices(NamedTuple):
    """A key that takes one of a few values, each kept as the text that ``--set`` takes."""

    key: str
    texts: tuple[str, ...]

    def distribution(self) -> "BaseDistribution":
        """Return what Optuna draws from."""
        from optuna.distributions import CategoricalDistribution

        return CategoricalDistribution(self.texts)

    def rounded(self, value: Any) -> Any:
        """Return the value as it is."""
        return value

    def text(self, value: Any) -> str:
        """Return a value as ``--set`` takes it."""
        return str(value)

    def ends(self) -> list[Any]:
        """Return the values that are checked before the search: all."""
        return list(self.texts)


Parameter = Range | Choices


def parse(entries: Values, source: Path | str, objective: Objective) -> tuple[Parameter, ...]:
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
    return tuple(_parameter(key, entry, source, objective) for key, entry in entries.items())


def overrides(space: Sequence[Parameter], values: Values) -> list[str]:
    """Return a trial's values as the ``KEY=VALUE`` of ``--set``."""
    return [f"{parameter.key}={parameter.text(values[parameter.key])}" for parameter in space]


def check(space: Sequence[Parameter], source: Path | str, load: Callable[[list[str]], TrainConfig]) -> None:
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
        own = overrides([parameter], {parameter.key: value})
        first: ConfigError | None = None
        for others in itertools.chain([[]], _combinations(space, parameter, draw)):
            try:
                load([*others, *own])
                break
            except ConfigError as problem:
                first = first or problem
        else:
            raise ConfigError(f"{source}: {re.sub('^--set:? ', '', str(first))}")


def _combinations(space: Sequence[Parameter], but: Parameter, draw: random.Random) -> Iterator[list[str]]:
    others = [parameter for parameter in space if parameter is not but]
    for _ in range(_TRIED if others else 0):
        yield overrides(others, {parameter.key: draw.choice(parameter.ends()) for parameter in others})


def _parameter(key: str, entry: Any, source: Path | str, objective: Objective) -> Parameter:
    path = key.split(".")
    field = field_at(TrainConfig, path)
    if not isinstance(field, FieldInfo):
        close = nearest(key, [known.name.replace("[]", ".0") for known in keys(TrainConfig)])
        hint = f"did you mean {close}?" if close else "expected a key of the training configuration, see train --help"
        raise ConfigError(f"{source}: {key} is unknown; {hint}")
    if any(key == fixed or key.startswith(f"{fixed}.") for fixed in _fixed(objective)):
        raise ConfigError(f"{source}: {key} cannot be searched, because trials would not be compared on equal terms")
    where = f"{source}: {key}"
    if not isinstance(entry, dict):
        raise ConfigError(f"{where} is {shown(entry)}; expected {{low, high}} or {{choices}}")
    known = ("choices",) if "choices" in entry else ("low", "high", "log", "step")
    for name in entry:
        if name not in known:
            close = nearest(name, known)
            hint = f"did you mean {close}?" if close else f"expected {', '.join(known)}"
            raise ConfigError(f"{where}.{name} is unknown; {hint}")
    kind = _kind(field.annotation, path[-1].isdecimal())
    return _choices(key, entry["choices"], where, kind) if "choices" in entry else _range(key, entry, where, kind)


def _choices(key: str, values: Any, where: str, kind: Any) -> Choices:
    if not isinstance(values, list) or len(values) < 2:
        raise ConfigError(f"{where}.choices is {shown(values)}; expected a list of at least 2 values")
    # --set takes what belongs to a text as it stands; JSON is YAML in one line.
    texts = tuple(value if kind is str and isinstance(value, str) else json.dumps(value) for value in values)
    if len(set(texts)) < len(texts):
        raise ConfigError(f"{where}.choices is {shown(values)}; expected every value once")
    return Choices(key, texts)


def _range(key: str, entry: Values, where: str, kind: Any) -> Range:
    if kind not in (int, float):
        raise ConfigError(f"{where} is no number; expected {{choices: [...]}}")
    whole = kind is int
    for name in ("low", "high", "step"):
        value: Any = entry.get(name)
        if name == "step" and value is None:
            continue
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        if not number or (whole and value % 1 != 0):
            wanted = "a whole number" if whole else "a number"
            raise ConfigError(f"{where}.{name} is {shown(value)}; expected {wanted}")
    low, high, step, log = float(entry["low"]), float(entry["high"]), entry.get("step"), entry.get("log", False)
    if not low < high:
        raise ConfigError(f"{where}.low is {shown(entry['low'])}; expected less than high, {shown(entry['high'])}")
    if not isinstance(log, bool):
        raise ConfigError(f"{where}.log is {shown(log)}; expected true or false")
    if log and (low <= 0.0 or step is not None):
        raise ConfigError(f"{where}.log is true; expected low above 0 and no step")
    if step is not None and (step <= 0 or abs((high - low) / step - round((high - low) / step)) > 1e-9):
        raise ConfigError(f"{where}.step is {shown(step)}; expected a whole part of high less low, {high - low:g}")
    return Range(key, low, high, log, None if step is None else float(step), whole)


def _fixed(objective: Objective) -> tuple[str, ...]:
    return _FIXED + (_SCORES if objective == "score" else ())


def _kind(annotation: Any, item: bool) -> Any:
    """Return the plain type that a key holds: int, float, str or something else."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(arguments[0], item)
    if origin in (Union, types.UnionType):
        return _kind(next(one for one in arguments if one is not type(None)), item)
    if origin in (tuple, list) and item:
        return _kind(arguments[0], False)
    return annotation
