"""What a configuration's keys are: name, kind of value, range, default and meaning, read from the
models.

The texts are the docstrings under the fields; ``--help``, documentation and error sentences are
made from them.
"""

import re
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from commands.extension import is_extension

_KINDS = {
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    str: "a text",
    Path: "a path",
}
_BOUNDS = {
    "gt": "above {}",
    "ge": "at least {}",
    "lt": "below {}",
    "le": "at most {}",
    "min_length": "at least {} of them",
    "max_length": "at most {} of them",
    "multiple_of": "a multiple of {}",
}


class Key(NamedTuple):
    """One key of a configuration."""

    name: str  # dotted; [] stands for each item of a list
    expected: str  # kind and range of its value
    default: str  # as YAML would write it; "required" if there is none
    text: str  # what it does, with its unit


def keys(model: type[BaseModel], prefix: str = "") -> Iterator[Key]:
    """Yield every key of a configuration, those of nested models after the key that holds them.

    A key that merely groups others is left out unless it has a docstring of its own.
    """
    for name, field in model.model_fields.items():
        inner, listed = nested_model(field.annotation)
        dotted = prefix + name
        if inner is None or listed or field.description:
            yield Key(
                dotted,
                expectation(field),
                _default(field),
                " ".join((field.description or "").split()),
            )
        if inner is not None:
            yield from keys(inner, f"{dotted}[]." if listed else f"{dotted}.")


def help_text(model: type[BaseModel]) -> str:
    """Return the keys as plain text for the end of a ``--help``."""
    lines = ["configuration keys (in the YAML file or as --set KEY=VALUE):"]
    for key in keys(model):
        lines += [f"  {key.name}: {key.expected} (default: {key.default})", f"      {key.text}"]
    return "\n".join(lines)


def markdown(
    model: type[BaseModel], *, beside: type[BaseModel] | None = None, but: tuple[str, ...] = ()
) -> str:
    """Return the keys as a Markdown table, without those that ``beside`` has too and those that
    begin with ``but``.
    """
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    shared = set(keys(beside)) if beside is not None else set[Key]()
    for key in keys(model):
        if key not in shared and not key.name.startswith(but):
            cells = (f"`{key.name}`", _short(key.expected), f"`{key.default}`", key.text)
            rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _short(expected: str) -> str:
    """Return what a key takes as a table shows it: ``whole number 1..100`` for one at least 1 and
    at most 100.
    """
    text = re.sub(r"\ba (?=number|whole number|list|text|path|group)", "", expected)
    text = re.sub(r"at least (\S+) and at most (\S+)", r"\1..\2", text)
    for words, sign in (("at least", "≥"), ("at most", "≤"), ("above", ">"), ("below", "<")):
        text = re.sub(rf"\b{words} (?=-?\d)", f"{sign} ", text)
    return text


def field_at(
    model: type[BaseModel], path: Sequence[str | int]
) -> FieldInfo | type[BaseModel] | None:
    """Return the field that a path of keys and list indices leads to; the model for an empty path;
    None: there is none.

    Where a path ends inside a list or tuple of plain values, the answer is the field that holds it.
    """
    node: FieldInfo | type[BaseModel] | None = model
    for step in path:
        if isinstance(node, FieldInfo):
            inner, listed = nested_model(node.annotation)
            if isinstance(step, int) or (listed and step.isdecimal()):
                node = inner if listed and inner is not None else node
                continue
            # Anything else that pydantic puts into a location names a branch of a union, not a key.
            node = inner
        if node is None:
            return None
        if step not in node.model_fields:
            own = node.model_config.get("extra") == "allow" and is_extension(str(step))
            return FieldInfo(annotation=float) if own else None
        node = node.model_fields[str(step)]
    return node


def moved_to(model: type[BaseModel], path: Sequence[str | int]) -> str | None:
    """Return the dotted name that a key of an earlier release has today; None: it was none."""
    holder = field_at(model, path[:-1])
    if isinstance(holder, FieldInfo):
        holder = nested_model(holder.annotation)[0]
    moved: Mapping[str, str] = getattr(holder, "MOVED", {})
    return moved.get(str(path[-1]))


def expectation(field: FieldInfo) -> str:
    """Say what values a field takes: ``a number above 0 and at most 1``.

    Where a validator knows more than the annotation, ``Field(json_schema_extra={"expected": ...})``
    says it.
    """
    extra = field.json_schema_extra
    if isinstance(extra, dict) and "expected" in extra:
        return str(extra["expected"])
    kind, null, _ = _kind(field.annotation).partition(" or null")
    bounds = _bounds(field.metadata)
    return f"{kind}{',' if bounds and kind.startswith('a list') else ''} {bounds}".strip() + null


def quote(value: Any) -> str:
    """Return a value as an error sentence quotes it: YAML in one line, texts in quotes, cut when
    long.
    """
    text = repr(value) if isinstance(value, str) else _yaml_text(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _kind(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return f"{_kind(arguments[0])} {_bounds(arguments[1:])}".strip()
    if origin is Literal:
        return "one of " + ", ".join(str(a) for a in arguments)
    if origin in (Union, types.UnionType):
        return " or ".join("null" if a is type(None) else _kind(a) for a in arguments)
    if origin is tuple and arguments[-1] is not Ellipsis:
        same = len(set(arguments)) == 1
        inside = f"{_kind(arguments[0])} each" if same else ", ".join(_kind(a) for a in arguments)
        return f"a list of {len(arguments)} values ({inside})"
    if origin in (list, tuple, Sequence):
        return f"a list ({_kind(arguments[0])} each)"
    if origin in (dict, Mapping):
        return f"a group of keys ({_kind(arguments[1])} each)"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "a group of keys"
    return _KINDS.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _bounds(metadata: Iterable[Any]) -> str:
    flat = [
        part
        for item in metadata
        for part in (item.metadata if isinstance(item, FieldInfo) else [item])
    ]
    bounds = [(text, getattr(part, name, None)) for part in flat for name, text in _BOUNDS.items()]
    return " and ".join(text.format(f"{value:.10g}") for text, value in bounds if value is not None)


def nested_model(annotation: Any) -> tuple[type[BaseModel] | None, bool]:
    """Return the model that an annotation holds, None if it holds plain values, and whether it is a
    list.
    """
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, False
    in_list = get_origin(annotation) in (list, tuple, Sequence)
    for argument in get_args(annotation):
        model, listed = nested_model(argument)
        if model is not None:
            return model, listed or in_list
    return None, in_list


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    return "the keys below" if isinstance(default, BaseModel) else _yaml_text(default)


def _yaml_text(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_unset=True)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {_yaml_text(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml_text(v) for v in value) + "]"
    return str(value)
