"""The report shows what the run's files say, refuses what is no run, and lets nothing of the data
become markup.
"""

import base64
import hashlib
import json
import re
import shutil
import subprocess
import sys
import unicodedata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import ConfigError
from agents.planner.request.options import Options
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.kinematics import VehicleState
from envs.wind import Wind
from eval.config import MonteCarloConfig
from eval.flights.chunks import ReadyEvaluation
from eval.flights.recorded import Track, fly_recorded
from eval.metrics.summary import headline
from eval.plots.style import MARKERS, kinds_of
from eval.report import run as report
from eval.report.bands import bands_data, flight_bands
from eval.report.data import (
    NEAREST,
    OTHERS,
    POINTS,
    choose,
    flight_data,
    json_text,
    page_data,
    points,
)
from eval.report.flights import Replayed, Witness, bands_of, evaluation_of, fly_again
from eval.report.folder import read_run
from eval.report.page import page
from eval.runner.options import named_evaluation
from ros_bridge.display.document import to_json
from ros_bridge.display.recording import read
from tests.eval.conftest import PAGE

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def copy(report_run: Path, tmp_path: Path) -> Path:
    """Return a copy of the run that a test may spoil."""
    return Path(shutil.copytree(report_run, tmp_path / "run"))


def edit_summary(folder: Path, change: Any) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    change(summary)
    (folder / "summary.json").write_text(json.dumps(summary))


def edit_table(folder: Path, change: Any) -> None:
    path = folder / "encounters.parquet"
    pq.write_table(change(pq.read_table(path)), path)


def set_key(key: str, value: Any) -> Any:
    return lambda folder: edit_summary(folder, lambda summary: summary.__setitem__(key, value))


SPOILT = {
    "no config.yaml": lambda folder: (folder / "config.yaml").unlink(),
    "no encounters.parquet": lambda folder: (folder / "encounters.parquet").unlink(),
    "no summary.json": lambda folder: (folder / "summary.json").unlink(),
    "schema_version is 2": set_key("schema_version", 2),
    "cannot be read as JSON": lambda folder: (folder / "summary.json").write_text(
        '{"schema_version": 1'
    ),
    "policy_sha256 is '0000": set_key("policy_sha256", "0" * 64),
    "seed is 77": set_key("seed", 77),
    "cannot be read as parquet": lambda folder: (folder / "encounters.parquet").write_bytes(
        b"PAR1"
    ),
    "has the schema 'none'": lambda folder: edit_table(
        folder, lambda table: table.replace_schema_metadata(None)
    ),
    "has no column bearing_deg": lambda folder: edit_table(
        folder, lambda table: table.drop_columns(["bearing_deg"])
    ),
    "has 20 rows, expected 24": lambda folder: edit_table(folder, lambda table: table.slice(0, 20)),
    "seeed is unknown": lambda folder: (folder / "config.yaml").write_text("seeed: 1\n"),
    "initial_conditions.png: cannot be read": lambda folder: (folder / "config.yaml").write_text(
        (folder / "config.yaml").read_text().replace("figures: false", "figures: true")
    ),
}


@pytest.mark.parametrize("sentence", SPOILT)
def test_what_is_no_whole_run_is_refused_with_a_sentence(sentence: str, copy: Path) -> None:
    SPOILT[sentence](copy)
    before = sorted(path.name for path in copy.iterdir())
    with pytest.raises(ConfigError, match=re.escape(sentence)) as caught:
        report.main([str(copy), "--tracks", "0"])
    assert "expected" in str(caught.value) or "unknown" in str(caught.value)
    assert sorted(path.name for path in copy.iterdir()) == before  # nothing is left behind


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nowhere"], "nowhere does not exist, expected a folder"),
        (["pyproject.toml"], "pyproject.toml is a file, expected a folder"),
        ([], "DIR: expected the folder of a finished run"),
        (["nowhere", "--tracks", "-1"], "expected a whole number"),
        (["nowhere", "--show", "1,two"], "expected numbers of encounters"),
    ],
)
def test_a_users_mistake_ends_with_status_2_and_one_line(
    arguments: list[str], sentence: str
) -> None:
    result = subprocess.run(
        [sys.executable, "-m", "eval.report", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr.startswith("error: ")
    assert sentence in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_number_that_the_run_does_not_have_is_refused(copy: Path) -> None:
    with pytest.raises(ConfigError, match="--show: 24; expected numbers of encounters, 0 to 23"):
        report.main([str(copy), "--show", "24"])


def test_another_policy_is_refused(copy: Path) -> None:
    with pytest.raises(ConfigError, match=r"has SHA-256 .* as in the run"):
        report.main([str(copy), "--policy", str(ROOT / "agents" / "data" / "policy.safetensors")])


def test_an_unwritable_target_fails_before_anything_is_flown(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", refuse)
    monkeypatch.setattr(report, "_make_report", lambda *_: pytest.fail("the work has begun"))
    with pytest.raises(ConfigError, match="cannot be written: Permission denied"):
        report.main([str(copy)])


@pytest.mark.slow
def test_flights_come_out_as_the_table_says(report_run: Path) -> None:
    run = read_run(report_run)
    failed = {int(number) for number in np.flatnonzero(run.kinds == "loss of separation")[:2]}
    numbers = [*range(6), *sorted(failed)]
    flights = list(fly_again(run, evaluation_of(run), numbers, failed))
    assert [flight.number for flight in flights] == numbers
    for flight in flights:
        assert flight.matches_table
        track = flight.track
        # The start counts too.
        start = np.min(np.hypot(*(track.intruders[:, :, 0] - track.own[:, 0]).T))
        closest = min(start, float(np.min(track.separation)))
        assert closest == pytest.approx(run.table["min_separation_m"][flight.number], abs=1e-6)
        assert len(track.separation) == run.table["duration_s"][flight.number]
        assert track.own.shape == (2, len(track.separation) + 1)
        if flight.witness is not None:
            assert flight.number in failed
            assert flight.witness.separation >= run.rules.separation
            to_goal = np.hypot(*(flight.witness.path[:, -1] - track.goal))
            assert to_goal <= run.rules.goal_radius + 1e-6


def test_the_bands_of_a_flight_are_those_of_its_single_moments(report_run: Path) -> None:
    """Row after row of a flight, and of its mirror image, where left and right change places."""
    run = read_run(report_run)
    evaluation = evaluation_of(run)
    options = evaluation.options
    number = int(np.flatnonzero(run.kinds == "loss of separation")[0])
    flight = next(fly_again(run, evaluation, [number], set(), {number}))
    bands, track = flight.bands, flight.track
    assert bands is not None and bands.tracks.shape == (track.own.shape[1], 72)
    assert bands.level.shape == (track.own.shape[1], len(track.intruders))
    # It loses the separation: the alert was a warning before, and nothing was free at the end.
    assert bands.level[-1].max() == 3
    assert not (bands.tracks[-1] == 0).any() and bands.way_out[-1] >= 0
    runs = np.array(bands_data(bands)["tracks"]).reshape(-1, 2)
    assert np.array_equal(np.repeat(runs[:, 0], runs[:, 1]), bands.tracks.ravel())
    at = len(bands.tracks) // 2
    heading = np.arctan2(*np.diff(track.own[::-1, at : at + 2], axis=1)[:, 0])
    own = VehicleState(track.own[0, at], track.own[1, at], heading, 80.0)
    intruder = VehicleState(
        *(np.array([[value]]) for value in (*track.intruders[0, :, at], 1.0, 80.0))
    )
    own = VehicleState(*(np.array([float(value)]) for value in own))
    plain = flight_bands(own, intruder, options)
    mirrored = [
        state._replace(x=-state.x, heading=wrap(np.pi - state.heading, np))
        for state in (own, intruder)
    ]
    image = flight_bands(*mirrored, options)
    swapped = np.roll(image.tracks[0][::-1], 1)  # track n degrees becomes -n
    assert np.mean(plain.tracks[0] == swapped) > 0.97  # ties of turns to 180 degrees
    assert np.array_equal(plain.speeds, image.speeds)


@pytest.mark.slow
def test_bands_in_a_wind_are_those_of_the_air_mass(policy_path: Path) -> None:
    # The first moment of an encounter is the same in the air mass of any wind.
    at_start = []
    for strength in (0.0, 14.0):
        keys = {"mode": "plan", "wind_mps": (strength, strength), "seed": 8}
        evaluation = named_evaluation(MonteCarloConfig(policy=policy_path, **keys))[0]
        flown = fly_recorded(ReadyEvaluation.load(evaluation), [0])
        winds = evaluation.wind(flown.starts, np.array([0]))
        wind = None if winds is None else Wind(*(float(part[0]) for part in winds))
        at_start.append(bands_of(flown, 0, flown.track(0), evaluation, wind))
    calm, windy = at_start
    assert np.array_equal(calm.speeds[0], windy.speeds[0])
    assert windy.loss[0] == pytest.approx(calm.loss[0])


def test_bands_count_in_each_intruders_own_separation() -> None:
    own = VehicleState(*(np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, 80.0)))
    ahead = VehicleState(*(np.full((1, 1), value) for value in (9e3, 0.0, np.pi, 80.0)))
    options = Options.for_aircraft(PAPER)
    usual, wide = (
        flight_bands(own, ahead, options, (), separations)
        for separations in (None, np.array([3_000.0]))
    )
    of_usual = flight_bands(own, ahead, options, (), np.array([options.requirement.separation]))
    assert np.array_equal(of_usual.tracks, usual.tracks)
    assert wide.loss[0, 0] == pytest.approx(usual.loss[0, 0] - 2_000.0 / 160.0, abs=0.5)
    assert np.count_nonzero(wide.tracks) > np.count_nonzero(usual.tracks)


def test_a_saved_encounter_is_what_the_display_opens(copy: Path) -> None:
    run = read_run(copy)
    number = int(np.flatnonzero(run.kinds == "loss of separation")[0])
    report.main([str(copy), "--tracks", "1", "--save", str(number), "--bands", "0"])
    recording = read(copy / "encounters" / f"{number}.json")
    assert recording.length == run.table["duration_s"][number]
    assert recording.marks[-1][1] == 3
    picture = to_json(recording.player()(recording.length))
    apart = [
        np.hypot(intruder["x"] - picture["own"]["x"], intruder["y"] - picture["own"]["y"])
        for intruder in picture["traffic"]
    ]
    assert min(apart) < 1.2 * run.rules.separation
    assert picture["bands"]["recovery"] is not None and picture["advice"]["do"] == "recovery"
    with pytest.raises(ConfigError, match="--save: 999; expected numbers of encounters"):
        report.main([str(copy), "--save", "999"])


def test_a_flight_that_differs_from_the_table_is_marked(report_run: Path) -> None:
    run = read_run(report_run)
    elsewhere = run.table["min_separation_m"] + np.where(run.table["encounter"] == 3, 1.0, 0.0)
    run = run._replace(table={**run.table, "min_separation_m": elsewhere})
    flights = list(fly_again(run, evaluation_of(run), [3, 4], set()))
    assert [flight.matches_table for flight in flights] == [False, True]
    assert "differs" in flight_data(flights[0])
    assert "differs" not in flight_data(flights[1])


def unpack(stored: dict[str, Any]) -> dict[str, np.ndarray]:
    """Read a flight as the page does."""
    numbers = np.frombuffer(base64.b64decode(stored["packed"]), "<i2").astype(float)
    states, count = stored["steps"] + 1, stored["intruders"]
    witness = stored.get("witness", {}).get("points", 0)
    sizes = (
        2 * states,
        2 * states * count,
        stored["steps"],
        2 * witness,
        stored["steps"],
        stored["steps"],
    )
    own, intruders, separation, also, turn, push = np.split(numbers, np.cumsum(sizes)[:-1])
    scale = stored["scale"]
    return {
        "own": own.reshape(2, -1) * scale,
        "intruders": intruders.reshape(count, 2, -1) * scale,
        "separation": separation * scale,
        "witness": also.reshape(2, -1) * scale,
        "turn": turn * 1e-3,
        "push": push * 1e-3,
    }


@given(
    steps=st.integers(1, 40),
    count=st.integers(1, 8),
    size=st.floats(1.0, 3e6),
    offset=st.floats(-1e6, 1e6),
    seed=st.integers(0, 99),
)
def test_a_packed_flight_is_the_flight_to_half_its_scale(
    steps: int, count: int, size: float, offset: float, seed: int
) -> None:
    draw = np.random.default_rng(seed).uniform
    own, intruders = (
        draw(-size, size, (2, steps + 1)) + offset,
        draw(-size, size, (count, 2, steps + 1)) + offset,
    )
    way = draw(-size, size, (2, 5)) + offset
    witness = Witness(way, 60.0, 1_001.0)
    turn, push = draw(-0.09, 0.09, steps), draw(-1.0, 1.0, steps)
    track = Track(own, intruders, draw(0, size, steps), (offset, offset))
    flight = Replayed(7, track, push, turn, True, None, None, witness)
    stored = flight_data(flight)
    unpacked, half = unpack(stored), 0.5 * stored["scale"] + 1e-6
    # The origin is not stored: what matters is where everybody is from each other and from the
    # goal.
    shift = own[:, :1] - unpacked["own"][:, :1]
    assert np.abs(shift - np.round(shift)).max() <= half + 0.5
    assert np.abs(unpacked["own"] + shift - own).max() <= 2.0 * half
    assert np.abs(unpacked["intruders"] + shift - intruders).max() <= 2.0 * half
    assert np.abs(unpacked["witness"] + shift - way).max() <= 2.0 * half
    assert np.abs(np.array(stored["goal"]) + shift[:, 0] - offset).max() <= half + 0.1
    assert np.abs(unpacked["separation"] - flight.track.separation).max() <= half
    assert np.abs(unpacked["turn"] - np.degrees(turn)).max() <= 5.1e-4
    assert np.abs(unpacked["push"] - push).max() <= 5.1e-4


def run_of(kinds: list[str]) -> Any:
    """Return what choosing reads of a run with these kinds of encounters."""
    separation = np.random.default_rng(len(kinds)).uniform(1_000.0, 1_200.0, len(kinds))
    rules = SimpleNamespace(separation=1_000.0)
    table = {"min_separation_m": separation}
    return SimpleNamespace(kinds=np.array(kinds, dtype=object), table=table, rules=rules)


@given(
    kinds=st.lists(st.sampled_from(list(MARKERS)), min_size=1, max_size=400),
    most=st.integers(0, 500),
)
def test_failures_come_first_and_nobody_twice(kinds: list[str], most: int) -> None:
    run = run_of(kinds)
    chosen = choose(run, most, [0][:most])
    numbers = np.concatenate([choice.numbers for choice in chosen]) if chosen else np.array([])
    assert len(set(numbers.tolist())) == len(numbers) <= most
    failures = np.flatnonzero((run.kinds == "loss of separation") | (run.kinds == "time-out"))
    if most > len(failures):
        assert set(failures) <= set(numbers)
    by_group = {choice.group: choice for choice in chosen}
    for group, bound in (("close successes", NEAREST), ("other successes", OTHERS)):
        if group in by_group:
            assert len(by_group[group].numbers) <= bound
    if "close successes" in by_group:
        nearest = run.table["min_separation_m"][by_group["close successes"].numbers]
        assert (np.diff(nearest) >= 0.0).all()


def test_a_large_run_keeps_its_points_bounded_and_its_failures() -> None:
    kinds = ["success"] * 60_000
    for number in range(0, 60_000, 100):
        kinds[number] = "loss of separation"
    replayed = np.arange(0, 500)
    numbers = points(run_of(kinds), replayed)
    assert len(numbers) == len(set(numbers.tolist())) == POINTS
    assert (np.diff(numbers) > 0).all()
    assert set(range(0, 60_000, 100)) | set(range(500)) <= set(numbers.tolist())


@given(
    st.dictionaries(
        st.text(), st.text() | st.floats(allow_nan=False, allow_infinity=False) | st.none()
    )
)
def test_json_in_the_page_cannot_leave_its_element(data: dict[str, Any]) -> None:
    text = json_text({**data, "</script><!--<script>": "&lt;"})
    assert not set("<>&") & set(text)
    assert text.isascii()
    assert json.loads(text) == {**data, "</script><!--<script>": "&lt;"}


def test_the_page_says_what_the_summary_says(report_run: Path, report_page: Path) -> None:
    text, summary = (
        report_page.read_text(encoding="utf-8"),
        json.loads((report_run / "summary.json").read_text()),
    )
    rows = dict(re.findall(r'<tr><th scope="row">([^<]*)</th><td>([^<]*)</td>', text))
    assert rows["success of all encounters"] == f"{100 * summary['success_rate']['value']:.2f} %"
    assert (
        rows["risk ratio: losses of separation with the resolver / without it"]
        == f"{summary['risk_ratio']:.4f}"
    )
    assert len(rows) == len(headline(summary, {}))
    # Mode policy refuses more intruders than it was trained with; beside plans it is said.
    crowd = summary | {"policy_violation_rate": summary["violation_rate"]}
    for count, is_said in ((0, False), (7, True)):
        lines = headline(crowd | {"outside_domain": {"intruders": count}}, {})
        (line,) = [line for line in lines if line.key == "policy_violation_rate"]
        assert ("; 7 encounters have more intruders than it knows" in line.counted) == is_said
    # What SAFE promises, and what it does not, stands before the sum, which alarms.
    plans = summary | {"safe_plans_broken": 0, "safe_plans_not_promised": 9}
    labels = [line.label for line in headline(plans | {"safe_plans_violated": 9}, {})][-3:]
    assert [("must be 0" in text, "not promised" in text) for text in labels] == [
        (True, False),
        (False, True),
        (False, False),
    ]
    violations = summary["violation_rate"]
    assert f"{violations['count']} of {violations['total']}" in text
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])
    assert f"{len(data['flights'])} encounters have tracks" in text
    run = read_run(report_run)
    kinds = np.frombuffer(base64.b64decode(data["kind"]), np.uint8)
    assert [data["kinds"][code] for code in kinds] == run.kinds.tolist()
    assert set(np.flatnonzero(run.kinds != "success")) <= {
        int(number) for number in data["flights"]
    }


def test_table_and_filter_count_the_unresolvable_alike(report_run: Path) -> None:
    run = read_run(report_run)
    lost = np.flatnonzero(run.table["outcome"] == "violation")
    assert len(lost) > 2
    verdict = run.table["verdict"].copy()
    verdict[lost[:2]] = "unresolvable"
    table = {**run.table, "verdict": verdict}
    run = run._replace(table=table, kinds=kinds_of(table))
    text = page(run, [], page_data(run, np.arange(len(verdict)), {}), "nothing")
    assert f"{len(lost)} of {len(verdict)}, 2 of them proven unresolvable" in text
    assert f"> loss of separation ({len(lost) - 2})</label>" in text
    assert "> proven unresolvable (2)</label>" in text
    assert f'<a href="#{lost[0]}">{lost[0]}</a>, <a href="#{lost[1]}">{lost[1]}</a>' in text
    own = f'Losses of separation ({len(lost) - 2}): <a href="#{lost[2]}">'
    assert text.index(own) < text.index('Proven unresolvable (2): <a href="')


def test_no_name_reverses_the_text_after_it(report_page: Path) -> None:
    text = report_page.read_text(encoding="utf-8")
    assert r"\u202etfel ot thgir" in text  # the code in words, escaped once more as JSON
    assert not {character for character in text if unicodedata.category(character) == "Cf"}


def test_the_page_holds_everything_and_asks_for_nothing(report_page: Path) -> None:
    text = report_page.read_text(encoding="utf-8")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)[1]
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digests = [
        base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in scripts
    ]
    assert re.findall(r"'sha256-([^']*)'", policy) == digests
    data = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1]
    for code in (data, *scripts, re.search(r"<style>(.*?)</style>", text, re.DOTALL)[1]):
        text = text.replace(code, "")
    assert not re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?(?!data:|#)[^"'\s>]+""", text)
    assert "http:" not in text
    assert "https:" not in text


@pytest.mark.slow
def test_the_same_run_gives_the_same_page(
    report_run: Path, report_page: Path, tmp_path: Path
) -> None:
    again = Path(shutil.copytree(report_run, tmp_path / "again"))
    report.main([str(again), *PAGE])
    assert (again / "report.html").read_bytes() == report_page.read_bytes()


def test_page_data_are_finite_json(report_run: Path) -> None:
    run = read_run(report_run)
    data = page_data(run, np.arange(len(run.kinds)), {})
    assert json.loads(json_text(data))["count"] == len(run.kinds)


def test_the_bundled_library_is_the_published_one() -> None:
    data = ROOT / "eval" / "data"
    digest = hashlib.sha256((data / "echarts.min.js").read_bytes()).hexdigest()
    readme = (data / "README.md").read_text(encoding="utf-8")
    assert digest in readme
    version = re.search(r"Apache ECharts ([0-9.]+[0-9])", readme)[1]
    assert f'.version="{version}"' in (data / "echarts.min.js").read_text(encoding="utf-8")
    assert f"Apache ECharts {version}" in (data / "report.html").read_text(encoding="utf-8")
    assert "Apache License" in (data / "echarts-LICENSE.txt").read_text(encoding="utf-8")
