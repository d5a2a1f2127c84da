"""The list of evaluations (configs/evidence.yaml), and their results as they are stored and
published.
"""

import json
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from agents.config.load import ConfigError, Strict
from commands.json_text import RepeatedKeyError, parse_json


class Entry(Strict):
    """An evaluation: the first cell of its row, module and options of a command, encounters in full
    size, a claim.

    In the command ``{n}`` stands for the number of encounters and ``$RLCAS_DATA`` for the folder of
    public data. The claim is a figure, ``>=`` or ``<=``, and a number. With ``cells`` its table is
    cut into cells of the domain; of a table with ``each``, ``parts`` are shown alone (none: all).
    A claim of a ``ratio`` names it, and is not shown in percent. ``missed`` says why a claim is
    missed, where that is known. Without the variable of the environment that it ``needs`` it is not
    run.
    """

    title: str
    command: str
    n: int
    claim: tuple[str, Literal[">=", "<="], float] | None = None
    ratio: str | None = None
    missed: str | None = None
    cells: bool = False
    parts: tuple[str, ...] = ()
    needs: str | None = None


class Reading(Strict):
    """Where the figures of a command are: in a JSON file of its folder ``--out``, or in the last
    line that it prints.

    Of these ``keys`` are published: paths with ``/`` between their parts, ``*`` for any. A command
    that flies in ``chunks`` takes ``--resume`` and ``--scheduler``, one that ``resumes`` the first
    alone; one without a file goes on in its folder by itself.
    """

    file: str | None = None
    keys: tuple[str, ...]
    chunks: bool = False
    resumes: bool = False


class Table(Strict):
    """A table: the results of its rows (none: all), and cells with figures in braces (none: cells
    of the domain).

    With ``each`` it has a row for every part of that figure of its results, such as every shift of
    the traffic; with ``unmet`` only the results that do not meet their target, missed ones first.
    """

    rows: tuple[str, ...] = ()
    each: str | None = None
    unmet: bool = False
    columns: dict[str, str] = Field(default_factory=dict)


class Evidence(Strict):
    """What is evaluated, in the order of importance; readings by module, results and tables by
    name.
    """

    readings: dict[str, Reading]
    results: dict[str, Entry]
    tables: dict[str, Table]

    def choose(self, names: list[str]) -> list[str]:
        """Return the names of results in the list's order, where names may be those of tables; of
        none, all.
        """
        unknown = [name for name in names if name not in self.results and name not in self.tables]
        if unknown:
            names_known = ", ".join([*self.tables, *self.results])
            raise ConfigError(
                f"--only: {unknown[0]!r} is no table and no result; expected some of {names_known}"
            )
        chosen = {
            result
            for name in names
            for result in ([name] if name in self.results else self.rows(name))
        }
        return [name for name in self.results if name in chosen or not names]

    def rows(self, table: str) -> tuple[str, ...]:
        """Return the names of the results of a table."""
        return self.tables[table].rows or tuple(self.results)


def find_figures(
    report: Mapping[str, Any], keys: tuple[str, ...], prefix: str = ""
) -> dict[str, Any]:
    """Return the figures that match one of the keys, by path; a rate with its interval is one
    figure.

    Objects of a list that have names are found by these.
    """
    figures: dict[str, Any] = {}
    for key, value in report.items():
        path, listed = (
            f"{prefix}{key}",
            isinstance(value, list) and value and isinstance(value[0], dict),
        )
        group = {str(item.get("name")): item for item in value} if listed else value
        if isinstance(group, dict) and "value" not in group:
            figures |= find_figures(group, keys, f"{path}/")
        elif any(fnmatchcase(path, pattern) for pattern in keys):
            figures[path] = (
                {k: v for k, v in group.items() if k != "repetitions"}
                if isinstance(group, dict)
                else group
            )
    return figures


def read_results(path: Path) -> dict[str, Any]:
    """Return results by name; none where there is no file."""
    try:
        results = parse_json(path.read_text(encoding="utf-8")) if path.exists() else {}
        return {
            name: result | {"n": int(result["n"])}
            for name, result in results.items()
            if result["policy"] and result["command"]
        }
    except RepeatedKeyError as problem:
        raise ConfigError(f"{path}: {problem}, expected each key once") from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        raise ConfigError(
            f"{path}: is not a file of results; expected what python -m eval.evidence wrote"
        ) from None


def written_results(results: Mapping[str, Any]) -> str:
    """Return the text of a file of results: a line for each."""
    lines = (
        f"{json.dumps(name)}: {json.dumps(result, allow_nan=False)}"
        for name, result in results.items()
    )
    return "{\n" + ",\n".join(lines) + "\n}\n"
