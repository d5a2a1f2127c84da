"""Strict configuration: YAML and ``--set`` overrides in, a frozen model or one clear
sentence out.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic.fields import FieldInfo

from agents.config.keys import expectation, field_at, moved_to, nested_model, quote
from commands.command import ConfigError, Parser
from commands.names import nearest, one_of
from commands.yaml import YamlError, coerce, read, write

__all__ = [
    "AIRCRAFT",
    "VEHICLES",
    "ConfigError",
    "Parser",
    "Strict",
    "dump",
    "file_of",
    "load",
    "validate",
]

AIRCRAFT, VEHICLES = "aircraft/*.yaml", "vehicle_*.yaml"
"""Where aircraft and vehicles stand among the configurations that ship."""

_SHIPPED = Path(__file__).resolve().parents[1] / "configs"

Model = TypeVar("Model", bound="Strict")


class Strict(BaseModel):
    """Base of all configuration models: frozen, no unknown keys, no silent conversions.

    Only what loses nothing is converted: a whole number to a number, a number without a fraction
    (``1e7``) to a whole one, a list to a tuple. The docstring under a field is its text in
    ``--help`` and in the documentation. A model's own checks raise :class:`ConfigError` with a
    sentence that begins with the name of the key that it is about.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        validate_default=True,
        use_attribute_docstrings=True,
    )

    MOVED: ClassVar[Mapping[str, str]] = {}
    """Keys that stood here in an earlier release, with the dotted names that they have today."""

    @model_validator(mode="before")
    @classmethod
    def _convert(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        fields = cls.model_fields
        return {k: coerce(v, fields[k].annotation) if k in fields else v for k, v in data.items()}


def file_of(path: Path, kind: str = "*.yaml") -> Path:
    """Return the file that a path means, or that ships under a name without folder and suffix, such
    as ``quick``.

    Names of a kind stand in ``configs/``. Raises a ConfigError where none of that name ships.
    """
    if path.is_file() or path.suffix or path.name != str(path):
        return path
    before = kind.rpartition("/")[2].partition("*")[0]
    names = {file.stem.removeprefix(before): file for file in sorted(_SHIPPED.glob(kind))}
    if path.name not in names:
        raise ConfigError(
            f"{path.name!r} is no file and no configuration that ships; {one_of(path.name, names)}"
        )
    return names[path.name]


def check_once(overrides: Sequence[str]) -> None:
    """Refuse a key that a command line sets twice, by ``--set`` and by an option of its own or by
    the same one: one of the two values would be lost.

    Raises:
        ConfigError: it names the key and both values.
    """
    values: dict[str, str] = {}
    for text in overrides:
        key, _, value = text.partition("=")
        if key in values and values[key] != value:
            raise ConfigError(f"{key} is given as {values[key]} and as {value}; expected it once")
        values[key] = value


def load(model: type[Model], path: Path | None = None, overrides: Sequence[str] = ()) -> Model:
    """Read a configuration of a model, whose validators find the file's folder as
    ``info.context["folder"]``.

    Args:
        path: YAML file with what differs from the defaults, or the name of one that ships; None for
            the defaults.
        overrides: ``KEY=VALUE`` each, KEY dotted (``ppo.epochs``, ``scenarios.0.weight``),
            VALUE in YAML; later ones win.

    Raises:
        ConfigError: the file cannot be read, or a key or a value is not valid.
    """
    path = None if path is None else file_of(path)
    try:
        values = {} if path is None else read(path)
    except YamlError as problem:
        raise ConfigError(str(problem)) from None
    return validate(model, values, path, [_override(model, values, text) for text in overrides])


def validate(
    model: type[Model], values: Any, path: Path | None = None, named: Sequence[list[str]] = ()
) -> Model:
    """Return plain values, of a file, as a configuration; raise a ConfigError where a key or a
    value is not valid.

    ``named`` are the paths of the keys that the command line changed.
    """
    try:
        return model.model_validate(
            values, context={"folder": Path() if path is None else path.parent}
        )
    except ValidationError as problem:
        raise ConfigError(_sentence(model, problem, path, named)) from None


def dump(model: BaseModel) -> str:
    """Return a configuration as YAML text with every key; :func:`load` of it gives an equal
    model.
    """
    return write(model.model_dump())


def _override(model: type[BaseModel], values: dict[str, Any], text: str) -> list[str]:
    """Write one ``KEY=VALUE`` into the values and return its path of keys."""
    dotted, sign, written = text.partition("=")
    path = [part.strip() for part in dotted.split(".")]
    if not sign or not all(path):
        name, field = next(iter(model.model_fields.items()))
        example = f"{name}={field.get_default(call_default_factory=True)}"
        raise ConfigError(f"--set {text}: expected KEY=VALUE, such as --set {example}")
    node: Any = values
    for depth, step in enumerate(path[:-1]):
        if isinstance(node, dict) and node.get(step) is None:
            node[step] = _start(field_at(model, path[: depth + 1]))
        node = node[_place(node, path, depth, text)]
    place, field = _place(node, path, len(path) - 1, text), field_at(model, path)
    # A text is taken as it stands, though YAML might see a number in it.
    is_text = isinstance(field, FieldInfo) and field.annotation is str
    try:
        node[place] = written if is_text else read(written)
    except YamlError as problem:
        raise ConfigError(f"--set {dotted}: {problem}") from None
    return path


def _place(node: Any, path: Sequence[str], depth: int, text: str) -> str | int:
    """Return by what a step of a path of keys is found in a group or a list; raise a ConfigError
    where it cannot be. ``text`` is the override that says the path.
    """
    step = path[depth]
    if isinstance(node, dict):
        return step
    if not isinstance(node, list):
        raise ConfigError(
            f"--set {text}: {'.'.join(path[:depth])} is {node!r} and has no key {step!r}"
        )
    if not step.isdecimal() or int(step) >= len(node):
        raise ConfigError(
            f"--set {text}: {step!r} is no item of a list of {len(node)}; expected 0, 1, ..."
        )
    return int(step)


def _start(field: FieldInfo | type[BaseModel] | None) -> Any:
    """Return what an override changes a part of, where the file says nothing: the default."""
    if not isinstance(field, FieldInfo) or field.is_required():
        return {}
    default = field.get_default(call_default_factory=True)
    items = default if isinstance(default, (list, tuple)) else [default]
    plain = [
        item.model_dump(exclude_unset=True) if isinstance(item, BaseModel) else item
        for item in items
    ]
    return plain if isinstance(default, (list, tuple)) else plain[0] if plain[0] is not None else {}


def _sentence(
    model: type[BaseModel], problem: ValidationError, path: Path | None, named: Sequence[list[str]]
) -> str:
    """Say in one sentence what is wrong; an unknown key first, because other problems often follow
    from it.
    """
    errors = problem.errors(include_url=False)
    # A list with a bad item is reported a second time, as too short by that item.
    errors = [
        error
        for error in errors
        if not any(_under(error["loc"], other["loc"]) for other in errors if other is not error)
    ]
    first, *others = sorted(errors, key=lambda error: error["type"] != "extra_forbidden")
    location = [str(part) for part in first["loc"]]
    by_override = any(_under(location, keys) or _under(keys, location) for keys in named)
    # A check of the whole that fails may be due to the file or to an override.
    source = ("--set: " if location else "") if by_override else "" if path is None else f"{path}: "
    return f"{source}{_complaint(model, first)}" + (f" (and {len(others)} more)" if others else "")


def _under(path: Sequence[Any], other: Sequence[Any]) -> bool:
    """Return whether the other path goes on from this one or is equal."""
    return list(other[: len(path)]) == list(path)


def _complaint(model: type[BaseModel], error: Any) -> str:
    kind, location, value = error["type"], error["loc"], error["input"]
    key = ".".join(str(part) for part in location)
    if kind == "value_error":
        message = str(error["ctx"]["error"])
        about_key = message.partition(" ")[0] in _model_at(model, location).model_fields
        return message if not key else f"{key}.{message}" if about_key else f"{key}: {message}"
    if kind == "extra_forbidden":
        moved = moved_to(model, location)
        if moved is not None:
            return f"{key} has moved; expected {moved} (its value is {quote(value)})"
        names = list(_model_at(model, location[:-1]).model_fields)
        close = nearest(str(location[-1]), names)
        either = f"expected {'one of ' if len(names) > 1 else ''}{', '.join(names)}"
        hint = f"did you mean {'.'.join(map(str, (*location[:-1], close)))}?" if close else either
        return f"{key} is unknown (its value is {quote(value)}); {hint}"
    field = field_at(model, location)
    expected = expectation(field) if isinstance(field, FieldInfo) else "a group of keys"
    if kind == "missing":
        return f"{key} is missing; expected {expected}"
    if isinstance(location[-1], int) and isinstance(field, FieldInfo):
        expected = f"{'.'.join(map(str, location[:-1]))} to be {expected}"
    mistyped = kind == "literal_error" and isinstance(value, str)
    close = nearest(value, expected.removeprefix("one of ").split(", ")) if mistyped else None
    return f"{key} is {quote(value)}; expected {expected}" + (
        f"; did you mean {close}?" if close else ""
    )


def _model_at(model: type[BaseModel], location: Sequence[str | int]) -> type[BaseModel]:
    holder = field_at(model, location)
    return (
        nested_model(holder.annotation)[0] if isinstance(holder, FieldInfo) else holder
    ) or model
