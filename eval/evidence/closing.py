"""What a run of the evaluations found, in a few lines or as a table: targets met, missed and
inconclusive.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from commands.progress import group_digits
from eval.evidence.listed import Evidence
from eval.evidence.tables import cells_of
from eval.metrics.summary import print_table

_STATES = ("missed", "inconclusive", "met", "without a target", "not measured")
_WORDS = {"yes": "met", "inconclusive": "inconclusive", "no": "missed", "open": "not measured"}
_NAMED = 12  # results that a line names
_CELLS = {
    "target": "{claim}",
    "verdict": "{met}",
    "measured": "{found}",
    "success": "{success_given_resolvable}",
}


def show_closing(
    listed: Evidence, results: Mapping[str, Any], names: Sequence[str], folder: Path
) -> None:
    """Print what was found: a table on a terminal, elsewhere at most a line for each state.

    Args:
        results: those that are measured, by name.
        names: of the results that were asked for.
        folder: where they are.
    """
    rows = [_row(listed, results, name) for name in names]
    counts = [(state, [row for row in rows if row[-1] == state]) for state in _STATES]
    title = f"{len(rows)} results: " + ", ".join(
        f"{len(group)} {state}" for state, group in counts if group
    )
    places = [
        f"results, one NAME.json each: {folder}",
        f"publish: python -m eval.evidence --tables --out {folder}",
        f"assurance case: python -m eval.evidence --dossier FILE.html --out {folder}",
    ]
    if sys.stdout.isatty():
        print_table(title, ("", "encounters", "target", "measured", "state"), rows, places)
        return
    lines = [f"{state}: {_names(state, group)}" for state, group in counts if group]
    print("\n".join([title, *lines, *places]))


def _row(listed: Evidence, results: Mapping[str, Any], name: str) -> list[str]:
    """Return name, encounters, target, figure and state of a result."""
    entry = listed.results[name]
    if name not in results:
        return [name, f"0 of {group_digits(entry.n)}", "", "", "not measured"]
    size = group_digits(results[name]["n"])
    if results[name]["n"] < entry.n:
        size += f" of {group_digits(entry.n)}"
    cells = cells_of(entry, results[name], _CELLS)
    if entry.claim is None:
        success = "" if cells["success"] == "-" else cells["success"]
        return [name, size, "", success, "without a target"]
    return [name, size, cells["target"], cells["measured"], _WORDS[cells["verdict"]]]


def _names(state: str, rows: Sequence[Sequence[str]]) -> str:
    """Return the results of a state; of those that must be looked at the figures, too, and
    the size where it is smaller than listed.
    """
    texts = []
    for name, size, target, measured, _ in rows:
        notes = [f"{measured}, target {target}"] if state in ("missed", "inconclusive") else []
        notes += [size] if " of " in size and state != "not measured" else []
        texts.append(f"{name} ({', '.join(notes)})" if notes else name)
    more = f", and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return ", ".join(texts[:_NAMED]) + more
