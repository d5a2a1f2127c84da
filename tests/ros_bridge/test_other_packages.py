"""mavros and NovAtel over real DDS: their packages are built from their definitions, and the translator reads them."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros_bridge.definitions import FOLDER
from tests.ros_bridge.graph import MISSING, NODE, ROOT, Client, Process, domain

pytest.importorskip("rclpy", reason=MISSING)

from rlcas_msgs.msg import AircraftState

from ros_bridge.transport import qos

OURS = ROOT / "ros_bridge" / "rlcas_msgs"

SENDER = """
import sys, time
import rclpy
from rclpy.qos import qos_profile_sensor_data as sensor
from mavros_msgs.msg import ADSBVehicle
from novatel_oem7_msgs.msg import INSPVAX
rclpy.init()
node = rclpy.create_node("drivers")
adsb = node.create_publisher(ADSBVehicle, "/rlcas_translator/input/adsb", sensor)
ins = node.create_publisher(INSPVAX, "/rlcas_translator/input/inspva", sensor)
while True:
    now = node.get_clock().now().to_msg()
    for address, heading, flags, kind in ((1, 90.0, 15, 1), (2, 3.0, 15, 0), (3, 90.0, 1, 0), (4, 90.0, 15, 17)):
        message = ADSBVehicle(icao_address=address, latitude=47.0, longitude=8.0, heading=heading, hor_velocity=80.0)
        message.flags, message.emitter_type, message.header.stamp = flags, kind, now
        adsb.publish(message)
    message = INSPVAX(latitude=47.0, longitude=8.0, height=400.0, undulation=48.0, east_velocity=70.0)
    message.ins_status.status, message.header.stamp = 3, now
    ins.publish(message)
    time.sleep(0.2)
"""


def built(package: str, folder: Path, prefix: Path) -> None:
    """Build a package of the definitions as our own is built."""
    source = folder / package
    shutil.copytree(FOLDER / package, source)
    text = (OURS / "CMakeLists.txt").read_text(encoding="utf-8").replace("rlcas_msgs", package)
    text = re.sub(r"set\(dependencies .*\)", "set(dependencies builtin_interfaces std_msgs)", text)
    names = "\n  ".join(f"msg/{file.name}" for file in sorted((source / "msg").glob("*.msg")))
    text = re.sub(r"msg/AircraftState.msg.*\.srv", names, text, flags=re.DOTALL)
    (source / "CMakeLists.txt").write_text(text, encoding="utf-8")
    described = (OURS / "package.xml").read_text(encoding="utf-8").replace("rlcas_msgs", package)
    (source / "package.xml").write_text(described, encoding="utf-8")
    command = [sys.executable, "-m", "ros_bridge.build_interfaces", "--source", str(source), "--prefix", str(prefix)]
    done = subprocess.run(
        [*command, "--build", str(folder / "build" / package)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_translator_reads_the_messages_of_mavros_and_novatel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    prefix = tmp_path / "prefix"
    for package in ("mavros_msgs", "novatel_oem7_msgs"):
        built(package, tmp_path, prefix)
    [packages] = prefix.glob("lib/python*/site-packages")
    for name, value in (("PYTHONPATH", packages), ("LD_LIBRARY_PATH", prefix / "lib")):
        monkeypatch.setenv(name, os.pathsep.join(filter(None, [str(value), os.environ.get(name, "")])))
    sources = ("own_source:=inspvax", "own_id:=own", "traffic_source:=adsb")
    with domain() as number:
        Process("ros_bridge.translator", number, "--ros-args", *(part for one in sources for part in ("-p", one)))
        script = tmp_path / "drivers_of_others.py"
        script.write_text(SENDER, encoding="utf-8")
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]]))
        Process("drivers_of_others", number)
        client = Client(number)
        try:
            own = client.hear(AircraftState, f"{NODE}/input/ownship", qos.SENSOR)
            traffic = client.hear(AircraftState, f"{NODE}/input/traffic", qos.TRAFFIC)
            client.spin(lambda: own and {one.id for one in traffic} >= {"000001", "000002", "000003"}, 30.0)
            client.idle(1.0)
            states = {one.id: one for one in traffic}
        finally:
            client.close()
    assert set(states) == {"000001", "000002", "000003"}
    assert (states["000001"].velocity.x, states["000001"].velocity.y) == pytest.approx((80.0, 0.0), abs=1e-9)
    assert states["000002"].velocity.x == pytest.approx(4.187, abs=1e-3)  # 80 m/s at 3 degrees
    assert states["000003"].valid == AircraftState.VALID_POSITION
    assert (own[0].altitude, own[0].altitude_reference) == (448.0, AircraftState.ALTITUDE_WGS84)
