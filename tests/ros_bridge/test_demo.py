"""The whole loop: runner, monitor and simulator fly, what they fly is recorded, and others can read it."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros_bridge.graph import MISSING, ROOT, Process, domain

pytest.importorskip("rclpy", reason=MISSING)

from ros_bridge import demo


def flown(*arguments: str, seconds: float = 120.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ros_bridge.demo", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=False)


def test_an_encounter_is_flown_safely_and_the_recording_tells_the_same(tmp_path: Path):
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
    assert len(messages["/clock"]) > 500 and messages["/rlcas_runner/output/markers"]


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
def test_the_simulator_by_itself_says_who_is_missing():
    with domain() as number:
        process = Process("ros_bridge.simulator", number, "--ros-args", "-p", "monitor:=false")
        output, _ = process.popen.communicate(timeout=60.0)
    assert process.popen.returncode == 1
    assert "the runner has not answered within 30 s" in output
