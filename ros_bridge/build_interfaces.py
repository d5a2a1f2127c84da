"""Build ``rlcas_msgs`` into the Python environment that runs this: ``python -m
ros_bridge.build_interfaces``.

For environments whose ROS 2 comes from wheels (``make ros``). With an ordinary ROS installation use
colcon instead. ``--source`` builds another package of interfaces, such as mavros_msgs, which has no
wheel.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from envs.edge.command import InputError, Parser, run_cli

_SOURCE = Path(__file__).resolve().parent / "rlcas_msgs"


def main(arguments: Sequence[str] | None = None) -> int:
    """Configure, build and install."""
    parser = Parser(prog="python -m ros_bridge.build_interfaces", description=__doc__)
    parser.add_argument(
        "--source", type=Path, default=_SOURCE, help="folder of the package (default rlcas_msgs)"
    )
    parser.add_argument(
        "--prefix", type=Path, default=Path(sys.prefix), help="where to install (default: here)"
    )
    parser.add_argument(
        "--build", type=Path, help="folder to build in (default build/ and the package's name)"
    )
    options = parser.parse_args(arguments)
    _check_environment()
    name = options.source.resolve().name
    folder = options.build or Path("build") / name
    scripts = sysconfig.get_path("scripts")
    environment = os.environ | {
        "AMENT_PREFIX_PATH": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
        "PATH": os.pathsep.join([scripts, os.environ.get("PATH", "")]),
    }
    # Where this is an environment inside another one, that other one's packages must not be found.
    environment.pop("PYTHONPATH", None)
    build = str(folder)
    if (folder / "CMakeCache.txt").exists():
        # It remembers another environment, or paths of an earlier version of the wheels.
        shutil.rmtree(folder)
    steps = (
        [
            "cmake",
            "-S",
            str(options.source),
            "-B",
            build,
            "-G",
            "Ninja",
            "-DBUILD_TESTING=OFF",
            "-Wno-dev",
            f"-DCMAKE_INSTALL_PREFIX={options.prefix.resolve()}",
            f"-DPython3_EXECUTABLE={sys.executable}",
        ],
        ["cmake", "--build", build, "--parallel", "2"],
        ["cmake", "--install", build],
    )
    for step in steps:
        done = subprocess.run(step, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            print(done.stdout[-6000:], done.stderr[-6000:], sep="\n", file=sys.stderr)
            print(
                f"{parser.prog}: error: '{' '.join(step[:2])}' failed; its last lines are above",
                file=sys.stderr,
            )
            return 1
    print(f"{name} is installed in {options.prefix}")
    return 0


def _check_environment() -> None:
    if sys.prefix == sys.base_prefix:
        raise InputError(
            "this Python is in no virtual environment, expected one with ROS 2 from wheels (make "
            "ros)"
        )
    if not (Path(sys.prefix) / "share" / "rosidl_default_generators").is_dir():
        raise InputError(
            f"{sys.prefix} holds no ROS 2 from wheels, expected it to be installed first (make ros)"
        )
    if shutil.which("g++") is None and shutil.which("c++") is None and "CXX" not in os.environ:
        raise InputError(
            "there is no C++ compiler, expected g++ (on Debian and Ubuntu: apt install g++)"
        )


if __name__ == "__main__":
    run_cli(main)
