"""ROS 2 itself: qualities of service, parameters, messages, processes and recordings.

The names are imported when they are used: most modules need ROS, :mod:`children` does not.
"""

from importlib import import_module
from typing import Any

_MODULES = {
    "ListeningNode": "node_base",
    "Recorder": "recording",
    "RecordingError": "recording",
    "aircraft_message": "messages",
    "free_domain": "children",
    "plan_message": "messages",
    "start_node": "children",
    "stop": "children",
}

__all__ = list(_MODULES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
