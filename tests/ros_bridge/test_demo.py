"""The whole loop: runner, monitor and simulator fly, what they fly is recorded, and others can read it."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.ros_bridge.graph import MISSING, ROOT, Process, domain

pytest.importorskip("rclpy", reason=MISSING)

from agents.policy.inference import Policy
from ros_bridge import demo


def flown(*arguments: str, seconds: float = 120.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ros_bridge.demo", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=False)


def test_encounter_is_flown_safely_and_recorded(tmp_path: Path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed; to have it: make ros")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    file = tmp_path / "flight.mcap"
    done = flown("--scenarios", "crossing_right", "--record", str(file), "--rate", "100")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 1 encounters had a plan called SAFE" in done.stdout

    messages: dict[str, list] = {}
    last = 0
    with file.open("rb") as stream:
        for _, channel, message, content in reader.make_reader(
            stream, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages():
            assert message.log_time >= last
            last = message.log_time
            messages.setdefault(channel.topic, []).append(content)
    plans = messages["/rlcas_runner/output/trajectory"]
    assert plans[0].status == 1 and len(plans[0].waypoints) == 20
    assert plans[0].min_separation >= 1_025.0
    assert {said.fly for said in messages["/rlcas_monitor/output/status"]} == {0, 1}
    assert messages["/rlcas_runner/input/traffic"][0].id == "4b0001"
    values = {one.key: one.value for said in messages["/diagnostics"] for one in said.status[0].values}
    assert values["policy sha256"] == Policy.load().sha256
    assert len(messages["/clock"]) > 500 and messages["/rlcas_runner/output/markers"]


def children(process: int) -> list[int]:
    found = Path(f"/proc/{process}/task").glob("*/children")
    return [int(one) for file in found for one in file.read_text().split()]


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def eventually(holds: Callable[[], object], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it did not come to pass in time"
        time.sleep(0.1)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_killed_demo_leaves_no_process_and_a_readable_recording(tmp_path: Path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed; to have it: make ros")
    file = tmp_path / "flight.mcap"
    command = [sys.executable, "-m", "ros_bridge.demo", "--random", "9", "--rate", "5", "--record", str(file)]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL) as demo:
        eventually(lambda: len(children(demo.pid)) == 2)
        nodes = children(demo.pid)
        eventually(lambda: file.stat().st_size > 30_000)
        demo.kill()
    eventually(lambda: not any(map(alive, nodes)))
    with file.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in reader.make_reader(stream).iter_messages()}
    assert {"/clock", "/rlcas_runner/input/ownship"} <= topics


@pytest.mark.slow
def test_full_disk_ends_a_recording_in_one_sentence_and_keeps_it(tmp_path: Path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed; to have it: make ros")
    file = tmp_path / "flight.mcap"
    command = ["--scenarios", "head_on", "--each", "9", "--rate", "20", "--record", str(file)]
    # Files may grow to so many blocks only: what a full disk does, without one.
    limited = ["bash", "-c", 'ulimit -f 64; exec "$@"', "bash", sys.executable, "-m", "ros_bridge.demo", *command]
    done = subprocess.run(limited, cwd=ROOT, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 1, done.stderr
    assert f"{file} cannot be written: File too large" in done.stderr and "Traceback" not in done.stderr
    assert not file.exists()
    with (tmp_path / "flight.partial.mcap").open("rb") as stream:
        assert sum(1 for _ in reader.make_reader(stream).iter_messages()) > 100


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--vehicle", "glider"], "--vehicle is 'glider', expected one of kinematic, point_mass, c208"),
        (["--scenarios", "sideways"], "scenario 'sideways' is unknown"),
        (["--scenarios", "none"], "expected something to fly"),
        (["--random", "-1"], "--random is -1, expected 0 or more"),
        (["--rate", "0"], "rate"),
        (["--margin", "-1"], "--margin is -1 m, expected 0 to 5000 m"),
        (["--record", "/nowhere/x.mcap"], "/nowhere/x.mcap cannot be written"),
    ],
)
def test_bad_input_ends_with_one_line_and_code_2(arguments: list[str], says: str, capfd, monkeypatch):
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.setenv(name, "0")
    assert demo.main(arguments) == 2
    error = capfd.readouterr().err
    assert says in error and "Traceback" not in error and error.startswith("python -m ros_bridge.demo: error: ")


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["kinematic", "c208"])
def test_the_four_scenarios_are_flown_safely(vehicle: str):
    if vehicle == "c208":
        pytest.importorskip("jsbsim")
    done = flown("--vehicle", vehicle, "--each", "2", seconds=600.0)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "8 of 8 encounters had a plan called SAFE" in done.stdout


@pytest.mark.slow
def test_simulator_alone_names_the_missing_nodes():
    with domain() as number:
        process = Process("ros_bridge.simulator", number, "--ros-args", "-p", "monitor:=false")
        output, _ = process.popen.communicate(timeout=60.0)
    assert process.popen.returncode == 1
    assert "the runner has not answered within 30 s" in output
