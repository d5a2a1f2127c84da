"""A key that stands twice is refused wherever JSON or YAML is read: two readers of one file must not
see two things.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from safetensors.numpy import save_file

from agents.config.load import load
from agents.config.world import AircraftConfig
from agents.policy.file import PolicyFileError, parse
from commands.json_text import RepeatedKeyError, parse_json
from commands.text_file import json_of
from commands.yaml import YamlError, check_distinct
from commands.yaml import read as read_yaml
from envs.formats.areas import read_areas
from envs.formats.local_frame import LocalFrame
from envs.traffic.tracks import TrackError
from eval.evidence.dossier_page import _picture
from eval.evidence.listed import read_results
from eval.report.folder import read_run as read_report
from eval.sensitivity.bins import read_run
from rlcas_jax import checkpoint, metrics
from ros_bridge.core.feeds.aircraft_json import AircraftJson
from ros_bridge.core.feeds.traffic import Traffic
from ros_bridge.display.recording import read as read_recording
from ros_bridge.transport.overrides import refuse_unknown_nodes

ROOT = Path(__file__).resolve().parent.parent
FRAME = LocalFrame(47.0, 8.0)
TWICE = '{"a": 1, "b": [{"c": 1, "c": 2}]}'


def file_with(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def of_policy(text: str) -> Callable[[Path], object]:
    """Return a reader of a policy file whose header is this text."""
    head = text.encode()
    head += b" " * (-len(head) % 8)
    return lambda _: parse(len(head).to_bytes(8, "little") + head, "policy")


def of_checkpoint(folder: Path) -> None:
    path = folder / "checkpoint-000000000001.safetensors"
    save_file({}, path, {checkpoint._HEADER: '{"schema": 1, "schema": 2}'})
    checkpoint._read(path)


def of_sensitivity(folder: Path) -> None:
    file_with(folder, "summary.json", TWICE)
    file_with(folder, "encounters.parquet", "")
    read_run(folder)


def of_report(folder: Path) -> None:
    file_with(folder, "summary.json", TWICE)
    file_with(folder, "encounters.parquet", "")
    file_with(folder, "config.yaml", "")
    read_report(folder)


def of_live_traffic(folder: Path) -> None:
    (found,) = AircraftJson(Traffic("")).reports_of('{"now": 1, "now": 2, "aircraft": []}', 0)
    raise ValueError(str(found))


def of_checker(folder: Path) -> None:
    path = file_with(folder, "plan.json", TWICE)
    command = [sys.executable, "-m", "agents.check", str(path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    raise ValueError(done.stderr)


def of_parameters(folder: Path) -> None:
    text = "/**:\n  ros__parameters: {margin: 50.0, margin: 5.0}\n"
    path = file_with(folder, "parameters.yaml", text)
    refuse_unknown_nodes(["--ros-args", "--params-file", str(path)], ["rlcas_runner"])


def of_aircraft(folder: Path) -> None:
    text = (ROOT / "configs" / "aircraft" / "uas.yaml").read_text(encoding="utf-8")
    key = next(line for line in text.splitlines() if line.startswith("speed_max_mps"))
    load(AircraftConfig, file_with(folder, "own.yaml", f"{text}\n{key}\n"))


def of_sections(folder: Path) -> None:
    """Two names of one node: ROS takes the later section."""
    text = "rlcas_runner: {ros__parameters: {margin: 50.0}}\n"
    text += "/: {rlcas_runner: {ros__parameters: {margin: 5.0}}}\n"
    path = file_with(folder, "parameters.yaml", text)
    refuse_unknown_nodes(["--ros-args", "--params-file", str(path)], ["rlcas_runner"])


def of_failures(folder: Path) -> None:
    path = file_with(folder, "failures.json", TWICE)
    _picture(path.with_suffix(".png"), "policy")


READERS: dict[str, Callable[[Path], Any]] = {
    "a text": lambda _: parse_json(TWICE),
    "a data file": lambda folder: json_of(str(file_with(folder, "tracks.json", TWICE)), TrackError),
    "the metadata of a policy": of_policy(
        json.dumps({"__metadata__": {"rlcas_policy": TWICE}}, separators=(",", ":"))
    ),
    "the metrics of a training": lambda folder: metrics.read(
        file_with(folder, "metrics.jsonl", '{"step": 1, "step": 2}\n')
    ),
    "a checkpoint": of_checkpoint,
    "a run's summary": of_sensitivity,
    "a run's summary in a report": of_report,
    "live ADS-B": of_live_traffic,
    "a certificate": of_checker,
    "a configuration": lambda folder: read_yaml(
        file_with(folder, "a.yaml", "a: 1\nb: {c: 1, c: 2}")
    ),
    "an aircraft": of_aircraft,
    "parameters of a node": of_parameters,
    "sections of a node": of_sections,
    "results of the evidence": lambda folder: read_results(
        file_with(folder, "evidence.json", TWICE)
    ),
    "pictures of the assurance case": of_failures,
    "an encounter to look at": lambda folder: read_recording(file_with(folder, "a.json", TWICE)),
    "areas in GeoJSON": lambda folder: read_areas(file_with(folder, "a.geojson", TWICE), FRAME),
    "areas of a plan of QGroundControl": lambda folder: read_areas(
        file_with(folder, "a.plan", TWICE), FRAME
    ),
    "areas in YAML": lambda folder: read_areas(
        file_with(folder, "a.yaml", "geofences: {a: 2, 'a': 3}"), FRAME
    ),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_key_that_stands_twice_is_refused(tmp_path: Path, reader: str):
    with pytest.raises(Exception, match="stands twice") as caught:
        READERS[reader](tmp_path)
    assert isinstance(caught.value, ValueError), "a refusal, not a fault of the program"


def test_files_that_say_what_they_are_by_their_form_refuse_it_too(tmp_path: Path):
    # The library that reads safetensors refuses it, or the header is not in its one spelling.
    with pytest.raises(PolicyFileError, match=r"not a valid safetensors|canonical"):
        of_policy('{"a":1,"a":1}')(tmp_path)


def test_keys_that_stand_once_in_each_object_are_read():
    text = '{"a": [{"c": 1}, {"c": NaN}], "c": {"a": 2}}'
    assert parse_json(text)["c"] == {"a": 2}
    check_distinct("a: &x {c: 1}\nb: *x\n? [1, 2]\n: 3\n")
    check_distinct("a: &x {c: 1}\nb: {<<: *x, c: 2}\n1: one\n")
    for wrong in ('{"c": {"c": 1, "c": 1}}', '[[{"": 1, "": 1}]]'):
        with pytest.raises(RepeatedKeyError):
            parse_json(wrong)
    for same in ("1: a\n0x1: b\n", "yes: a\ntrue: b\n", "1: a\n'1': b\n"):
        with pytest.raises(YamlError, match=r"line 2: key .* stands twice"):
            check_distinct(same)
    with pytest.raises(YamlError, match="line 2: key a stands twice"):
        check_distinct("- {a: 1}\n- {a: 1, 'a': 2}\n")


def test_no_other_code_reads_json_or_yaml():
    """Only the two helpers do, and the checker, which shares no code with what it checks."""
    allowed = {
        "commands/json_text.py",
        "commands/yaml.py",
        "agents/check/command.py",
        # Run by another program's Python, without ours; what it reads is written beside it.
        "benchmarks/icarous/inside.py",
        # After check_distinct: files of ROS are YAML 1.1.
        "ros_bridge/transport/overrides.py",
    }
    readers = ("json.load", "yaml.safe_load", "yaml.load", "yaml.full_load")
    strays = [
        name
        for folder in (
            "agents",
            "benchmarks",
            "commands",
            "envs",
            "eval",
            "rlcas_jax",
            "ros_bridge",
        )
        for path in sorted((ROOT / folder).rglob("*.py"))
        if (name := path.relative_to(ROOT).as_posix()) not in allowed
        and any(reader in path.read_text(encoding="utf-8") for reader in readers)
    ]
    assert not strays
