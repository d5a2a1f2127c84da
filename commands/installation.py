"""What is installed: versions, the extra of a missing module, and whether another package hides the
toolkit's.
"""

import importlib.util
import platform
from importlib import metadata
from pathlib import Path

PACKAGES = ("rlcas_jax", "commands", "envs", "agents", "eval", "ros_bridge")

EXTRAS = {
    "report": (
        "matplotlib",
        "pyarrow",
        "pydantic",
        "pyproj",
        "rich",
        "scipy",
        "threadpoolctl",
        "yaml",
    ),
    "train": ("flax", "jax", "optax"),
    "gymnax": ("gymnax",),
    "sim": ("gymnasium", "jsbsim"),
    "tensorboard": ("tensorboardX",),
    "cluster": ("dask", "distributed"),
    "sweep": ("optuna",),
    "onnx": ("jax2onnx", "onnx", "onnxruntime"),
    "peers": ("sbx", "stable_baselines3", "torch"),
    "bluesky": ("bluesky", "bluesky_gym"),
    "display": ("mcap", "mcap_ros2", "websockets"),
    "mavlink": ("pymavlink", "serial"),
    "dev": ("playwright",),
    "ros": (
        "builtin_interfaces",
        "diagnostic_msgs",
        "geometry_msgs",
        "nav_msgs",
        "rcl_interfaces",
        "rclpy",
        "rlcas_msgs",
        "rosgraph_msgs",
        "rosidl_adapter",
        "sensor_msgs",
        "std_msgs",
        "unique_identifier_msgs",
        "visualization_msgs",
    ),
}
"""Modules that the optional dependencies of pyproject.toml install."""

_OF_COMMANDS = {"rlcas_jax.": "train", "ros_bridge.mavlink.": "report", "ros_bridge.": "ros"}
"""The extra that commands of a package need, by how their names begin, the longest first; it holds
or goes with the extra ``report``.
"""


def extra_of(module: str | None, command: str) -> str | None:
    """Return the extra that installs a module, None where none does; by the command where several
    extras do.
    """
    top = (module or "").partition(".")[0]
    extra = next((extra for extra, modules in EXTRAS.items() if top in modules), None)
    if extra != "report":
        return extra
    return next(
        (extra for begin, extra in _OF_COMMANDS.items() if command.startswith(begin)), extra
    )


def foreign() -> str:
    """Return why the toolkit's packages cannot be used: another one of the same, common name hides
    one; or "".
    """
    home = Path(__file__).resolve().parents[1]
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        at = None if spec is None or spec.origin is None else Path(spec.origin).resolve().parent
        if at is not None and at != home / name:
            return (
                f"the package {name} is {at}; expected {home / name}: something else hides the "
                "toolkit's"
            )
    return ""


def versions(*packages: str) -> dict[str, str]:
    """Return the version of Python and of each package; ``not installed`` where there is none."""
    installed = {"python": platform.python_version()}
    for package in ("rlcas-toolkit", *packages):
        try:
            installed[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            installed[package] = "not installed"
    return installed
