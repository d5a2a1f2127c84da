"""The assurance case as one page: claim, argument and evidence in Goal Structuring Notation, and
their traces.
"""

import json
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

from pydantic import Field

from agents.config.keys import nearest
from agents.config.load import ConfigError, Strict, load
from envs.edge.files import write_file
from envs.edge.installation import versions
from eval.evidence.listed import Evidence
from eval.evidence.tables import row_of
from eval.report.page import Filled, asset, figure

_STATES = ("shown", "open", "not met")  # the worse the later
_OUTCOMES = (
    "not run",
    "skipped",
    "passed",
    "failed",
)  # of several runs of a test the later one counts
_WORTH = {"failed": "not met", "not run": "open", "skipped": "open"}
_FEW = 4  # tests of a file that are named one by one
_CELLS = {
    "claimed": "{claim}",
    "met": "{met}",
    "found": "{found}",
    "success": "{success_given_resolvable}",
}
_DOWN, _LEFT, _RIGHT = (
    f'<svg class="{way}"><use href="#arrow-{way}"/></svg>' for way in ("down", "left", "right")
)


class Item(Strict):
    """A requirement or an assumption, evidence of it by name, and ``where`` an assumption is lifted
    or guarded.
    """

    says: str
    title: str = ""
    where: str = ""
    tests: tuple[str, ...] = ()
    results: tuple[str, ...] = ()
    documents: tuple[str, ...] = ()


class Goal(Strict):
    """A claim, the argument for it, the ids of its context and assumptions, and its requirements by
    id.
    """

    says: str
    strategy: str
    context: tuple[str, ...] = ()
    assumes: tuple[str, ...] = ()
    requirements: dict[str, Item] = Field(default_factory=dict)


class Case(Strict):
    """The whole of configs/dossier.yaml: the first claim, and all that is under it, by id."""

    claim: Goal
    contexts: dict[str, str]
    assumptions: dict[str, Item]
    goals: dict[str, Goal]
    not_claimed: tuple[str, ...]
    repeat: dict[str, str]


def tests_of(root: Path) -> list[str]:
    """Return the node ids of all tests of a checkout, without parameters."""
    found = []
    for path in sorted((root / "tests").rglob("test_*.py")):
        file = group = path.relative_to(root).as_posix()
        for inner, kind, name in re.findall(
            r"^( *)(class|def) ([Tt]est\w*)", path.read_text("utf-8"), re.M
        ):
            group = f"{file}::{name}" if kind == "class" else group
            found += [f"{group if inner else file}::{name}"] if kind == "def" else []
    return found


def outcomes_of(tests: Iterable[str], paths: Iterable[Path]) -> dict[str, str]:
    """Return the outcome of each test by the reports of ``pytest --junitxml``; ``ConfigError`` for
    another file.
    """
    ranks: dict[str, int] = {}
    for path in paths:
        try:
            cases = list(ET.parse(path).getroot().iter("testcase"))
        except (OSError, ET.ParseError) as error:
            raise ConfigError(f"{path}: expected a report of pytest --junitxml: {error}") from None
        if not cases:
            raise ConfigError(
                f"{path}: expected a report of pytest --junitxml with at least one testcase"
            )
        for case in cases:
            name = f"{case.get('classname')}.{case.get('name', '').partition('[')[0]}"
            kinds = {part.tag for part in case}
            found = (
                "failed"
                if kinds & {"failure", "error"}
                else "skipped"
                if "skipped" in kinds
                else "passed"
            )
            ranks[name] = max(ranks.get(name, 0), _OUTCOMES.index(found))
    return {test: _OUTCOMES[ranks.get(re.sub(r"\.py::|::|/", ".", test), 0)] for test in tests}


def checked(root: Path, case: Case, listed: Evidence, tests: list[str]) -> dict[str, Item]:
    """Return requirements and assumptions by id, with the tests of files; ``ConfigError`` where a
    name has nothing.
    """
    items = dict(case.assumptions)
    for by, goal in {"claim": case.claim, **case.goals}.items():
        _exist(by, "context", goal.context, case.contexts)
        _exist(by, "assumption", goal.assumes, case.assumptions)
        for name, item in goal.requirements.items():
            if name in items or not (item.tests or item.results or item.documents):
                raise ConfigError(
                    f"dossier: {name}: expected an id of its own, and tests, results or documents"
                )
            items[name] = item
    for name, item in items.items():
        _exist(name, "test", item.tests, {*tests, *map(_file, tests)})
        _exist(name, "result", item.results, listed.results)
        _exist(
            name,
            "document",
            item.documents,
            [one for one in item.documents if (root / one).is_file()],
        )
        every = tuple(test for test in tests if test in item.tests or _file(test) in item.tests)
        items[name] = item.model_copy(update={"tests": every})
    return items


def _exist(by: str, kind: str, names: Iterable[str], known: Iterable[str]) -> None:
    for name in names:
        if name not in known:
            near = nearest(name, known)
            more = f"; did you mean {near}?" if near else ""
            raise ConfigError(
                f"dossier: {by} names the {kind} {name!r}, which does not exist{more}"
            )


def write(
    root: Path,
    to: Path,
    listed: Evidence,
    results: Mapping[str, Any],
    about: dict[str, str],
    out: Path,
    reports: Iterable[Path] = (),
) -> str:
    """Write the page, with pictures of a folder and outcomes of reports; return the state of its
    claim.
    """
    case, tests = load(Case, root / "configs/dossier.yaml"), tests_of(root)
    ran = outcomes_of(tests, reports) if (reports := tuple(reports)) else {}
    case = Case.model_validate_json(escape(case.model_dump_json(), quote=False))
    items = checked(root, case, listed, tests)
    reasons = {name: _reasons(item, listed, results, ran) for name, item in items.items()}
    states = {
        name: max(_STATES.index(one.partition(":")[0]) for one in said)
        for name, said in reasons.items()
    }
    states |= {
        name: max(states[one] for one in goal.requirements) for name, goal in case.goals.items()
    }
    states["claim"] = max(states[name] for name in case.goals)
    said = {name: item.where or "<br>".join(reasons[name]) for name, item in items.items()}
    rows = {
        name: [f"<b>{item.title}</b>{item.says}", said[name], _evidence(item, ran)]
        for name, item in items.items()
    }
    files = {name: [test for test in tests if _file(test) == name] for name in map(_file, tests)}
    named = {one for item in items.values() for one in (*item.tests, *item.results)}
    bare = {
        name: _shut([test for test in here if test not in named], ran)
        for name, here in files.items()
    }
    left = f"{len({*tests} - named)} tests and {len({*listed.results} - named)} results"
    made = about | versions("numpy", "safetensors", "scipy", "jax", "jsbsim")
    page = Filled(asset("dossier.html")).substitute(
        style=asset("report.css"),
        about=escape(", ".join(f"{name} {text[:20]}" for name, text in made.items())),
        diagrams="".join(_diagram(name, case, items, states) for name in ("claim", *case.goals)),
        requirements=_rows(
            {name: rows[name] for goal in case.goals.values() for name in goal.requirements}
        ),
        assumptions=_rows({name: rows[name] for name in case.assumptions}),
        results=_rows(
            {name: [*_found(name, listed, results), _by(items, {name})] for name in listed.results}
        ),
        tests=_rows(
            {
                name: [
                    _by(items, set(here)),
                    str(len(named & {*here})),
                    bare[name],
                    _counted(here, ran),
                ]
                for name, here in files.items()
            }
        ),
        left=left,
        ran=", ".join(escape(path.name) for path in reports) or "no report was given",
        failures=_failures(root, results, about["policy"], out),
        limits="".join(f"<li>{one}</li>" for one in case.not_claimed),
        repeat=_rows({command: [what] for command, what in case.repeat.items()}),
    )
    write_file(to, page)
    return (
        f"{to}: the claim is {_STATES[states['claim']]}; no requirement or assumption names {left}"
    )


def _file(test: str) -> str:
    return test.partition("::")[0]


def _rows(rows: Mapping[str, Iterable[str]]) -> str:
    """Return rows of a table, each with its name as first cell and anchor."""
    heads = {
        name: f'<tr id="{name.replace(" ", "-")}"><td><code>{_broken(name)}</code></td>'
        for name in rows
    }
    return "\n".join(
        heads[name] + "".join(f"<td>{cell}</td>" for cell in row) for name, row in rows.items()
    )


def _broken(name: str) -> str:  # a line may end within it
    return name.replace("_", "_<wbr>").replace("/", "/<wbr>")


def _beside(test: str, ran: Mapping[str, str]) -> str:
    return _broken(test.partition("::")[2]) + (f" ({ran[test]})" if ran else "")


def _counted(tests: list[str], ran: Mapping[str, str]) -> str:
    counts = Counter(ran[test] for test in tests if ran)
    return ", ".join(f"{n} {outcome}" for outcome, n in counts.items())


def _shut(tests: list[str], ran: Mapping[str, str], more: str = "") -> str:
    names = "<br>".join(_beside(test, ran) for test in tests)
    return f"<details><summary>{len(tests)}{more}</summary>{names}</details>" if tests else "0"


def _by(items: Mapping[str, Item], names: set[str]) -> str:
    ids = [by for by, item in items.items() if names & {*item.tests, *item.results}]
    return ", ".join(f'<a href="#{by}">{by}</a>' for by in ids) or "none"


def _evidence(item: Item, ran: Mapping[str, str]) -> str:
    """Return tests, results and documents of an item; a file's tests by name where they are few,
    else folded.
    """
    said = []
    for file in dict.fromkeys(map(_file, item.tests)):
        here = [test for test in item.tests if _file(test) == file]
        counted = f" tests{': ' * bool(ran)}{_counted(here, ran)}"
        few = ", ".join(_beside(test, ran) for test in here)
        said.append(f"{_broken(file)}: " + (few if len(here) < _FEW else _shut(here, ran, counted)))
    said += [_broken(f"results: {', '.join(item.results)}")] if item.results else []
    return "<br>".join([*said, *map(_broken, item.documents)]) or "none"


def _found(name: str, listed: Evidence, results: Mapping[str, Any]) -> list[str]:
    entry = listed.results[name]
    if name not in results:
        return [escape(entry.title.replace("`", "")), f"0 of {entry.n}", "", "", "not measured", ""]
    title, claimed, met, found, success, origin = map(
        escape, row_of(entry, results[name], _CELLS | {"of": "{commit}, {machine}"})
    )
    size, found = f"{results[name]['n']} of {entry.n}", success if found == "-" else found
    return [title.replace("`", ""), size, claimed, met, found, origin]


def _reasons(
    item: Item, listed: Evidence, results: Mapping[str, Any], ran: Mapping[str, str]
) -> list[str]:
    """Return the state of an item and why, in sentences that begin with a state."""
    bad = [
        (ran[test], test if ran[test] == "failed" else _file(test))
        for test in item.tests
        if ran.get(test) in _WORTH
    ]
    said = [
        f"{_WORTH[outcome]}: {one}: {n} {outcome}" for (outcome, one), n in Counter(bad).items()
    ]
    for name in item.results:
        _, size, _, met, found, _ = _found(name, listed, results)
        few = name not in results or results[name]["n"] < listed.results[name].n
        said += [f"not met: {name}: {found}"] if met == "no" else []
        said += (
            [f"open: {name}: {size}{', undecided' * (met == 'undecided')}"]
            if met == "undecided" or few
            else []
        )
    return sorted(map(_broken, said)) or ["shown"]


def _failures(root: Path, results: Mapping[str, Any], policy: str, out: Path) -> str:
    """Return losses by result, and pictures that eval.failures drew of this policy, or how to draw
    them.
    """
    rates = {name: one["figures"].get("success_given_resolvable") for name, one in results.items()}
    lost = {name: one for name, one in rates.items() if one and one["count"] < one["total"]}
    said = [f"{name} {one['total'] - one['count']} of {one['total']}" for name, one in lost.items()]
    parts = [f"<p>{'; '.join(said) or 'none'}.</p>"]
    for path in sorted(out.glob("*/failures.png")):
        drawn = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        caption = (
            f"{drawn['failures']} of {drawn['encounters']} encounters of {Path(drawn['run']).name}"
        )
        parts += [figure(caption, path.read_bytes())] if drawn["policy_sha256"] == policy else []
    place = escape(str(out.relative_to(root) if out.is_relative_to(root) else out))
    how = f"<code>python -m eval.failures --run {place}/circle-* --out {place}/failed</code>"
    return "".join(
        parts
        if parts[1:]
        else [*parts, f"<p>No pictures of this policy lie there; {how} draws them.</p>"]
    )


def _diagram(name: str, case: Case, items: Mapping[str, Item], states: Mapping[str, int]) -> str:
    """Return a goal between its contexts and assumptions, its strategy, and the goals or
    requirements below.
    """
    goal, said = case.goals.get(name, case.claim), case.assumptions
    contexts = "".join(
        f'<div><p class="c">{one}: {case.contexts[one]}</p>{_LEFT}</div>' for one in goal.context
    )
    ovals = {
        one: f'<a class="a" href="#{one}">{one}: {said[one].title}</a>' for one in goal.assumes
    }
    assumed = "".join(f"<div>{_RIGHT}{oval}</div>" for oval in ovals.values())
    below = ""
    for one, child in (goal.requirements or case.goals).items():
        kinds = ("test", "result", "document") if one in items else ()
        signs = [(len(getattr(items[one], f"{kind}s")), kind) for kind in kinds]
        circles = "".join(
            f"<div>{_DOWN}<p>{n}<br>{kind}{'s' * (n > 1)}</p></div>" for n, kind in signs if n
        )
        below += (
            f'<div>{_DOWN}{_box(one, child.says, states)}<div class="signs">{circles}</div></div>'
        )
    return (
        f'<div class="gsn" id="{name}"><div class="top"><div class="side">{contexts}</div>'
        f'{_box(name, goal.says, states)}<div class="side">{assumed}</div></div>{_DOWN}'
        f'<p class="s">{goal.strategy}</p><div class="below">{below}</div></div>'
    )


def _box(name: str, says: str, states: Mapping[str, int]) -> str:
    state = _STATES[states[name]]
    return (
        f'<p class="g {state.replace(" ", "-")}"><a href="#{name}">{name}</a> {says} '
        f"<small>{state}</small></p>"
    )
