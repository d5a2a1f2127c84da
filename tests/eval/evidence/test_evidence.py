"""The list of evaluations, its results, and the tables that are generated from them."""

import json
import math
import re
import signal
import subprocess
import sys
import time
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agents.config.load import ConfigError, load
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.kinematics import Limits
from eval.evidence.closing import show_closing
from eval.evidence.domain import cells, rows_of_cells
from eval.evidence.dossier import Case, resolve
from eval.evidence.dossier import tests_of as names_of_tests
from eval.evidence.dossier_page import write
from eval.evidence.listed import Evidence, find_figures, read_results
from eval.evidence.run import ROOT, main, published_results
from eval.evidence.tables import fill_in, pages, row_of

LISTED = load(Evidence, ROOT / "configs/evidence.yaml")
STORE = ROOT / "docs/reference/evidence.json"
RATE = re.compile(r"^\|.*\d % \[\d", re.MULTILINE)
BLOCK = re.compile(r"<!-- evidence: \S+ -->.*?<!-- /evidence -->", re.DOTALL)
LIST = """\
readings: {eval.monte_carlo: {file: summary.json, chunks: true, keys: ["success*", "path*"]}}
results:
  one: {title: one, command: "eval.monte_carlo --workers 1 --set figures=false --encounters {n}", n: 24}
  two: {title: two, command: "eval.monte_carlo --workers 1 --set figures=false --set chunk=20 --encounters {n}", n: 999}
tables: {first: {rows: [one], columns: {resolved: "{success_given_resolvable}"}}}
"""


def test_published_tables_are_those_of_the_results() -> None:
    results = read_results(STORE)
    for page in pages(ROOT):
        text = page.read_text(encoding="utf-8")
        assert text == fill_in(ROOT, page, text, LISTED, results), (
            f"{page}: python -m eval.evidence --tables"
        )


def test_published_results_are_of_the_policy_that_ships(tmp_path: Path) -> None:
    results = read_results(STORE)
    assert results
    assert results == published_results(LISTED, Policy.load().sha256, results, tmp_path)
    assert STORE.stat().st_size < 300_000


def test_no_table_of_rates_stands_outside_markers() -> None:
    for page in pages(ROOT):
        assert not RATE.findall(BLOCK.sub("", page.read_text(encoding="utf-8"))), page
    assert RATE.search("a\n| policy | 99.5 % [98.8, 99.8] |\n")


def test_figures_that_name_a_policy_are_of_the_one_that_ships() -> None:
    """BlueSky flies in an environment of its own, so its figures are not generated."""
    named = {
        digest
        for page in pages(ROOT)
        for digest in re.findall(r"olicy `([0-9a-f]{8})`", page.read_text("utf-8"))
    }
    assert named == {Policy.load().sha256[:8]}


def test_every_table_is_published() -> None:
    everything = "".join(page.read_text(encoding="utf-8") for page in pages(ROOT))
    assert set(re.findall(r"<!-- evidence: (\S+) -->\n", everything)) == set(LISTED.tables)
    for name in LISTED.tables:
        assert set(LISTED.rows(name)) <= set(LISTED.results), name


def result(command: str, n: int = 24, policy: str = "a" * 64, **figures: Any) -> dict[str, Any]:
    fields = {"policy": policy, "commit": "c", "date": "2026-01-01", "machine": "m", "seconds": 1.0}
    return fields | {"command": command.format(n=n), "n": n, "figures": figures}


def load_list(folder: Path) -> Evidence:
    (folder / "list.yaml").write_text(LIST, encoding="utf-8")
    return load(Evidence, folder / "list.yaml")


def test_results_of_another_policy_or_command_are_dropped(tmp_path: Path) -> None:
    listed = load_list(tmp_path)
    command = listed.results["one"].command
    good = result(command)
    assert published_results(listed, "a" * 64, {"one": good}, tmp_path) == {"one": good}
    for stale in (result(command, policy="b" * 64), result(command + " --seed 2"), None):
        assert not published_results(listed, "a" * 64, {"one": stale} if stale else {}, tmp_path)
    larger = result(command, 48)
    (tmp_path / "one.json").write_text(json.dumps({"one": larger}), encoding="utf-8")
    assert published_results(listed, "a" * 64, {"one": good}, tmp_path) == {"one": larger}
    assert (
        published_results(
            listed, "a" * 64, {"one": larger | {"n": 96, "command": command.format(n=96)}}, tmp_path
        )["one"]["n"]
        == 96
    )


def test_a_table_says_rate_interval_and_what_is_missing(tmp_path: Path) -> None:
    listed = load_list(tmp_path)
    rate = {"value": 0.995, "low": 0.9876, "high": 1.0, "count": 199, "total": 200}
    text = "a\n<!-- evidence: first -->\nold\n<!-- /evidence -->\nb\n"
    filled = fill_in(
        tmp_path,
        tmp_path / "README.md",
        text,
        listed,
        {"one": result("", success_given_resolvable=rate)},
    )
    assert (
        "| one | 99.50 % [98.76, 100] |" in filled
        and "`aaaaaaaa`" in filled
        and "old" not in filled
    )
    assert (
        fill_in(tmp_path, tmp_path / "README.md", filled, listed, {}).count("Not measured: one.")
        == 1
    )
    with pytest.raises(ConfigError, match="'second'"):
        fill_in(tmp_path, tmp_path / "README.md", text.replace("first", "second"), listed, {})


def test_parts_of_several_results_say_whose_they_are(tmp_path: Path) -> None:
    (tmp_path / "list.yaml").write_text(
        LIST.replace("title: two,", "title: two, parts: [y], needs: NO_SUCH_PROGRAM,").replace(
            "rows: [one]", "rows: [one, two], each: group"
        ),
        encoding="utf-8",
    )
    listed = load(Evidence, tmp_path / "list.yaml")
    figures = {f"group/{part}/success_given_resolvable": 0.5 for part in "xy"}
    results = {name: result("", n, **figures) for name, n in (("one", 24), ("two", 999))}
    text = "<!-- evidence: first -->\n<!-- /evidence -->\n"
    filled = fill_in(tmp_path, tmp_path / "README.md", text, listed, results)
    rows = [line for line in filled.splitlines() if line.startswith("| ")]
    assert rows == [
        "|  |  | resolved |",
        "| one; 24 | x | 0.5 |",
        "| one; 24 | y | 0.5 |",
        "| two; 999 | y | 0.5 |",
    ]


def test_a_result_without_its_program_is_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "list.yaml").write_text(
        LIST.replace("title: two,", "title: two, needs: NO_SUCH_PROGRAM,"), encoding="utf-8"
    )
    monkeypatch.delenv("NO_SUCH_PROGRAM", raising=False)
    out = tmp_path / "out"
    where = ["--list", str(tmp_path / "list.yaml"), "--out", str(out)]
    assert main([*where, "--only", "two"]) == 0
    assert "two: skipped: NO_SUCH_PROGRAM names no program" in capsys.readouterr().out
    assert not list(out.glob("two*"))


def test_figures_are_found_by_path_and_name() -> None:
    figures = {
        "a": {"value": 1.0, "low": 0.0},
        "b": [{"name": "x", "c": {"d": 2}}, {"name": "y", "c": {"d": 3}}],
        "e": [4],
    }
    assert find_figures(figures, ("a", "b/*/d")) == {
        "a": {"value": 1.0, "low": 0.0},
        "b/x/c/d": 2,
        "b/y/c/d": 3,
    }


def test_cells_count_trials_and_failures(tmp_path: Path) -> None:
    rows = 120
    table = {
        "relative_heading_deg": np.full(rows, -170.0),
        "own_speed_m_s": np.full(rows, 50.0),
        "intruder_speed_m_s": np.full(rows, 50.0),
        "outcome": ["reached"] * 100 + ["violation"] * 20,
        "verdict": ["resolvable"] * 105 + ["unresolvable"] * 15,
    }
    pq.write_table(pa.table(table), tmp_path / "encounters.parquet")
    figures = cells(tmp_path)
    cell = figures["cells/135 to 180 deg/0.9 to 1.1"]
    assert (cell["count"], cell["total"]) == (100, 105)
    assert sum(interval["total"] for interval in figures.values()) == 105
    # One-sided: the share at which 100 or more of 105 succeed with a chance of 5 %.
    from scipy.stats import binom

    assert binom.sf(99, 105, cell["low"]) == pytest.approx(0.05, rel=1e-6)
    table_rows = rows_of_cells(LISTED, {"domain_1": {"figures": figures}}, ["domain_1"])
    assert table_rows[4][4].startswith("5/105; 9") and table_rows[1][2] == "0/0; too few"


@pytest.mark.slow
def test_a_finished_result_is_not_made_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    load_list(tmp_path)
    arguments = [
        "--list",
        str(tmp_path / "list.yaml"),
        "--out",
        str(tmp_path / "out"),
        "--only",
        "first",
    ]
    assert main(arguments) == 0
    stored = read_results(tmp_path / "out/one.json")["one"]
    folder = next((tmp_path / "out").glob("one-*"))
    summary = json.loads((folder / "summary.json").read_text())
    assert stored["figures"]["success_given_resolvable"] == summary["success_given_resolvable"]
    assert stored["policy"] == Policy.load().sha256 == summary["policy_sha256"]
    capfd.readouterr()
    assert main(arguments) == 0
    assert "one: there already" in capfd.readouterr().out


@pytest.mark.parametrize("terminal", [True, False])
def test_a_run_ends_with_what_was_met_missed_and_left_open(
    terminal: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    names = list(LISTED.results)
    claimed = [name for name in names if LISTED.results[name].claim is not None]
    stored = read_results(STORE)
    results = {name: stored[name] for name in stored if name != names[-1]}
    show_closing(LISTED, results, names, tmp_path)
    # Without the sequences that make a terminal's letters slanted or bold.
    lines = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out).splitlines()
    assert lines[0].startswith(f"{len(names)} results: ")
    # A terminal's table breaks its title.
    title = takewhile(lambda line: not line.startswith("┏"), lines) if terminal else lines[:1]
    told = re.findall(r"(\d+) ([a-z ]+[a-z])", " ".join(" ".join(title).partition(":")[2].split()))
    counts = {state: int(count) for count, state in told}
    assert sum(counts.values()) == len(names)
    missing = sum(name not in results for name in claimed)
    judged = sum(counts.get(state, 0) for state in ("missed", "inconclusive", "met"))
    assert judged == len(claimed) - missing
    assert counts["not measured"] == len({*names} - {*results}) >= 1
    assert terminal or len(lines) <= 12
    assert sum(str(tmp_path) in line for line in lines) == 3
    if not terminal:
        named = next(line for line in lines if line.startswith("met: "))
        assert counts["met"] > 0 and claimed[0] in "".join(lines) and "target" not in named


@pytest.mark.parametrize(
    ("figures", "met", "cell"),
    [
        ({"broken": 0}, "yes", "0"),
        ({"broken": 2}, "no", "2"),
        ({"broken": {"value": None, "low": None, "high": None, "total": 0}}, "open", "-"),
        ({"others": 0}, "open", "-"),
    ],
)
def test_a_claim_whose_figure_is_not_there_is_open(
    figures: dict[str, Any], met: str, cell: str, tmp_path: Path, capsys: Any
) -> None:
    listed = load_list(tmp_path)
    entry = listed.results["one"].model_copy(update={"claim": ("broken", "<=", 0.0)})
    listed = listed.model_copy(update={"results": {"one": entry}})
    results = {"one": result(entry.command, **figures)}
    assert row_of(entry, results["one"], {"met": "{met}", "found": "{found}"})[1:] == [met, cell]
    show_closing(listed, results, ["one"], tmp_path)
    state = {"yes": "met", "no": "missed", "open": "not measured"}[met]
    assert capsys.readouterr().out.startswith(f"1 results: 1 {state}\n")
    small_checkout(tmp_path, CASE.replace("tests: [tests/test_a.py], ", ""))
    about = {"policy": "a" * 64, "commit": "c"}
    line = write(tmp_path, tmp_path / "d.html", listed, results, about, tmp_path)
    judged = {"yes": "shown", "no": "not met", "open": "open"}[met]
    assert f"the claim is {judged};" in line


@pytest.mark.parametrize(
    ("low", "high", "met"),
    [(0.96, 0.98, "yes"), (0.94, 0.98, "inconclusive"), (0.90, 0.94, "no"), (0.95, 0.95, "yes")],
)
def test_a_claim_of_a_rate_is_met_by_its_whole_interval(
    low: float, high: float, met: str, tmp_path: Path
) -> None:
    entry = load_list(tmp_path).results["one"]
    rate = {"value": 0.5 * (low + high), "low": low, "high": high, "total": 100}
    for sign, share in ((">=", rate), ("<=", {"value": 0.5, "low": 1 - high, "high": 1 - low})):
        bound = 0.95 if sign == ">=" else 1 - 0.95
        claimed = entry.model_copy(update={"claim": ("share", sign, bound)})
        assert row_of(claimed, result(entry.command, share=share), {"met": "{met}"})[1:] == [met]


def test_a_missed_claim_tells_by_how_much_and_why(tmp_path: Path) -> None:
    entry = load_list(tmp_path).results["one"]
    cells = {name: f"{{{name}}}" for name in ("claim", "found", "met", "gap", "why")}

    def cells_at(value: float, low: float, high: float, **more: Any) -> list[str]:
        claimed = entry.model_copy(update={"claim": ("share", ">=", 0.95), **more})
        share = {"value": value, "low": low, "high": high, "total": 100}
        return row_of(claimed, result(entry.command, share=share), cells)[1:]

    missed = cells_at(0.9, 0.85, 0.94)
    assert missed == [">= 95.00 %", "90.00 % [85.00, 94.00]", "no", "5.00 points", "not known"]
    assert cells_at(0.9, 0.85, 0.94, missed="few see it")[3:] == ["5.00 points", "few see it"]
    ratio = cells_at(0.9, 0.85, 0.94, ratio="risk ratio")
    assert ratio[:4] == ["risk ratio >= 0.95", "0.900 [0.850, 0.940]", "no", "0.050"]
    inconclusive = cells_at(0.95, 0.9, 0.97)
    assert inconclusive[2] == "inconclusive" and "more encounters" in inconclusive[4]
    assert cells_at(0.97, 0.96, 0.98)[2:] == ["yes", "-", "-"]


def test_no_plan_breaks_its_promise_is_claimed_where_intruders_turn() -> None:
    entry = LISTED.results["plan_maneuvering"]
    assert entry.claim == ("safe_plans_broken", "<=", 0.0)
    assert "--mode plan" in entry.command and "--scenario maneuvering" in entry.command
    for module in ("eval.monte_carlo", "eval.hifi"):
        assert {"safe_plans_broken", "safe_plans_not_promised"} <= {*LISTED.readings[module].keys}


@pytest.mark.slow
def test_an_attack_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    list_file, command = (
        (tmp_path / "list.yaml"),
        "benchmarks.safety --workers 1 --single 0 --block 100 --requests {n}",
    )
    entry = {"title": "attack", "command": command, "n": 200}
    reading = {"chunks": True, "keys": ["requests", "violations"]}
    listed = {
        "readings": {"benchmarks.safety": reading},
        "results": {"attack": entry},
        "tables": {},
    }
    list_file.write_text(json.dumps(listed), encoding="utf-8")
    arguments = ["--list", str(list_file), "--out", str(tmp_path), "--only", "attack"]
    assert main(arguments) == 0
    uninterrupted = read_results(tmp_path / "attack.json")["attack"]["figures"]
    batches = next(tmp_path.glob("attack-*/batches.jsonl"))
    lines = batches.read_text(encoding="utf-8").splitlines(keepends=True)
    batches.write_text("".join(lines[:-1]), encoding="utf-8")  # as if stopped before the last batch
    (tmp_path / "attack.json").unlink()
    assert main(arguments) == 0
    assert batches.read_text(encoding="utf-8").startswith("".join(lines[:-1]))
    assert (
        read_results(tmp_path / "attack.json")["attack"]["figures"]
        == uninterrupted
        == {"requests": 200, "violations": 0}
    )


CASE = """\
claim: {says: top, strategy: over parts, context: [C1]}
contexts: {C1: "a < b"}
assumptions: {A1: {title: none, says: nothing, where: nowhere}}
goals:
  G1:
    {says: part, strategy: s, assumes: [A1], requirements: {R-1: {says: x, tests: [tests/test_a.py], results: [one]}}}
not_claimed: []
repeat: {make: all}
"""


def small_checkout(folder: Path, case: str = CASE) -> Evidence:
    (folder / "tests").mkdir(exist_ok=True)
    (folder / "configs").mkdir(exist_ok=True)
    (folder / "tests/test_a.py").write_text(
        "def test_one(): ...\nclass TestB:\n    def test_two(self): ...\n"
    )
    (folder / "tests/test_b.py").write_text("def test_three(): ...\n")
    (folder / "configs/dossier.yaml").write_text(case, encoding="utf-8")
    claim = {"claim": ("success_given_resolvable", ">=", 0.9)}
    listed = load_list(folder)
    return listed.model_copy(
        update={"results": {"one": listed.results["one"].model_copy(update=claim)}}
    )


def test_a_goal_of_the_dossier_is_as_good_as_its_worst_evidence(tmp_path: Path) -> None:
    # Results alone: what a requirement's tests decide has a test of its own.
    listed = small_checkout(tmp_path, CASE.replace("tests: [tests/test_a.py], ", ""))
    about = {"policy": "a" * 64, "commit": "c"}
    assert names_of_tests(tmp_path) == [
        f"tests/test_{name}"
        for name in ("a.py::test_one", "a.py::TestB::test_two", "b.py::test_three")
    ]

    def state(results: dict[str, Any]) -> str:
        line = write(tmp_path, tmp_path / "d.html", listed, results, about, tmp_path)
        assert line.endswith("names 3 tests and 0 results")
        return line.partition("the claim is ")[2].partition(";")[0]

    def make_results(value: float, low: float, high: float, n: int = 24) -> dict[str, Any]:
        rate = {"value": value, "low": low, "high": high, "count": round(value * n), "total": n}
        return {"one": result("x", n, success_given_resolvable=rate)}

    assert state({}) == "open"
    assert state(make_results(0.95, 0.92, 1.0)) == "shown"
    assert state(make_results(0.95, 0.92, 1.0, 23)) == "open"  # fewer encounters than listed
    assert state(make_results(0.85, 0.8, 0.95)) == "open"
    assert state(make_results(0.5, 0.4, 0.6)) == "not met"
    page = (tmp_path / "d.html").read_text(encoding="utf-8")
    assert "one 12 of 24" in page and "a &lt; b" in page


@pytest.mark.slow
def test_a_requirement_of_the_dossier_is_as_good_as_its_tests(tmp_path: Path) -> None:
    listed, about = (
        small_checkout(tmp_path, CASE.replace(", results: [one]", "")),
        {"policy": "a", "commit": "c"},
    )
    good = (
        "import pytest\n@pytest.mark.parametrize('n', (0, 1))\ndef test_one(n): assert n in "
        "(0, 1)\n"
    )
    good += "class TestB:\n    def test_two(self): ...\n"

    def report(name: str, code: str, chosen: str) -> Path:
        (tmp_path / "tests/test_a.py").write_text(code)
        ask = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "--import-mode=importlib",
            "-k",
            chosen,
            f"--junitxml={name}",
        ]
        subprocess.run(ask, cwd=tmp_path, capture_output=True, timeout=100, check=False)
        return tmp_path / name

    def state_of_claim(*reports: Path) -> str:
        state = write(tmp_path, tmp_path / "d.html", listed, {}, about, tmp_path, reports)
        return state.partition("claim is ")[2].partition(";")[0]

    first, second = report("1.xml", good, "one"), report("2.xml", good, "two")
    bad = report(
        "bad.xml",
        good.replace("in (0, 1)\n", "\n").replace("class", "@pytest.mark.skip\nclass"),
        "test",
    )
    assert state_of_claim() == "open"  # nothing was run
    assert "2 not run" in (tmp_path / "d.html").read_text(encoding="utf-8")
    assert state_of_claim(first, second) == "shown"
    assert state_of_claim(first) == "open"
    assert "tests/<wbr>test_<wbr>a.py: 1 not run" in (tmp_path / "d.html").read_text(
        encoding="utf-8"
    )
    assert state_of_claim(bad) == state_of_claim(second, bad, first) == "not met"
    page = (tmp_path / "d.html").read_text(encoding="utf-8")
    assert "test_<wbr>one (failed)" in page and "test_<wbr>two (passed)" in page
    bad.write_text("<testsuites/>")
    with pytest.raises(ConfigError, match=r"bad\.xml"):
        state_of_claim(bad)


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("tests/test_a.py", "tests/test_a.py::test_none", "test_none"),
        ("results: [one]", "results: [two]", "'two'"),
        ("results: [one]", "documents: [absent.md]", "absent"),
        ("context: [C1]", "context: [C9]", "C9"),
        ("assumes: [A1]", "assumes: [A9]", "A9"),
        ("R-1:", "A1:", "A1"),
        ("tests: [tests/test_a.py], results: [one]", "tests: []", "R-1"),
    ],
)
def test_a_dossier_that_names_what_is_not_there_is_refused(
    tmp_path: Path, old: str, new: str, wrong: str
) -> None:
    assert old in CASE
    listed = small_checkout(tmp_path, CASE.replace(old, new))
    with pytest.raises(ConfigError, match=wrong):
        write(tmp_path, tmp_path / "d.html", listed, {}, {"policy": "a", "commit": "c"}, tmp_path)
    assert not (tmp_path / "d.html").exists()


def test_where_nothing_was_run_a_missed_result_leaves_the_claim_open(tmp_path: Path) -> None:
    listed, about = small_checkout(tmp_path), {"policy": "a", "commit": "c"}
    rate = {"value": 0.5, "low": 0.4, "high": 0.6, "count": 12, "total": 24}
    missed = {"one": result("x", 24, success_given_resolvable=rate)}
    page, report = tmp_path / "d.html", tmp_path / "r.xml"
    line = write(tmp_path, page, listed, missed, about, tmp_path)
    assert (
        "the claim is open; 3 of 3 tests were not run; results that miss their claim: one" in line
    )
    assert "not met: one" in page.read_text(encoding="utf-8")
    report.write_text(
        '<testsuites><testsuite><testcase classname="tests.test_a" name="test_one"/>'
        "</testsuite></testsuites>"
    )
    line = write(tmp_path, page, listed, missed, about, tmp_path, [report])
    assert "the claim is not met; 2 of 3 tests were not run" in line


def test_every_name_of_the_dossier_that_ships_resolves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = load(Case, ROOT / "configs/dossier.yaml")
    items = resolve(ROOT, case, LISTED, names_of_tests(ROOT))
    assert {name for item in items.values() for name in item.results} == set(LISTED.results)
    assert all(item.where for item in case.assumptions.values())
    assert {assumption for goal in case.goals.values() for assumption in goal.assumes} == set(
        case.assumptions
    )
    assert main(["--dossier", str(tmp_path / "d.html"), "--out", str(tmp_path / "none")]) == 0
    assert "the claim is open; " in capsys.readouterr().out  # of a fresh clone
    page = (tmp_path / "d.html").read_text(encoding="utf-8")
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids)) and set(re.findall(r'href="#([^"]+)"', page)) <= set(ids)
    assert not re.findall(r'(?:src|href)="(?!#|data:)', page) and not (tmp_path / "none").exists()


def test_an_unknown_name_is_refused(tmp_path: Path) -> None:
    load_list(tmp_path)
    with pytest.raises(ConfigError, match="'three'"):
        main(
            [
                "--list",
                str(tmp_path / "list.yaml"),
                "--out",
                str(tmp_path / "out"),
                "--only",
                "three",
            ]
        )
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_finished_and_goes_on(tmp_path: Path) -> None:
    load_list(tmp_path)
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "eval.evidence",
        "--list",
        str(tmp_path / "list.yaml"),
        "--out",
        str(out),
    ]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as child:
        end = time.monotonic() + 300.0
        while not list(out.glob("two-*/parts/*.parquet")) and time.monotonic() < end:
            time.sleep(0.2)
        child.send_signal(signal.SIGINT)
        _, errors = child.communicate(timeout=1_200)
    assert child.returncode == 130, errors
    assert read_results(out / "one.json") and not (out / "two.json").exists()
    assert list(out.glob("two-*/config.yaml"))


def test_rows_of_plans_name_the_limits_that_they_fly_with() -> None:
    def deg_s(limits: Limits) -> str:
        return f"({math.degrees(limits.yaw_rate_max):g} deg/s)"

    wide = deg_s(PAPER.vehicle_limits)
    for entry in LISTED.results.values():
        planned = re.search(r"eval\.monte_carlo .*--mode (plan|assured)", entry.command)
        assert (wide in entry.title) == bool(planned), entry.title
    for name, column in LISTED.tables["compare"].columns.items():
        assert (wide in name) == (", plan" in column or ", assured" in column), name
    assert f"policy {deg_s(PAPER.limits)}" in LISTED.tables["modes"].columns
