"""From the table of a comparison to its numbers; docs/howto/compare.md defines every key."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from eval.compare.deciders import REFERENCE, WITNESS, Entry
from eval.metrics.volumes import VOLUMES
from eval.metrics.weighted import ratio
from eval.stats.intervals import interval, mean_interval, number, share
from eval.stats.paired import mcnemar_exact, pairs, tango

__all__ = ["SCHEMA_VERSION", "summarise"]

SCHEMA_VERSION = 1


def summarise(
    table: Mapping[str, np.ndarray],
    entries: Sequence[Entry],
    weights: np.ndarray | None,
    confidence: float,
    resamples: int,
    seed: int,
) -> dict[str, Any]:
    """Return the statistics of a comparison in JSON types; what cannot be said is None.

    The table is that of :func:`eval.compare.deciders.columns`, N >= 1; the first entry is the one that the others are
    compared with; weights ``[N]`` are for the ratios, None for equal ones.
    """
    total = len(table["encounter"])
    possible = total - int(np.count_nonzero(table["unresolvable"]))
    how = (confidence, resamples, seed)
    rows = []
    witness = next((entry for entry in entries if entry.kind == WITNESS), None)
    for entry in entries:
        row = _row(table, entry, possible, how) | _ratios(table, entry, weights, how)
        row["difference"] = None if entry is entries[0] else _difference(table, entry, entries[0], how)
        if witness is not None:
            row["path_excess_over_witness_mean"] = None if entry is witness else _longer(table, entry, witness, how)
        rows.append(row)
    return {
        "encounters": total,
        "resolvable_rate": share(possible, total, confidence),
        "volumes": {name: volume._asdict() for name, volume in VOLUMES.items()},
        "altitude": "co-altitude is assumed: every loss is given that the altitudes do not separate",
        "entries": rows,
    }


def _row(table: Mapping[str, np.ndarray], entry: Entry, possible: int, how: tuple[float, int, int]) -> dict[str, Any]:
    """Return rates and costs of one entry."""

    def of(name: str) -> np.ndarray:
        return table[f"{entry.name}.{name}"]

    def rate(name: str, total: int = len(table["encounter"])) -> dict[str, Any]:
        return share(np.count_nonzero(of("outcome") == name), total, how[0])

    def mean(name: str) -> dict[str, float | None]:
        return interval(mean_interval(of(name)[of("outcome") == "reached"], *how))

    severe = of("severity")[of("severity") > 0.0]
    return {
        "name": entry.name,
        "kind": entry.kind,
        "sha256": entry.sha256,
        "success_rate": rate("reached"),
        "success_given_resolvable": rate("reached", possible),
        "violation_rate": rate("violation"),
        "timeout_rate": rate("timeout"),
        "path_excess_mean": mean("path_excess"),
        "time_excess_mean_s": mean("time_excess_s"),
        "cross_track_max_mean_m": mean("cross_track_m"),
        "heading_reversals_mean": float(np.mean(of("heading_reversals"))),
        "min_separation_m": number(float(np.fmin.reduce(of("min_separation_m")))),
        "severity_mean_of_losses": float(np.mean(severe)) if severe.size else None,
        "severity_max": float(np.max(of("severity"))),
    }


def _ratios(
    table: Mapping[str, np.ndarray], entry: Entry, weights: np.ndarray | None, how: tuple[float, int, int]
) -> dict[str, Any]:
    """Return the risk ratio, of the required separation and of each volume."""

    def of(column: str, event: Any = True) -> dict[str, Any]:
        ours, bare = (table[f"{name}.{column}"] == event for name in (entry.name, REFERENCE))
        found = ratio(ours, bare, weights, confidence=how[0], resamples=how[1], seed=how[2])
        said = asdict(found) | {"warnings": list(found.warnings)}
        return {key: number(value) if isinstance(value, float) else value for key, value in said.items()}

    return {"risk_ratio": of("outcome", "violation"), "ratios": {name: of(f"lost_{name}") for name in VOLUMES}}


def _difference(
    table: Mapping[str, np.ndarray], entry: Entry, first: Entry, how: tuple[float, int, int]
) -> dict[str, Any]:
    """Return the entry's success rate less the first's, and its path excess where both succeed."""
    ours, theirs = (table[f"{name}.outcome"] == "reached" for name in (entry.name, first.name))
    counts = pairs(theirs, ours)
    return {
        **tango(counts, how[0])._asdict(),
        "mcnemar_exact_p": mcnemar_exact(counts),
        "pairs": counts._asdict(),
        "path_excess_mean": _longer(table, entry, first, how),
    }


def _longer(
    table: Mapping[str, np.ndarray], entry: Entry, other: Entry, how: tuple[float, int, int]
) -> dict[str, float | None]:
    """Return the entry's mean path excess less the other's, where both succeed, with its interval."""
    both = np.logical_and(*(table[f"{name}.outcome"] == "reached" for name in (entry.name, other.name)))
    excess = table[f"{entry.name}.path_excess"] - table[f"{other.name}.path_excess"]
    return interval(mean_interval(excess[both], *how))
