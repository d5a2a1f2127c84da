"""From the table of flights to the numbers that matter; docs/reference/evaluation-files.md defines every key."""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from eval.hifi.rows import HIFI_OUTCOMES, WAYPOINTS
from eval.stats.intervals import quantiles, share

__all__ = ["SCHEMA_VERSION", "summarise"]

SCHEMA_VERSION = 1

_SHARES = (0.5, 0.95, 0.99, 1.0)
_ERRORS = (
    *("cross_track_rms_m", "cross_track_max_m", "along_track_max_m", "late_max_s", "position_error_max_m"),
    *("position_error_to_goal_m", "path_definition_max_m", "total_error_max_m", "altitude_error_max_m"),
    "separation_loss_m",
)


def summarise(table: Mapping[str, np.ndarray], confidence: float) -> dict[str, Any]:
    """Return the statistics of flights in JSON types; what cannot be said is None.

    Args:
        table: columns ``[N]`` as :func:`eval.hifi.rows.columns` makes them, N >= 1.
        confidence: of all intervals.
    """
    outcome, total = table["outcome"], len(table["outcome"])
    safe = table["plan_status"] == "safe"

    def rate(mask: Any, of: int = total) -> dict[str, Any]:
        return share(np.count_nonzero(mask), of, confidence)

    # Refusing is no success: a plan that was not flown for the wind resolves nothing.
    flyable = safe & (outcome != "refused")
    bound = ~np.isin(table["verdict"], ("unresolvable", "outside"))
    safe_total, begun = int(np.count_nonzero(safe)), outcome != "refused"
    rates = {"success_rate": rate(outcome == "reached")}
    rates |= {f"{name}_rate": rate(outcome == name) for name in HIFI_OUTCOMES[1:]}
    rates |= {
        "success_of_begun": rate(outcome == "reached", int(np.count_nonzero(begun))),
        "plan_safe_rate": rate(safe),
        "safe_of_resolvable": rate(flyable & bound, int(np.count_nonzero(bound))),
        "success_of_safe": rate(safe & (outcome == "reached"), safe_total),
        "violation_of_safe": rate(safe & (outcome == "violation"), safe_total),
    }
    whole = table["whole_min_separation_m"][safe]
    summary: dict[str, Any] = {
        **rates,
        "min_separation_m_quantiles": quantiles(table["min_separation_m"], (0.0, 0.01, 0.05, 0.5)),
        "whole_min_separation_m_of_safe": quantiles(whole, (0.0, 0.01, 0.5)),
        "errors": {name: quantiles(table[name][safe], _SHARES) for name in _ERRORS},
        "waypoints": {
            "position_m": quantiles(_pooled(table, safe, "position_m"), _SHARES),
            "late_s": quantiles(np.abs(_pooled(table, safe, "late_s")), _SHARES),
        },
        "reasons": dict(Counter(_kind(text) for text in table["reason"] if text).most_common()),
    }
    if "replans" in table:
        summary["replans_mean"] = float(np.mean(table["replans"]))
        summary["backup_used_rate"] = rate(table["backup_s"] > 0)
    return summary


def _pooled(table: Mapping[str, np.ndarray], rows: Any, kind: str) -> np.ndarray:
    return np.concatenate([table[f"{kind}_{n:02d}"][rows] for n in range(1, WAYPOINTS + 1)])


def _kind(reason: str) -> str:
    """Return a reason without its numbers, so that equal ones are counted together."""
    return re.sub(r"-?\d+(\.\d+)?", "#", reason)
