"""The page: one file with everything inside, to which a browser need not, and may not, add
anything.

Its content security policy allows the three scripts that stand in it, by their digests, and no
connection at all.
"""

import base64
import hashlib
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from commands.command import visible
from commands.progress import group_digits
from eval.flights.aircraft import lines_about
from eval.metrics.summary import Line, headline
from eval.plots.style import BREACH, LOSS, MARKERS
from eval.report.data import NEAR, NEAREST, Choice, json_text
from eval.report.folder import Run

_CAPTIONS = {
    "initial_conditions": "Where the intruder is when an encounter begins; failures are marked.",
    "min_separation": "The smallest separation of every flight, with and without the resolver.",
    "trajectories": "Flights seen from above, failures first.",
}
_LISTED = 50  # encounters that a sentence names at most
_TILES = ("success_given_resolvable", "violation_rate", "risk_ratio", "score_mean")


class Filled(Template):
    """HTML with ``@@NAME`` where text is to be filled in."""

    delimiter = "@@"


def page(run: Run, chosen: Sequence[Choice], data: Mapping[str, Any], by: str) -> str:
    """Return the page's HTML, with data for its script and what made it, with its version."""
    library, script, style = (asset(name) for name in ("echarts.min.js", "report.js", "report.css"))
    drawing = (files("commands") / "airmap.js").read_text(encoding="utf-8")
    allowed = " ".join(f"'sha256-{_digest(code)}'" for code in (library, drawing, script))
    summary = run.summary
    lines = headline(summary, _lost_causes(run))
    scenario = escape(visible(summary["scenario"]))
    head = f"{group_digits(run.config.default_count)} encounters, scenario "
    tail = escape(f", {_decides(summary)}")
    return Filled(asset("report.html")).substitute(
        allowed=allowed,
        title=head + scenario + tail,
        heading=f"{head}<bdi>{scenario}</bdi>{tail}",
        about=_about(run),
        confidence=escape(f"{100.0 * summary['confidence']:g}"),
        tiles=_tiles(lines, summary["confidence"]),
        lines="\n".join(_row(line) for line in lines),
        lost=_lost_encounters(run),
        kinds=_kinds(run),
        near=escape(f"{NEAR * run.rules.separation:.0f}"),
        points=_points(run, data["count"]),
        tracks=_tracks(chosen, data),
        figures=_figures(run),
        config=escape(visible(run.config_text)),
        versions=", ".join(escape(" ".join(pair)) for pair in summary["versions"].items()),
        by=escape(by),
        style=style,
        data=json_text(data),
        library=library,
        drawing=drawing,
        script=script,
    )


def _decides(summary: Mapping[str, Any]) -> str:
    """Return what decided, in words: a mode of the policy, or the baseline in its place."""
    baseline = summary.get("baseline", "none")
    return f"mode {summary['mode']}" if baseline == "none" else f"baseline {baseline}"


def asset(name: str) -> str:
    """Return the text of a file of ``eval/data``."""
    return (files("eval") / "data" / name).read_text(encoding="utf-8")


def _digest(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode()).digest()).decode("ascii")


def _about(run: Run) -> str:
    summary, rules = run.summary, run.rules
    parts = [
        f"seed {summary['seed']}",
        f"policy {summary['policy_sha256'][:12]}",
        f"required separation {rules.separation:g} m",
        f"goal radius {rules.goal_radius:g} m",
        f"at most {rules.t_max:g} s",
    ]
    parts += lines_about(summary)
    if summary.get("changes"):
        parts.append(
            "changed: " + ", ".join(f"{key} {value}" for key, value in summary["changes"].items())
        )
    return escape(visible(" · ".join(parts)))


def _tiles(lines: Sequence[Line], confidence: float) -> str:
    by_key = {line.key: line for line in lines}
    return "\n".join(_tile(by_key[key], confidence) for key in _TILES if key in by_key)


def _tile(line: Line, confidence: float) -> str:
    interval = f"{100.0 * confidence:g} %: {line.interval}" if line.interval else line.counted
    return (
        f'<div class="tile"><span>{escape(line.label)}</span><strong>{escape(line.value)}</strong>'
        f"<small>{escape(interval)}</small></div>"
    )


def _row(line: Line) -> str:
    cells = "".join(
        f"<td>{escape(text)}</td>" for text in (line.value, line.interval, line.counted)
    )
    return f'<tr><th scope="row">{escape(line.label)}</th>{cells}</tr>'


def _lost_causes(run: Run) -> dict[str, int]:
    """Return how many losses of separation, geofence violations and time-outs are proven
    unresolvable, by the key of their rate.
    """
    lost = run.kinds == "proven unresolvable"
    return {
        f"{name}_rate": int((lost & (run.table["outcome"] == name)).sum())
        for name in ("violation", "breach", "timeout")
    }


def _lost_encounters(run: Run) -> str:
    """Return which encounters were not resolved, as HTML, the policy's own failures first; nothing
    where all were.
    """
    sentences = [
        _numbers(run, LOSS, "Losses of separation"),
        _numbers(run, BREACH, "Geofence violations"),
        _numbers(run, "time-out", "Time-outs"),
        _numbers(run, "proven unresolvable", "Proven unresolvable"),
    ]
    if sentences[-1]:
        sentences.append(
            "These are a kind of their own in filter and plots; the table counts their losses "
            "of separation and time-outs too."
        )
    text = " ".join(sentence for sentence in sentences if sentence)
    return f"<p>{text}</p>" if text else ""


def _numbers(run: Run, kind: str, name: str) -> str:
    """Return how many encounters are of a kind, with links to the first ones; nothing of none."""
    numbers = [int(number) for number in np.flatnonzero(run.kinds == kind)]
    if not numbers:
        return ""
    links = ", ".join(f'<a href="#{number}">{number}</a>' for number in numbers[:_LISTED])
    more = f" and {group_digits(len(numbers) - _LISTED)} more" if len(numbers) > _LISTED else ""
    return f"{name} ({group_digits(len(numbers))}): {links}{more}."


def _kinds(run: Run) -> str:
    """Return the boxes that choose kinds of encounters, what matters most first."""
    kinds = [kind for kind in MARKERS if kind != BREACH or "areas" in run.table]
    places = {kind: place for place, kind in enumerate(MARKERS)}
    return "\n".join(_kind(run, places[kind], kind) for kind in reversed(kinds))


def _figures(run: Run) -> str:
    if not run.figures:
        return "<p>This run drew no figures (its key <code>figures</code> is false).</p>"
    return "\n".join(figure(_CAPTIONS[name], png) for name, png in run.figures.items())


def _kind(run: Run, place: int, kind: str) -> str:
    count = int((run.kinds == kind).sum())
    state = "checked" if count else "checked disabled"
    use = f'<use href="#mark-{place}" x="-6" y="-6" width="12" height="12"/>'
    return (
        f'<label class="kind"><input type="checkbox" name="kind" value="{place}" {state}>'
        f'<svg class="mark mark-{place}" viewBox="-6 -6 12 12" aria-hidden="true">{use}</svg> '
        f"{escape(kind)} ({group_digits(count)})</label>"
    )


def _points(run: Run, count: int) -> str:
    if count == run.config.default_count:
        return "Every encounter is a point."
    shown, flown = group_digits(count), group_digits(run.config.default_count)
    return f"{shown} of {flown} are points: tracks, failures, and a sample of the rest."


def _tracks(chosen: Sequence[Choice], data: Mapping[str, Any]) -> str:
    flights = data["flights"]
    if not flights:
        return "<p>No encounter has tracks on this page.</p>"
    parts = []
    for group, numbers, total in chosen:
        shown = sum(str(int(number)) in flights for number in numbers)
        parts.append(f"{group_digits(shown)} of {group_digits(total)} {group}")
    differing = sum("differs" in flight for flight in flights.values())
    witnesses = sum("witness" in flight for flight in flights.values())
    text = (
        f"{group_digits(len(flights))} encounters have tracks: {', '.join(parts)}. Close successes "
        f"are those nearer than {100.0 * (NEAR - 1.0):g} % beyond the required separation; at most "
        f"the {NEAREST} nearest have tracks. They were flown again when this page was made, "
        f"{group_digits(witnesses)} failures beside a flight that resolves them."
    )
    warning = (
        f'<p class="warning">{group_digits(differing)} of them ended otherwise than the table '
        "says: this page was made with another kind of machine or other versions than the run. "
        "They are marked.</p>"
    )
    return f"<p>{escape(text)}</p>{warning if differing else ''}"


def figure(caption: str, png: bytes) -> str:
    """Return a picture with its caption, as HTML."""
    caption = escape(caption)
    encoded = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{encoded}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )
