"""The assurance case as one page: claim, argument and evidence in Goal Structuring Notation, and
their traces.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError, load
from commands.files import write_file
from commands.installation import versions
from commands.json_text import parse_json
from eval.evidence.dossier import Assessment, Case, Goal, Item, Outcome, assess, file_of
from eval.evidence.listed import Evidence
from eval.report.page import Filled, asset, figure

_FEW = 4  # tests of a file that are named one by one
_LONGEST = 20  # characters of a version or digest at the head of the page


def write(
    root: Path,
    to: Path,
    listed: Evidence,
    results: Mapping[str, Any],
    about: dict[str, str],
    folder: Path,
    reports: Sequence[Path] = (),
) -> str:
    """Write the page and return a sentence with the state of its claim.

    Args:
        root: the checkout, with ``configs/dossier.yaml`` and the tests.
        to: the page.
        about: policy and commit, for its head.
        folder: of the evaluations, with pictures of failures.
        reports: files of ``pytest --junitxml``.
    """
    case = load(Case, root / "configs/dossier.yaml")
    assessment = assess(root, case, listed, results, reports)
    named_tests = {test for item in assessment.items.values() for test in item.tests}
    named_results = {name for item in assessment.items.values() for name in item.results}
    unnamed = (
        f"{len({*assessment.tests} - named_tests)} tests and "
        f"{len({*listed.results} - named_results)} results"
    )
    head = about | versions("numpy", "safetensors", "scipy", "jax", "jsbsim")
    requirements = [name for goal in case.goals.values() for name in goal.requirements]
    page = Filled(asset("dossier.html")).substitute(
        style=asset("report.css"),
        about=escape(", ".join(f"{name} {text[:_LONGEST]}" for name, text in head.items())),
        diagrams="".join(_diagram(name, assessment) for name in ("claim", *case.goals)),
        requirements=_rows({name: _item_cells(name, assessment) for name in requirements}),
        assumptions=_rows({name: _item_cells(name, assessment) for name in case.assumptions}),
        results=_rows({name: _result_cells(name, assessment) for name in listed.results}),
        tests=_rows(_tests_by_file(assessment, named_tests)),
        left=unnamed,
        ran=escape(", ".join(path.name for path in reports) or "no report was given"),
        failures=_failures(root, results, about["policy"], folder),
        limits="".join(f"<li>{escape(limit, quote=False)}</li>" for limit in case.not_claimed),
        repeat=_rows(
            {command: [escape(purpose, quote=False)] for command, purpose in case.repeat.items()}
        ),
    )
    write_file(to, page)
    missed = [name for name, result in assessment.results.items() if result.met == "no"]
    idle = sum(outcome is Outcome.NOT_RUN for outcome in assessment.outcomes.values())
    return (
        f"{to}: the claim is {assessment.states['claim'].label}; {idle} of "
        f"{len(assessment.tests)} tests were not run; results that miss their claim: "
        f"{', '.join(missed) or 'none'}; no requirement or assumption names {unnamed}"
    )


# ---- tables ----


def _rows(rows: Mapping[str, Iterable[str]]) -> str:
    """Return rows of a table, each with its name as first cell and anchor."""
    lines = []
    for name, cells in rows.items():
        anchor = escape(name).replace(" ", "-")
        others = "".join(f"<td>{cell}</td>" for cell in cells)
        lines.append(f'<tr id="{anchor}"><td><code>{_breakable(name)}</code></td>{others}</tr>')
    return "\n".join(lines)


def _breakable(name: str) -> str:
    """Return a name as HTML within which a line may end."""
    return escape(name, quote=False).replace("_", "_<wbr>").replace("/", "/<wbr>")


def _item_cells(name: str, assessment: Assessment) -> list[str]:
    """Return what an item says, its state or where it is guarded, and its evidence."""
    item = assessment.items[name]
    reasons = sorted(f"{reason.state.label}: {reason.why}" for reason in assessment.reasons[name])
    state = "<br>".join(map(_breakable, reasons)) or assessment.states[name].label
    return [
        f"<b>{escape(item.title, quote=False)}</b>{escape(item.says, quote=False)}",
        escape(item.where, quote=False) or state,
        _evidence(item, assessment.outcomes),
    ]


def _evidence(item: Item, outcomes: Mapping[str, Outcome]) -> str:
    """Return tests, results and documents of an item; a file's tests by name where they are few,
    else folded.
    """
    lines = []
    for file in dict.fromkeys(map(file_of, item.tests)):
        tests = [test for test in item.tests if file_of(test) == file]
        if len(tests) < _FEW:
            names = ", ".join(_test_name(test, outcomes) for test in tests)
        else:
            names = _fold(tests, outcomes, f" tests: {_counts(tests, outcomes)}")
        lines.append(f"{_breakable(file)}: {names}")
    if item.results:
        lines.append(_breakable(f"results: {', '.join(item.results)}"))
    lines += map(_breakable, item.documents)
    return "<br>".join(lines) or "none"


def _test_name(test: str, outcomes: Mapping[str, Outcome]) -> str:
    return f"{_breakable(test.partition('::')[2])} ({outcomes[test].label})"


def _counts(tests: Iterable[str], outcomes: Mapping[str, Outcome]) -> str:
    counts = Counter(outcomes[test] for test in tests)
    return ", ".join(f"{count} {outcome.label}" for outcome, count in counts.items())


def _fold(tests: Sequence[str], outcomes: Mapping[str, Outcome], more: str = "") -> str:
    if not tests:
        return "0"
    names = "<br>".join(_test_name(test, outcomes) for test in tests)
    return f"<details><summary>{len(tests)}{more}</summary>{names}</details>"


def _result_cells(name: str, assessment: Assessment) -> list[str]:
    cells = [escape(text) for text in assessment.results[name]]
    return [*cells, _link_items(assessment.items, {name})]


def _tests_by_file(assessment: Assessment, named: set[str]) -> dict[str, list[str]]:
    """Return for each file of tests who names them, how many, those that nobody names, and
    outcomes.
    """
    rows = {}
    for file in dict.fromkeys(map(file_of, assessment.tests)):
        tests = [test for test in assessment.tests if file_of(test) == file]
        unnamed = [test for test in tests if test not in named]
        rows[file] = [
            _link_items(assessment.items, set(tests)),
            str(len(tests) - len(unnamed)),
            _fold(unnamed, assessment.outcomes),
            _counts(tests, assessment.outcomes),
        ]
    return rows


def _link_items(items: Mapping[str, Item], names: set[str]) -> str:
    """Return links to the items that name some of these tests or results."""
    ids = [by for by, item in items.items() if names & {*item.tests, *item.results}]
    return ", ".join(f'<a href="#{by}">{by}</a>' for by in ids) or "none"


# ---- failures ----


def _failures(root: Path, results: Mapping[str, Any], policy: str, folder: Path) -> str:
    """Return losses by result, and pictures that eval.failures drew of this policy, or how to draw
    them.
    """
    losses = []
    for name, result in results.items():
        rate = result["figures"].get("success_given_resolvable")
        if rate and rate["count"] < rate["total"]:
            losses.append(f"{name} {rate['total'] - rate['count']} of {rate['total']}")
    pictures = [
        picture
        for path in sorted(folder.glob("*/failures.png"))
        for picture in _picture(path, policy)
    ]
    if not pictures:
        place = escape(str(folder.relative_to(root) if folder.is_relative_to(root) else folder))
        how = f"<code>python -m eval.failures {place}/circle-* --out {place}/failed</code>"
        pictures = [f"<p>No pictures of this policy lie there; {how} draws them.</p>"]
    return "".join([f"<p>{'; '.join(losses) or 'none'}.</p>", *pictures])


def _picture(path: Path, policy: str) -> list[str]:
    """Return a picture of failures as HTML; none where it is of another policy."""
    source = path.with_suffix(".json")
    try:
        drawn = parse_json(source.read_text(encoding="utf-8"))
        if drawn["policy_sha256"] != policy:
            return []
        run = Path(drawn["run"]).name
        caption = f"{drawn['failures']} of {drawn['encounters']} encounters of {run}"
        return [figure(caption, path.read_bytes())]
    except (OSError, ValueError, TypeError, KeyError) as problem:
        raise ConfigError(
            f"{source}: {problem}, expected what python -m eval.failures wrote"
        ) from None


# ---- the diagrams ----


def _diagram(name: str, assessment: Assessment) -> str:
    """Return a goal between its contexts and assumptions, its strategy, and the goals or
    requirements below.
    """
    case = assessment.case
    goal = case.goals.get(name, case.claim)
    contexts = "".join(
        f'<div><p class="c">{context}: {escape(case.contexts[context], quote=False)}</p>'
        f"{_arrow('left')}</div>"
        for context in goal.context
    )
    assumptions = "".join(
        f'<div>{_arrow("right")}<a class="a" href="#{assumption}">{assumption}: '
        f"{escape(case.assumptions[assumption].title, quote=False)}</a></div>"
        for assumption in goal.assumes
    )
    below = ""
    for child in goal.requirements or case.goals:
        part = assessment.items.get(child) or case.goals[child]
        below += (
            f"<div>{_arrow('down')}{_box(child, part.says, assessment)}"
            f'<div class="signs">{_solutions(part)}</div></div>'
        )
    return (
        f'<div class="gsn" id="{name}"><div class="top"><div class="side">{contexts}</div>'
        f'{_box(name, goal.says, assessment)}<div class="side">{assumptions}</div></div>'
        f"{_arrow('down')}"
        f'<p class="s">{escape(goal.strategy, quote=False)}</p>'
        f'<div class="below">{below}</div></div>'
    )


def _solutions(part: Item | Goal) -> str:
    """Return a circle with the number of tests, results and documents of a requirement; of a goal
    none.
    """
    if isinstance(part, Goal):
        return ""
    counts = {
        "test": len(part.tests),
        "result": len(part.results),
        "document": len(part.documents),
    }
    return "".join(
        f"<div>{_arrow('down')}<p>{count}<br>{kind if count == 1 else f'{kind}s'}</p></div>"
        for kind, count in counts.items()
        if count
    )


def _box(name: str, says: str, assessment: Assessment) -> str:
    state = assessment.states[name].label
    return (
        f'<p class="g {state.replace(" ", "-")}"><a href="#{name}">{name}</a> '
        f"{escape(says, quote=False)} <small>{state}</small></p>"
    )


def _arrow(way: str) -> str:
    return f'<svg class="{way}"><use href="#arrow-{way}"/></svg>'
