# pyright: reportMissingImports=false
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

from envs.edge.yaml import YamlError, check_distinct

_OURS = "rlcas_"


def refuse_unknown_parameters(node: Any, known: Iterable[str]) -> None:
    """Raise ValueError for values given for parameters that a node does not have, once its own are
    declared.
    """
    # rclpy keeps what was given, on the command line or in files, for parameters that are declared
    # later.
    unknown = [name for name in node._parameter_overrides if not node.has_parameter(name)]
    if unknown:
        raise ValueError(
            "; ".join(
                f"{name} is no parameter of {node.get_name()}{_near(name, known)}"
                for name in unknown
            )
        )


def refuse_unknown_nodes(arguments: Sequence[str], known: Sequence[str]) -> None:
    """Raise ValueError for parameters, in files or arguments, for a node of ours of no
    known name.
    """
    for flag, value in itertools.pairwise(arguments):
        sections, where = [], value
        if flag == "--params-file":
            if Path(value).exists() and not Path(value).is_file():
                raise ValueError(f"{value} is not a regular file, expected a parameter file")
            try:
                text = Path(value).read_text(encoding="utf-8")
                # ROS takes the last of two values and says nothing.
                check_distinct(text)
                full = list(_sections(yaml.safe_load(text)))
            except YamlError as problem:
                raise ValueError(f"{value}: {problem}") from None
            except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError):
                continue  # ROS refuses it itself
            for name in full:
                if full.count(name) > 1:
                    raise ValueError(f"{value}: the section of {name} stands twice")
            sections = [name.rpartition("/")[2] for name in full]
        elif flag in ("-p", "--param") and ":" in value.partition(":=")[0]:
            sections, where = [value.partition(":")[0].rpartition("/")[2]], f"{flag} {value}"
        for name in sections:
            # A second node of a kind is called after it, such as rlcas_translator_2.
            if name.startswith(_OURS) and not any(
                f"{name}_".startswith(f"{one}_") for one in known
            ):
                raise ValueError(
                    f"{where} has parameters for {name}, which is no node{_near(name, known)}"
                )


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


def _near(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(known), 1)
    return f"; the nearest is {near[0]}" if near else ""
