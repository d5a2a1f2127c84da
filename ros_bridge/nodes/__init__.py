"""The nodes: runner, monitor, simulator, translator and pilot; each is imported when it is used, with ROS."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ros_bridge.nodes.monitor import Monitor
    from ros_bridge.nodes.pilot import Pilot
    from ros_bridge.nodes.runner import Runner
    from ros_bridge.nodes.simulator import Simulator
    from ros_bridge.nodes.translator import Translator

__all__ = ["Monitor", "Pilot", "Runner", "Simulator", "Translator"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{name.lower()}"), name)
