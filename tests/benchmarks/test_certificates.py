"""The attack on certificates: its judgement is good to micrometres, and a stopped run goes on."""

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.inference import Policy
from agents.planner import Intruder, plan
from agents.planner.request import Altitude
from benchmarks.safety import certificates, judgement, mutation
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    intruders = [
        Intruder(VehicleState(9_000.0, 100.0, 3.14, 80.0), 0.4, 0.01, 20.0, 5.0, 0.5, Altitude(2_500.0, "msl")),
        Intruder(VehicleState(5_000.0, 600.0, -2.0, 70.0), altitude=Altitude(5_500.0, "msl")),
    ]
    own = VehicleState(0.0, 0.0, 0.0, 80.0)
    answer = plan(own, intruders, ROUTE, Policy.load(), own_altitude=Altitude(2_500.0, "msl"))
    assert answer.certificate is not None
    return json.loads(answer.certificate)


@pytest.mark.parametrize(("nearer", "fault"), [(-1e-5, ""), (1e-5, "distance"), (5.0, "distance")])
def test_judgement_is_good_to_some_micrometres(data: dict[str, Any], nearer: float, fault: str) -> None:
    edited = copy.deepcopy(data)
    mutation.approach(edited, 0, edited["requirement"]["separation"] - nearer)
    assert judgement.wrong([edited]) == [fault]


@pytest.mark.parametrize(
    ("path", "change", "fault"),
    [
        (("own", 0), 0.01, "joint"),
        (("waypoints", 5, 2), 1e-4, "course"),
        (("waypoints", 5, 4), 25.0, "times"),
        (("controls", 4, 3), 3e-6, "controls"),
        (("controls", 4, 13), 3e-6, "controls"),
        (("limits", "speed_max"), -30.0, "speed"),
        (("limits", "acceleration_max"), -0.6, "acceleration"),
        (("limits", "yaw_rate_max"), -0.08, "turn rate"),
        (("bounds", 0), 0.1, "distance"),
        (("intruders", 0, 7), -6.0, "negative"),
        (("excluded", 0, 2), -2_500.0, "excluded"),
    ],
)
def test_judgement_finds_each_fault(data: dict[str, Any], path: tuple[Any, ...], change: float, fault: str) -> None:
    edited = copy.deepcopy(data)
    place = edited
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] += change
    found, good = judgement.wrong([edited, data])
    assert fault in found.split(", ")
    assert not good


@pytest.mark.parametrize("name", ["separation", "margin"])
def test_judgement_finds_a_requirement_above_the_distance(data: dict[str, Any], name: str) -> None:
    edited = copy.deepcopy(data)
    edited["requirement"][name] += data["bounds"][0] - data["requirement"]["separation"] + 1.0
    assert judgement.wrong([edited]) == ["distance"]


def test_sampled_flight_is_the_legs(data: dict[str, Any]) -> None:
    flight = judgement.flights([data])
    nodes, weights = np.polynomial.legendre.leggauss(30)
    for arc in range(0, 200, 17):
        psi, v, w, a, h = (
            float(field[0, arc])
            for field in (flight.heading, flight.speed, flight.rate, flight.acceleration, flight.length)
        )
        t = 0.5 * h * (1.0 + nodes)
        far = np.sum(0.5 * h * weights * (v + a * t) * np.exp(1j * (psi + w * t)))
        assert flight.at(0, arc, h) - flight.place[0, arc] == pytest.approx(far, abs=1e-9)


def test_command_counts_and_goes_on(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(certificates, "BLOCK", 8)

    def run(plans: int) -> dict[str, Any]:
        assert certificates.main(["--plans", str(plans), "--workers", "1", "--out", str(tmp_path)]) == 0
        return json.loads(capsys.readouterr().out.splitlines()[-1])

    first = run(1)
    assert first["complete"] and not first["failures"]
    kinds = sum(count for name, count in first["counts"].items() if name.startswith("moved"))
    assert kinds == first["counts"]["certificates"] >= 1

    path = tmp_path / "blocks.jsonl"
    written = path.read_bytes()
    path.write_bytes(written + b'{"seed": 0, "block": 1, "cou')
    more = first["counts"]["certificates"] + 1
    second = run(more)
    assert second["counts"]["certificates"] >= more
    assert path.read_bytes().startswith(written)
    assert all(json.loads(line)["block"] == block for block, line in enumerate(path.read_text().splitlines()))
    assert run(more)["counts"] == second["counts"]


def test_what_the_checker_gets_wrong_is_a_failure(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certificates, "BLOCK", 8)
    monkeypatch.setattr(certificates.check, "accept", lambda data: math.inf)
    assert certificates.main(["--plans", "1", "--workers", "1"]) == 1
    failures = json.loads(capsys.readouterr().out.splitlines()[-1])["failures"]
    assert any("is wrong and accepted" in problem for problem in failures)


def test_another_seed_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "blocks.jsonl").write_text(json.dumps({"seed": 3, "block": 0}) + "\n", encoding="utf-8")
    with pytest.raises(certificates.InputError, match="--seed 3"):
        certificates.main(["--seed", "4", "--out", str(tmp_path)])
