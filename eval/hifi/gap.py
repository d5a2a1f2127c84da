"""How far the aircraft is from its plans, and the margin that covers it: ``python -m eval.hifi_gap DIR [DIR ...]``.

The distance between two aircraft differs from the planned one by no more than the own distance from the plan at that
time. A margin as large as the largest such distance over a plan therefore keeps what was planned, whatever the
geometry. The margin proposed is the upper confidence bound of a percentile of it over flights: an order statistic, so
that nothing is assumed of the distribution. An aircraft that was lost counts as infinitely far away.
"""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import ConfigError, Parser
from eval.runner.outputs import read_table

__all__ = ["gap", "main", "upper_bound"]

_SHARES = (0.5, 0.95, 0.99, 1.0)
_ROUNDING = 5.0  # m, to which a margin is rounded up
_ROWS = (
    ("path_definition_max_m", "path definition (policy's plans, until its end), m"),
    ("total_error_max_m", "total against the surrogate (there too), m"),
    ("cross_track_max_m", "across the path, m"),
    ("along_track_max_m", "along the path, m"),
    ("late_max_s", "in time, s"),
    ("position_error_to_goal_m", "from the plan's place until the rejoining, m"),
    ("position_error_max_m", "from the plan's place, whole plan, m"),
    ("separation_loss_m", "planned less flown smallest separation, m"),
)


def upper_bound(values: np.ndarray, share: float, confidence: float) -> float | None:
    """Return a bound that a quantile does not exceed with some confidence, None where there are too few values.

    The k-th smallest of n independent values exceeds the quantile of share q with probability P(B < k), B binomial in n
    and q; the bound is the smallest value for which that reaches the confidence.

    Args:
        values: ``[M]``; inf is allowed.
        share: of the quantile, in (0, 1).
        confidence: in (0, 1).
    """
    from scipy.special import bdtr

    ordered = np.sort(values)
    for number in range(1, ordered.size + 1):
        if bdtr(number - 1, ordered.size, share) >= confidence:
            return float(ordered[number - 1])
    return None


def gap(table: Mapping[str, np.ndarray], percentile: float, confidence: float) -> dict[str, Any]:
    """Return the aircraft's distances from its SAFE plans in JSON types, and the margin that covers them.

    Args:
        table: columns ``[N]`` as :func:`eval.hifi.rows.columns` makes them, of mode plan.
        percentile: that the margin covers, in (0, 100).
        confidence: with which it does, in (0, 1).
    """
    safe = table["plan_status"] == "safe"
    lost, flown = safe & (table["outcome"] == "failed"), safe & np.isfinite(table["position_error_max_m"])
    judged = flown | lost
    found: dict[str, Any] = {
        "plans": len(safe),
        "safe": int(safe.sum()),
        "refused": int((safe & (table["outcome"] == "refused")).sum()),
        "lost": int(lost.sum()),
        "flown": int(flown.sum()),
        "violations": int((flown & (table["outcome"] == "violation")).sum()),
    }
    for name, _ in _ROWS:
        values = table[name][judged & (np.isfinite(table[name]) | lost)]
        values = np.where(np.isfinite(values), values, np.inf)
        found[name] = {f"{share:g}": _quantile(values, share) for share in _SHARES}
    worst = np.where(lost, np.inf, table["position_error_max_m"])[judged]
    bound = upper_bound(worst, percentile / 100.0, confidence)
    found["percentile"], found["confidence"] = percentile, confidence
    found["bound_m"] = bound if bound is not None and math.isfinite(bound) else None
    known = found["bound_m"]
    found["margin_m"] = None if known is None else _ROUNDING * math.ceil(known / _ROUNDING)
    # The least number of flights with which the largest value is a bound.
    found["flights_needed"] = math.ceil(math.log(1.0 - confidence) / math.log(percentile / 100.0))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the gap of one or more runs; return the exit code.

    Raises:
        ConfigError: a folder holds no finished run of mode plan, or a number is out of its range.
    """
    description, _, more = (__doc__ or "").partition("\n\n")
    parser = Parser(prog="python -m eval.hifi_gap", description=description, epilog=more)
    add = parser.add_argument
    add("runs", type=Path, nargs="+", metavar="DIR", help="folders of finished runs of eval.hifi, mode plan")
    add("--percentile", type=float, default=99.0, metavar="P", help="of flights that the margin covers (default: 99)")
    add("--confidence", type=float, default=0.95, metavar="C", help="with which it does (default: 0.95)")
    add("--json", action="store_true", help="print one JSON object a run instead of tables")
    return _print(parser.parse_args(arguments))


def _print(options: argparse.Namespace) -> int:
    if not 0.0 < options.percentile < 100.0:
        raise ConfigError(f"--percentile is {options.percentile:g}; expected more than 0 and less than 100")
    if not 0.0 < options.confidence < 1.0:
        raise ConfigError(f"--confidence is {options.confidence:g}; expected more than 0 and less than 1")
    for path in options.runs:
        found = gap(_table(path), options.percentile, options.confidence)
        if options.json:
            print(json.dumps({"run": str(path)} | found, allow_nan=False))
        else:
            _show(path, found)
    return 0


def _show(path: Path, found: Mapping[str, Any]) -> None:
    print(
        f"{path}: {found['plans']} plans, {found['safe']} SAFE, of these {found['flown']} flown, "
        f"{found['refused']} refused, {found['lost']} aircraft lost, {found['violations']} violations"
    )
    print(f"{'largest in a flight':52}{'median':>9}{'95 %':>9}{'99 %':>9}{'largest':>9}")
    for name, label in _ROWS:
        cells = (found[name][f"{share:g}"] for share in _SHARES)
        print(f"{label:52}" + "".join(f"{'-' if cell is None else format(cell, '.2f'):>9}" for cell in cells))
    what = f"{found['percentile']:g} % of flights, {100.0 * found['confidence']:g} % confidence"
    if found["margin_m"] is None:
        why = "an aircraft was lost" if found["lost"] else f"it takes {found['flights_needed']} flights at least"
        print(f"no margin for {what}: {why}\n")
    else:
        print(f"margin for {what}: {found['bound_m']:.1f} m; plan with --set planner.margin={found['margin_m']:g}\n")


def _table(path: Path) -> dict[str, np.ndarray]:
    file = path / "flights.parquet"
    if not file.is_file():
        raise ConfigError(f"{path} holds no flights.parquet; expected the folder of a finished run of eval.hifi")
    table = read_table(file, "the table of a run of eval.hifi", b"hifi 1")
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    if not np.isfinite(columns["position_error_max_m"]).any():
        raise ConfigError(f"{file} holds no flight along a plan; expected a run of mode plan")
    return columns


def _quantile(values: np.ndarray, share: float) -> float | None:
    if not values.size:
        return None
    # Of ordered values, so that an infinite one is not averaged with its neighbour.
    found = float(np.quantile(values, share, method="higher"))
    return found if math.isfinite(found) else None
