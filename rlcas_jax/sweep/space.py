"""The space of a hyper-parameter search: keys of the training configuration with Optuna's
distributions.
"""

import json
import math
import random
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from pydantic.fields import FieldInfo

from agents.config.keys import expectation, field_at, keys, moved_to, quote
from agents.config.load import ConfigError
from commands.names import nearest
from rlcas_jax.config import TrainConfig

Space = Mapping[str, BaseDistribution]
"""Distributions by dotted key, list items by their index; choices are texts as ``--set`` takes
them.
"""

_TRIED = (
    64  # combinations with the other keys that are tried for a value that is not valid by itself
)
_FIXED = ("name", "seed", "evaluation", "checkpoint", "phases", "aircraft")


def parse(entries: Mapping[str, Any], source: Path | str) -> Space:
    """Read a space file, dotted key -> ``{low, high, log, step}`` or ``{choices}``; a bad one
    raises a ConfigError.
    """
    if not entries:
        raise ConfigError(
            f"{source}: it names no key; expected some, such as learning_rate: {{low: .., "
            f"high: ..}}"
        )
    return {key: _distribution(key, entry, f"{source}: {key}") for key, entry in entries.items()}


def overrides(values: Mapping[str, Any]) -> list[str]:
    """Return a trial's values as the ``KEY=VALUE`` of ``--set``."""
    return [f"{key}={value}" for key, value in values.items()]


def check(space: Space, source: Path | str, load: Callable[[list[str]], TrainConfig]) -> None:
    """Raise a ConfigError unless each choice and both ends of each range are valid, alone or with
    some of the others.

    Args:
        source: what an error sentence names.
        load: ``KEY=VALUE`` texts -> configuration, raises ConfigError.
    """
    draw = random.Random(0)
    for key, value in (
        (key, value) for key, distribution in space.items() for value in _ends(distribution)
    ):
        others, problems = [name for name in space if name != key], []
        for tried in range(_TRIED if others else 1):
            values = {name: draw.choice(_ends(space[name])) for name in others if tried > 0}
            try:
                load(overrides(values | {key: value}))
                break
            except ConfigError as problem:
                problems.append(re.sub("^--set:? ", "", str(problem)))
        else:
            raise ConfigError(f"{source}: {problems[0]}")


def _ends(distribution: Any) -> tuple[Any, ...]:
    return (
        distribution.choices
        if isinstance(distribution, CategoricalDistribution)
        else (distribution.low, distribution.high)
    )


def _distribution(key: str, entry: Any, where: str) -> BaseDistribution:
    moved = moved_to(TrainConfig, key.split("."))
    if moved is not None:
        raise ConfigError(f"{where} has moved; expected {moved}")
    field = field_at(TrainConfig, key.split("."))
    if not isinstance(field, FieldInfo):
        close = nearest(key, [fields.name.replace("[]", ".0") for fields in keys(TrainConfig)])
        hint = (
            f"did you mean {close}?"
            if close
            else "expected a key of the training configuration, see train --help"
        )
        raise ConfigError(f"{where} is unknown; {hint}")
    if any(key == fixed or key.startswith(f"{fixed}.") for fixed in _FIXED):
        raise ConfigError(
            f"{where} cannot be searched, because trials would not be compared on equal terms"
        )
    fields = (
        {"choices"}
        if isinstance(entry, dict) and "choices" in entry
        else {"low", "high", "log", "step"}
    )
    if not isinstance(entry, dict) or not entry.keys() <= fields:
        raise ConfigError(
            f"{where} is {quote(entry)}; expected {{low, high}}, with log or step, or {{choices}}"
        )
    try:
        if "choices" in entry:
            # A text stands as it is; JSON of anything else is YAML in one line.
            return CategoricalDistribution(
                [c if isinstance(c, str) else json.dumps(c) for c in entry["choices"]]
            )
        kind = expectation(field)
        if "a whole number" in kind:
            return IntDistribution(**entry)
        if "a number" in kind and all(map(math.isfinite, (entry["low"], entry["high"]))):
            return FloatDistribution(**entry)
    except (TypeError, ValueError, KeyError) as problem:
        raise ConfigError(f"{where} is {quote(entry)}: {problem}") from None
    raise ConfigError(
        f"{where} is {quote(entry)}; expected {{choices: [...]}}, or numbers of a key that is one"
    )
