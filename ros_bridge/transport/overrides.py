"""Parameters given to a node that it does not have, and sections of parameter files for nodes that
there are not.

ROS passes over both silently: with ``separaton: 2000.0`` in a file a node would plan with its
default.
"""

import difflib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from commands.text_file import text_of
from commands.yaml import YamlError, check_distinct

_OURS = "rlcas_"


def refuse_unknown_parameters(node: Any, names: Iterable[str]) -> None:
    """Raise ValueError for values given for parameters that a node does not have, once its own are
    declared.
    """
    # rclpy keeps what was given, on the command line or in files, for parameters that are declared
    # later.
    unknown = [name for name in node._parameter_overrides if not node.has_parameter(name)]
    if unknown:
        raise ValueError(
            "; ".join(
                f"{name} is no parameter of {node.get_name()}{_near(name, names)}"
                for name in unknown
            )
        )


def refuse_unknown_nodes(arguments: Sequence[str], nodes: Sequence[str]) -> None:
    """Raise ValueError for parameters, in files or arguments, for a node of ours of no
    known name, and for a file of parameters that cannot be read.
    """
    for flag, value in itertools.pairwise(arguments):
        sections, place = [], value
        if flag == "--params-file":
            sections = _nodes_of_file(Path(value))
        elif flag in ("-p", "--param") and ":" in value.partition(":=")[0]:
            sections, place = [value.partition(":")[0].rpartition("/")[2]], f"{flag} {value}"
        for name in sections:
            # A second node of a kind is called after it, such as rlcas_translator_2.
            if name.startswith(_OURS) and not any(
                f"{name}_".startswith(f"{node}_") for node in nodes
            ):
                raise ValueError(
                    f"{place} has parameters for {name}, which is no node{_near(name, nodes)}"
                )


def _nodes_of_file(file: Path) -> list[str]:
    """Return the names of the nodes that a file of parameters has sections for, or raise ValueError
    where it is none; what else is wrong in it ROS itself refuses.
    """
    text = text_of(str(file), ValueError)
    try:
        # ROS takes the last of two values and says nothing.
        check_distinct(text)
        # Values stay texts: what they mean is for ROS to say.
        full = list(_sections(yaml.load(text, yaml.BaseLoader)))
    except YamlError as problem:
        raise ValueError(f"{file}: {problem}") from None
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        line = "" if mark is None else f"line {mark.line + 1}: "
        reason = getattr(problem, "problem", None) or str(problem)
        raise ValueError(f"{file}: {line}not valid YAML ({reason})") from None
    except RecursionError:
        raise ValueError(f"{file}: not usable as YAML: it is nested too deeply") from None
    for name in full:
        if full.count(name) > 1:
            raise ValueError(f"{file}: the section of {name} stands twice")
    return [name.rpartition("/")[2] for name in full]


def _sections(tree: Any, inside: str = "") -> Iterator[str]:
    """Yield the full names of the nodes that a file's sections are for; sections inside others are
    in a namespace.
    """
    for name, section in tree.items() if isinstance(tree, dict) else ():
        part = str(name).strip("/")
        full = f"{inside}/{part}" if part else inside
        if isinstance(section, dict) and "ros__parameters" in section:
            yield full
        elif name != "ros__parameters":
            yield from _sections(section, full)


def _near(name: str, names: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(names), 1)
    return f"; the nearest is {near[0]}" if near else ""
