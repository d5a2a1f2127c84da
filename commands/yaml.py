"""YAML as configurations write it: the plain core of YAML 1.2, and the conversions that lose
nothing.

Of PyYAML, which follows YAML 1.1, ``3e-4`` is a text, ``no`` false and ``1:30`` 90. Here a number
is what looks like one, only ``true`` and ``false`` are booleans, and a repeated key is refused.
"""

import re
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin

import yaml

from commands.text_file import text_of


class YamlError(ValueError):
    """Text that is not the YAML of a configuration; the message says where and why."""


_RESOLVERS = (
    ("null", r"~|null|", ["~", "n", ""]),
    ("bool", r"true|false", ["t", "f"]),
    ("int", r"[-+]?(?:0|[1-9][0-9_]*)", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:(?:[0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?|[0-9][0-9_]*[eE][-+]?[0-9]+|\.inf)|\.nan",
        list("-+0123456789."),
    ),
)

_MOST = 1_000_000  # characters of a file


class _Loader(yaml.SafeLoader):
    """Loads the plain core of YAML 1.2; keys are texts, each once."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node; what stands for another node is refused, for a few letters may stand for
        a billion values.
        """
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise YamlError(
                f"line {event.start_mark.line + 1}: *{event.anchor} is an alias; expected the "
                "value itself"
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys: set[str] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            line = key_node.start_mark.line + 1
            if not isinstance(key, str):
                raise YamlError(f"line {line}: key {key!r} is no text")
            if key in keys:
                raise YamlError(f"line {line}: key {key} stands twice")
            keys.add(key)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    """Writes every value where it stands."""

    def ignore_aliases(self, data: object) -> bool:
        return True


for _class in (_Loader, _Dumper):
    _class.yaml_implicit_resolvers = {}
    for _tag, _pattern, _first in _RESOLVERS:
        _class.add_implicit_resolver(
            f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), _first
        )


def _sequence(dumper: yaml.SafeDumper, items: Any) -> yaml.Node:
    flat = all(not isinstance(item, (list, tuple, Mapping)) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat)


_Dumper.add_representer(list, _sequence)
_Dumper.add_representer(tuple, _sequence)
_Dumper.add_multi_representer(Path, lambda dumper, path: dumper.represent_str(str(path)))


def read(source: Path | str) -> Any:
    """Return the mapping of a YAML file, ``{}`` of an empty one, or the value of a text.

    Raises:
        YamlError: it is not the YAML of a configuration.
    """
    if isinstance(source, str):
        return parse(source, repr(source))
    text = text_of(str(source), YamlError)
    if len(text) > _MOST:
        raise YamlError(f"{source}: {len(text)} characters; expected at most {_MOST}")
    values = parse(text, str(source))
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise YamlError(f"{source}: expected keys with values, got {values!r:.60}")
    return values


def check_distinct(text: str) -> None:
    """Raise a YamlError where a key stands twice in a mapping of YAML that others will read.

    The text may be any YAML 1.1; text that is none raises ``yaml.YAMLError``.
    """
    todo, visited = [yaml.compose(text, yaml.SafeLoader)], set[int]()
    while todo:
        node = todo.pop()
        # What is an alias of a mapping stands in the tree more than once.
        if node is None or id(node) in visited:
            continue
        visited.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            todo += node.value
        if isinstance(node, yaml.MappingNode):
            keys: set[object] = set()
            for key, value in node.value:
                todo.append(value)
                if not isinstance(key, yaml.ScalarNode):
                    continue
                # One value may be written in two ways, such as 1 and 0x1.
                merges = key.tag == "tag:yaml.org,2002:merge"
                constructed = None if merges else yaml.SafeLoader("").construct_object(key)
                if key.value in keys or (not merges and (type(constructed), constructed) in keys):
                    line = key.start_mark.line + 1
                    raise YamlError(f"line {line}: key {key.value} stands twice")
                keys |= {key.value, (type(constructed), constructed)}


def parse(text: str, name: str) -> Any:
    """Return the content of a text, whose name messages say; may raise a YamlError."""
    try:
        return yaml.load(text, _Loader)  # a SafeLoader
    except YamlError as problem:
        raise YamlError(f"{name}: {problem}") from None
    # PyYAML converts what carries a tag, such as !!int, without looking at it first.
    except (
        yaml.YAMLError,
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
        RecursionError,
    ) as problem:
        mark = getattr(problem, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        text_of_problem = " ".join((getattr(problem, "problem", None) or str(problem)).split())
        raise YamlError(f"{name}: {where}not valid YAML ({text_of_problem})") from None


def write(values: Any) -> str:
    """Return plain values (also tuples and paths) as YAML text that :func:`read` gives back."""
    return yaml.dump(values, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


def coerce(value: Any, annotation: Any) -> Any:
    """Convert a value to the annotated type where that loses nothing, and else return it as it is.

    Whole floats become int, sequences list or tuple as annotated, texts paths.
    """
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return coerce(value, arguments[0])
    if origin in (Union, types.UnionType):
        if type(value) in arguments:
            return value
        changed = (coerce(value, argument) for argument in arguments)
        return next((new for new in changed if new is not value), value)
    if origin in (list, tuple) and isinstance(value, (list, tuple)):
        kinds = (
            arguments
            if origin is tuple and arguments[-1] is not Ellipsis
            else (arguments[0],) * len(value)
        )
        if len(kinds) == len(value):
            value = [coerce(item, kind) for item, kind in zip(value, kinds, strict=True)]
        return origin(value)
    if annotation is int and isinstance(value, float) and value.is_integer():
        return int(value)
    if annotation is Path and isinstance(value, str):
        return Path(value)
    return value
