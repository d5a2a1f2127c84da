"""What the program knows at a moment, for what stands beside it."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from ros_bridge.mavlink.control import Control
from ros_bridge.mavlink.intake import Received
from ros_bridge.mavlink.judging import Judgement
from ros_bridge.mavlink.mission import Item


class View(NamedTuple):
    """What the program knows at a moment, for a display or a log beside it."""

    time: int  # ns, on the autopilot's clock
    received: Received
    judgement: Judgement
    control: Control
    mission: tuple[Item, ...]
    left_out: Mapping[str, int] = MappingProxyType({})  # reports that are no traffic, by the reason
    doubted: Mapping[str, int] = MappingProxyType({})  # that are, although a field forbids it
