"""The nodes: runner, monitor, simulator, translator and pilot; each is imported when it is used,
with ROS.
"""

from importlib import import_module
from typing import Any

__all__ = ["Monitor", "Pilot", "Runner", "Simulator", "Translator"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{name.lower()}"), name)
