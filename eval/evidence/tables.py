"""The published tables: generated from results, between markers in README and docs."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError
from commands.files import write_file
from eval.evidence.domain import PICTURE, draw, rows_of_cells
from eval.evidence.listed import Entry, Evidence, Table

_BLOCK = re.compile(r"(<!-- evidence: (\S+) -->\n).*?(<!-- /evidence -->)", re.DOTALL)
_FIGURE = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")
_FINE = 20_000  # encounters from which on a rate has a third decimal
_CLAIMED = {
    "safe_plans_broken": "SAFE plans that broke their promise",
    "safe_plans_violated": "SAFE plans that lost the separation",
    "violation_of_safe/count": "SAFE plans that lost the separation",
    "violations": "SAFE plans that broke their promise",
}
"""What claimed figures are called, where it is not their key."""


def pages(root: Path) -> list[Path]:
    """Return the pages that may have tables."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def publish(root: Path, listed: Evidence, results: Mapping[str, Any]) -> list[Path]:
    """Write every table between markers anew, and the picture of the domain; return the files that
    are new.
    """
    changed = draw(root, listed, results)
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        new = fill_in(root, page, text, listed, results)
        if new != text:
            write_file(page, new)
            changed.append(page)
    return changed


def fill_in(root: Path, page: Path, text: str, listed: Evidence, results: Mapping[str, Any]) -> str:
    """Return the text of a page with its tables as the results have them."""

    def block(marker: re.Match[str]) -> str:
        name = marker[2]
        if name not in listed.tables:
            raise ConfigError(
                f"{page}: a marker names the table {name!r}; expected one of "
                f"{', '.join(listed.tables)}"
            )
        return f"{marker[1]}{_table(name, listed, results, page.relative_to(root))}\n{marker[3]}"

    return _BLOCK.sub(block, text)


def _table(name: str, listed: Evidence, results: Mapping[str, Any], page: Path) -> str:
    """Return a table, its results that are not measured, and the policies of its figures."""
    table, place = listed.tables[name], page.parent
    names = [result for result in listed.rows(name) if result in results]
    if table.unmet:
        names = _unmet(listed, results, names)
    several = table.each is not None and len(listed.rows(name)) > 1
    rows = [["", *([""] if several else []), *table.columns]]
    for result in names:
        rows += (
            _parts(listed.results[result], results[result], table, several=several)
            if table.each
            else [
                row_of(listed.results[result], {**results[result], "name": result}, table.columns)
            ]
        )
    if not table.columns:
        rows = rows_of_cells(listed, results, names)
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines.insert(1, "|---" * len(rows[0]) + "|")
    intervals = (
        ", 95 % intervals" if any("[" in cell for row in rows[1:] for cell in row[1:]) else ""
    )
    policy = f"Policy `{results[names[0]]['policy'][:8]}`{intervals}; " if names else ""
    commands = os.path.relpath("docs/reference/results.md#all-results", place)
    lines += ["", f"{policy}[commands]({commands})."]
    missing = [
        listed.results[result].title for result in listed.rows(name) if result not in results
    ]
    lines[-1] += f" Not measured: {'; '.join(missing)}." if missing else ""
    if names and not table.columns:
        lines += [
            "",
            "![Lower bounds of success in the cells of the "
            f"domain]({os.path.relpath(PICTURE, place)})",
        ]
    return "\n".join(lines)


def _unmet(listed: Evidence, results: Mapping[str, Any], names: list[str]) -> list[str]:
    """Return the results that do not meet their target, missed ones first."""
    states = {
        name: cells_of(listed.results[name], results[name], {"verdict": "{met}"})["verdict"]
        for name in names
    }
    order = ("no", "open", "inconclusive")
    return [name for state in order for name in names if states[name] == state]


def _parts(
    entry: Entry, result: Mapping[str, Any], table: Table, *, several: bool
) -> list[list[str]]:
    """Return a row for each part of a figure: its name, and cells of the figures below it; before
    them the result's title and size where the table has ``several`` results.
    """
    head = [f"{entry.title}; {_format_value(result['n'], '')}"] if several else []
    parts: dict[str, dict[str, Any]] = {}
    for path, value in result["figures"].items():
        group, _, below = path.partition("/")
        if group == table.each:
            name, _, key = below.rpartition("/")
            parts.setdefault(name, {})[key] = value
    return [
        [*head, name, *(_cell(cell, figures) for cell in table.columns.values())]
        for name, figures in parts.items()
        if name in (entry.parts or parts)
    ]


def row_of(entry: Entry, result: Mapping[str, Any], columns: Mapping[str, str]) -> list[str]:
    """Return the title of a result and its cells."""
    return [entry.title, *cells_of(entry, result, columns).values()]


def cells_of(entry: Entry, result: Mapping[str, Any], columns: Mapping[str, str]) -> dict[str, str]:
    """Return the cells of a result by the names of their columns.

    ``met`` of a claim is yes, no, inconclusive, or open where the result lacks the figure; ``gap``
    is by how much the value misses the bound, ``why`` for what reason.
    """
    figures = {**result, **result["figures"], "command": f"`{result['command']}`"}
    if entry.claim is not None:
        key, sign, bound = entry.claim
        value = _figure(figures, key)
        if entry.ratio is not None:
            figures["claim"] = f"{entry.ratio} {sign} {bound:g}"
        elif isinstance(value, dict):
            figures["claim"] = f"{sign} {_percent(bound, 0)} %"
        else:
            figures["claim"] = f"{_CLAIMED.get(key, key)} {sign} {bound:g}"
        figures["met"] = _met(value, sign, bound)
        figures["found"] = _format_value(value, "" if entry.ratio is None else ".3f")
        if figures["met"] == "no":
            figures["gap"] = _gap(entry, value, bound)
            figures["why"] = entry.missed or "not known"
        elif figures["met"] == "inconclusive":
            figures["why"] = "the interval contains the target: more encounters decide"
    return {name: _cell(cell, figures) for name, cell in columns.items()}


def _met(figure: Any, sign: str, bound: float) -> str:
    """Return whether a figure meets a bound: a number itself, a rate by its 95 % interval, all of
    which must; what a part of it meets is inconclusive.
    """
    if not isinstance(figure, dict):
        figure = dict.fromkeys(("value", "low", "high"), figure)
    if figure["value"] is None:
        return "open"
    ends = [_meets(figure[end], sign, bound) for end in ("low", "high")]
    if all(ends):
        return "yes"
    return "inconclusive" if any(ends) else "no"


def _gap(entry: Entry, figure: Any, bound: float) -> str:
    """Return by how much a figure misses a bound: a rate in percentage points."""
    if not isinstance(figure, dict):
        return f"{abs(figure - bound):.3g}"
    away = abs(figure["value"] - bound)
    return f"{100.0 * away:.2f} points" if entry.ratio is None else f"{away:.3f}"


def _meets(value: float, sign: str, bound: float) -> bool:
    return value >= bound if sign == ">=" else value <= bound


def _cell(cell: str, figures: Mapping[str, Any]) -> str:
    values = [_format_value(_figure(figures, key), form) for key, form in _FIGURE.findall(cell)]
    return _FIGURE.sub(lambda _: values.pop(0), cell) if all(values) else "-"


def _figure(figures: Mapping[str, Any], key: str) -> Any:
    whole, _, part = key.rpartition("/")
    if key in figures:
        return figures[key]
    return figures[whole].get(part) if isinstance(figures.get(whole), dict) else None


def _format_value(value: Any, form: str) -> str:
    if value is None or (isinstance(value, dict) and value["value"] is None):
        return ""
    if isinstance(value, dict):
        total, finite = (
            value.get("total", 0),
            [value[key] for key in ("value", "low", "high") if value[key] is not None],
        )
        texts = [
            format(number, form).replace("%", "") if form else _percent(number, total)
            for number in finite
        ]
        sign = " %" if not form or form.endswith("%") else ""
        worst = (
            f"; worst {_percent(value['worst']['value'], total)} %" if value.get("worst") else ""
        )
        return f"{texts[0]}{sign}{f' [{texts[1]}, {texts[2]}]' if texts[2:] else ''}{worst}"
    if isinstance(value, str):
        return value
    if form:
        return format(value, form).replace("%", " %")
    return f"{value:,}".replace(",", " ") if isinstance(value, int) else f"{value:.3g}"


def _percent(value: float, total: int) -> str:
    """Return a rate in percent with as many digits as it is worth."""
    digits = 3 if total >= _FINE else 2
    return f"{100.0 * value:.{digits}f}".replace(f"100.{'0' * digits}", "100")
