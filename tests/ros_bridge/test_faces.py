"""The rooms' public names: all of them exist, and core and sim need no ROS."""

import importlib
import subprocess
import sys

import pytest

from tests.ros_bridge.graph import MISSING, ROOT

pytest.importorskip("rclpy", reason=MISSING)


@pytest.mark.parametrize("room", ["core", "nodes", "sim", "transport"])
def test_public_names_exist(room: str):
    module = importlib.import_module(f"ros_bridge.{room}")
    assert 5 <= len(module.__all__) <= 11
    assert all(getattr(module, name) is not None for name in module.__all__)
    with pytest.raises(AttributeError):
        module.no_such_name  # noqa: B018


def test_core_and_sim_load_no_ros():
    rooms = ", ".join(f"ros_bridge.{room}" for room in ("core", "sim", "transport", "nodes"))
    program = f"import sys, {rooms}; print('rclpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
