"""The assurance case: what is claimed, what shows it, and the state of each requirement and goal.

``configs/dossier.yaml`` declares the case; :mod:`eval.evidence.dossier_page` writes it as a page.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import Field

from agents.config.load import ConfigError, Strict
from commands.names import nearest
from eval.evidence.listed import Evidence
from eval.evidence.tables import cells_of


class State(IntEnum):
    """How far something is shown; the worse the larger."""

    SHOWN = 0
    OPEN = 1
    NOT_MET = 2

    @property
    def label(self) -> str:
        """Its name in words."""
        return self.name.lower().replace("_", " ")


class Outcome(IntEnum):
    """What became of a test; of several runs of it the larger one counts."""

    NOT_RUN = 0
    SKIPPED = 1
    PASSED = 2
    FAILED = 3

    @property
    def label(self) -> str:
        """Its name in words."""
        return self.name.lower().replace("_", " ")

    @property
    def state(self) -> State:
        """What it says of the requirement that names the test."""
        if self is Outcome.PASSED:
            return State.SHOWN
        return State.NOT_MET if self is Outcome.FAILED else State.OPEN


class Reason(NamedTuple):
    """Why an item is not shown."""

    state: State
    why: str


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


class Evaluated(NamedTuple):
    """A result of the list as the case sees it, all in words; empty where there is nothing."""

    title: str
    size: str  # encounters, of how many listed
    claimed: str
    met: str  # yes, inconclusive or no
    measured: str
    origin: str  # commit and machine


class Assessment(NamedTuple):
    """The case against its evidence."""

    case: Case
    items: Mapping[str, Item]  # requirements and assumptions by id, each test by its own name
    tests: list[str]  # node ids of all tests of the checkout
    outcomes: Mapping[str, Outcome]  # by test
    results: Mapping[str, Evaluated]  # all of the list, by name
    reasons: Mapping[str, list[Reason]]  # by item; none where it is shown
    states: Mapping[str, State]  # by id of items and goals, and of the "claim"


def assess(
    root: Path,
    case: Case,
    listed: Evidence,
    results: Mapping[str, Any],
    reports: Iterable[Path] = (),
) -> Assessment:
    """Return the state of all parts of a case; ``ConfigError`` where it names what does not exist.

    Args:
        root: the checkout with the tests and documents that the case names.
        results: of the evaluations of the list, by name.
        reports: files of ``pytest --junitxml``; a test in none of them was not run.
    """
    tests = tests_of(root)
    items = resolve(root, case, listed, tests)
    outcomes = outcomes_of(tests, reports)
    evaluated = {name: _evaluate(name, listed, results) for name in listed.results}
    reasons = {}
    for name, item in items.items():
        small = [result for result in item.results if _is_small(result, listed, results)]
        reasons[name] = _test_reasons(item, outcomes) + _result_reasons(item, evaluated, small)
    states = {name: _state(items[name], reasons[name], outcomes) for name in items}
    for name, goal in case.goals.items():
        states[name] = max(states[requirement] for requirement in goal.requirements)
    states["claim"] = max(states[name] for name in case.goals)
    return Assessment(case, items, tests, outcomes, evaluated, reasons, states)


def _state(item: Item, reasons: Iterable[Reason], outcomes: Mapping[str, Outcome]) -> State:
    """Return the worst of an item's reasons; where none of its tests was run it is open."""
    worst = max((reason.state for reason in reasons), default=State.SHOWN)
    none_ran = all(outcomes[test] is Outcome.NOT_RUN for test in item.tests)
    return min(worst, State.OPEN) if item.tests and none_ran else worst


def tests_of(root: Path) -> list[str]:
    """Return the node ids of all tests of a checkout, without parameters."""
    tests = []
    for path in sorted((root / "tests").rglob("test_*.py")):
        file = path.relative_to(root).as_posix()
        group = file
        definitions = re.findall(
            r"^( *)(class|def) ([Tt]est\w*)", path.read_text("utf-8"), re.MULTILINE
        )
        for indent, kind, name in definitions:
            if kind == "class":
                group = f"{file}::{name}"
            else:
                tests.append(f"{group if indent else file}::{name}")
    return tests


def outcomes_of(tests: Iterable[str], reports: Iterable[Path]) -> dict[str, Outcome]:
    """Return the outcome of each test by the reports of ``pytest --junitxml``; ``ConfigError`` for
    another file.
    """
    by_name: dict[str, Outcome] = {}
    for path in reports:
        for name, outcome in _reported_tests(path):
            by_name[name] = max(outcome, by_name.get(name, Outcome.NOT_RUN))
    return {test: by_name.get(_dotted_name(test), Outcome.NOT_RUN) for test in tests}


def _reported_tests(path: Path) -> list[tuple[str, Outcome]]:
    """Return the tests of a report by their dotted names, one for every parameter."""
    try:
        cases = list(ET.parse(path).getroot().iter("testcase"))
    except (OSError, ET.ParseError) as error:
        raise ConfigError(f"{path}: expected a report of pytest --junitxml: {error}") from None
    if not cases:
        raise ConfigError(
            f"{path}: expected a report of pytest --junitxml with at least one testcase"
        )
    outcomes = []
    for case in cases:
        name, _, _ = case.get("name", "").partition("[")
        parts = {part.tag for part in case}
        if parts & {"failure", "error"}:
            outcome = Outcome.FAILED
        elif "skipped" in parts:
            outcome = Outcome.SKIPPED
        else:
            outcome = Outcome.PASSED
        outcomes.append((f"{case.get('classname')}.{name}", outcome))
    return outcomes


def _dotted_name(test: str) -> str:
    """Return a node id as a report of junit writes it."""
    return re.sub(r"\.py::|::|/", ".", test)


def resolve(root: Path, case: Case, listed: Evidence, tests: list[str]) -> dict[str, Item]:
    """Return requirements and assumptions by id, a file's tests in the place of its name;
    ``ConfigError`` where a name has nothing.
    """
    items = dict(case.assumptions)
    for by, goal in {"claim": case.claim, **case.goals}.items():
        _check_names(by, "context", goal.context, case.contexts)
        _check_names(by, "assumption", goal.assumes, case.assumptions)
        for name, item in goal.requirements.items():
            if name in items or not (item.tests or item.results or item.documents):
                raise ConfigError(
                    f"dossier: {name}: expected an id of its own, and tests, results or documents"
                )
            items[name] = item
    known_tests = {*tests, *map(file_of, tests)}
    for name, item in items.items():
        _check_names(name, "test", item.tests, known_tests)
        _check_names(name, "result", item.results, listed.results)
        documents = [document for document in item.documents if (root / document).is_file()]
        _check_names(name, "document", item.documents, documents)
        item_tests = tuple(
            test for test in tests if test in item.tests or file_of(test) in item.tests
        )
        items[name] = item.model_copy(update={"tests": item_tests})
    return items


def _check_names(by: str, kind: str, names: Iterable[str], declared: Iterable[str]) -> None:
    for name in names:
        if name not in declared:
            near = nearest(name, declared)
            hint = f"; did you mean {near}?" if near else ""
            raise ConfigError(
                f"dossier: {by} names the {kind} {name!r}, which does not exist{hint}"
            )


def file_of(test: str) -> str:
    """Return the file of a node id."""
    return test.partition("::")[0]


def _test_reasons(item: Item, outcomes: Mapping[str, Outcome]) -> list[Reason]:
    """Say which tests failed, one by one, and how many of a file were skipped or not run."""
    counts: Counter[tuple[Outcome, str]] = Counter()
    for test in item.tests:
        outcome = outcomes[test]
        if outcome.state is not State.SHOWN:
            counts[outcome, test if outcome is Outcome.FAILED else file_of(test)] += 1
    return [
        Reason(outcome.state, f"{place}: {count} {outcome.label}")
        for (outcome, place), count in counts.items()
    ]


def _result_reasons(
    item: Item, evaluated: Mapping[str, Evaluated], small: list[str]
) -> list[Reason]:
    """Say which results miss their claim, cannot decide it, lack its figure, or are smaller than
    listed.
    """
    reasons = []
    for name in item.results:
        result = evaluated[name]
        if result.met == "no":
            reasons.append(Reason(State.NOT_MET, f"{name}: {result.measured}"))
        if result.met == "inconclusive":
            reasons.append(Reason(State.OPEN, f"{name}: {result.size}, inconclusive"))
        elif result.met == "open":
            reasons.append(Reason(State.OPEN, f"{name}: {result.size}, without the claimed figure"))
        elif name in small:
            reasons.append(Reason(State.OPEN, f"{name}: {result.size}"))
    return reasons


def _is_small(name: str, listed: Evidence, results: Mapping[str, Any]) -> bool:
    return name not in results or results[name]["n"] < listed.results[name].n


def _evaluate(name: str, listed: Evidence, results: Mapping[str, Any]) -> Evaluated:
    entry = listed.results[name]
    title = entry.title.replace("`", "")
    if name not in results:
        return Evaluated(title, f"0 of {entry.n}", "", "", "not measured", "")
    cells = {
        "claimed": "{claim}",
        "met": "{met}",
        "found": "{found}",
        "success": "{success_given_resolvable}",
        "origin": "{commit}, {machine}",
    }
    texts = cells_of(entry, results[name], cells)
    return Evaluated(
        title=title,
        size=f"{results[name]['n']} of {entry.n}",
        claimed=texts["claimed"],
        met=texts["met"],
        measured=texts["success"] if texts["found"] == "-" else texts["found"],
        origin=texts["origin"],
    )
