"""The model keeps the tolerances to what is published, on points it was not fitted to, and says so when it does not."""

import math
from pathlib import Path

import pytest

from agents.config.load import load
from agents.config.world import VehicleConfig
from envs.c208 import validate
from envs.c208.facts import POINTS
from envs.c208.point_mass import PointMassVehicle
from envs.kinematics import VehicleState

ROOT = Path(__file__).resolve().parents[3]


def test_no_tolerance_is_missed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["validate"])
    assert validate.main() == 0
    printed = capsys.readouterr().out
    assert "MISSED" not in printed
    for point in POINTS:
        assert point.name in printed


def test_a_missed_tolerance_is_reported(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = POINTS[0]._replace(value=POINTS[0].value * 1.05)
    monkeypatch.setattr(validate, "POINTS", (wrong,))
    monkeypatch.setattr("sys.argv", ["validate"])
    assert validate.main() == 1
    assert "MISSED" in capsys.readouterr().out


def test_more_drag_is_slower_and_more_weight_stalls_faster() -> None:
    cruise = next(point for point in POINTS if point.quantity == "cruise" and not point.pod)
    stall = next(point for point in POINTS if point.quantity == "stall")
    assert validate.measured(cruise._replace(pod=True)) < validate.measured(cruise) - 5.0
    light = validate.measured(stall._replace(weight=7000.0))
    assert light == pytest.approx(validate.measured(stall) * math.sqrt(7000.0 / stall.weight), rel=0.01)


def test_the_envelope_shrinks_with_speed() -> None:
    rows = validate.envelope()
    assert rows[0][0] < 50.0 and rows[-1][0] >= 100.0
    assert all(low < -0.6 < 0.0 < high for _, low, high in rows)
    gains = [high for _, _, high in rows if _ >= 60.0]
    assert gains == sorted(gains, reverse=True)


def test_the_published_limits_can_be_had_all_at_once() -> None:
    limits = load(VehicleConfig, ROOT / "configs" / "vehicle_c208.yaml").limits()
    for speed in range(int(limits.speed_min), int(limits.speed_max) + 1):
        vehicle = PointMassVehicle(VehicleState(0.0, 0.0, 0.0, float(speed)))
        low, _ = vehicle.reach()
        vehicle.bank = math.atan(speed * limits.yaw_rate_max / 9.80665)
        _, high = vehicle.reach()
        assert low <= limits.acceleration_min and limits.acceleration_max <= high, f"{speed} m/s: {low:.3f}, {high:.3f}"
    stall = next(point for point in POINTS if point.quantity == "stall" and point.variant == "675")
    slowest = validate.measured(stall._replace(variant="ex", weight=8807.0, altitude=2500.0 / 0.3048))
    assert limits.speed_min > 1.1 * slowest * validate.KNOT / math.sqrt(0.957 / 1.225)
