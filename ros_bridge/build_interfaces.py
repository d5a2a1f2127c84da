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

from commands.command import InputError, Parser, run_cli

_SOURCE = Path(__file__).resolve().parent / "rlcas_msgs"


def main(arguments: Sequence[str] | None = None) -> int:
    """Configure, build and install; return the exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    _check_environment()
    if not (options.source / "CMakeLists.txt").is_file():
        raise InputError(
            f"--source {options.source} holds no CMakeLists.txt, expected the folder of a package "
            "of interfaces"
        )
    name = options.source.resolve().name
    folder = options.build or Path("build") / name
    if (folder / "CMakeCache.txt").exists():
        # It remembers another environment, or paths of an earlier version of the wheels.
        shutil.rmtree(folder)
    for step in _steps(options.source, folder, options.prefix):
        completed = subprocess.run(
            step, env=_environment(), capture_output=True, text=True, check=False
        )
        if completed.returncode != 0:
            print(completed.stdout[-6000:], completed.stderr[-6000:], sep="\n", file=sys.stderr)
            failed = f"'{' '.join(step[:2])}' failed; its last lines are above"
            print(f"{parser.prog}: error: {failed}", file=sys.stderr)
            return 1
    print(f"{name} is installed in {options.prefix}")
    return 0


def _parser() -> Parser:
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
    return parser


def _steps(source: Path, build: Path, prefix: Path) -> tuple[list[str], ...]:
    """Return the commands that configure, build and install a package."""
    configure = [
        "cmake",
        "-S",
        str(source),
        "-B",
        str(build),
        "-G",
        "Ninja",
        "-DBUILD_TESTING=OFF",
        "-Wno-dev",
        f"-DCMAKE_INSTALL_PREFIX={prefix.resolve()}",
        f"-DPython3_EXECUTABLE={sys.executable}",
    ]
    compile_all = ["cmake", "--build", str(build), "--parallel", "2"]
    return configure, compile_all, ["cmake", "--install", str(build)]


def _environment() -> dict[str, str]:
    """Return the variables with which CMake finds the packages of this environment, and no
    others.
    """
    paths = [sysconfig.get_path("scripts"), os.environ.get("PATH", "")]
    ours = {
        "AMENT_PREFIX_PATH": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
        "PATH": os.pathsep.join(paths),
    }
    # Where this is an environment inside another one, that other one's packages must not be found.
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | ours


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
