"""Missions and fences that somebody changes in flight."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from commands.command import InputError
from envs.formats.areas.geodetic import GeodeticArea
from ros_bridge.core.fields import FieldError
from ros_bridge.mavlink import mission, refresh
from ros_bridge.mavlink.effects import Log
from ros_bridge.mavlink.link import FENCE
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.state import Advance, State
from ros_bridge.mavlink.texts import tell

_SAME_HEIGHT = 1.0  # m by which home moves unsaid


def areas_of(corners: Sequence[Item], clearance: float) -> tuple[GeodeticArea, ...]:
    """Return the areas of a fence, or raise :class:`InputError`; the clearance from them in m."""
    try:
        return mission.fence(corners, clearance)
    except FieldError as error:
        raise InputError(f"the autopilot's fence: {error}") from None


def take_item(state: State, message: Any, time: int, margin: float) -> Advance:
    """Take in an item, or their count; what cannot be read leaves what is there."""
    refreshed = refresh.take(state.refresh, message)
    after = Advance(replace(state, refresh=refreshed.refresh), refreshed.effects)
    if refreshed.problem is not None:
        return after.then(tell, "download", str(refreshed.problem), time, send=True)
    if refreshed.downloaded is None:
        return after
    if refreshed.downloaded.kind == FENCE:
        return after.then(_change_fence, refreshed.downloaded.items, time, margin)
    return after.then(_change_mission, refreshed.downloaded.items, time)


def _change_mission(state: State, items: tuple[Item, ...], time: int) -> Advance:
    """Take over another mission; while a plan is flown, only note that there is one. Where home,
    its first item, alone has moved, altitudes are above the new one from then on.
    """
    if items == state.items:
        return Advance(state)
    if items[1:] == state.items[1:]:
        before, height = (mission.home_altitude(of) for of in (state.items, items))
        line = "unknown" if height is None else f"{height:.0f} m above mean sea level"
        noted = before is not None and height is not None and abs(height - before) < _SAME_HEIGHT
        lines = () if noted else (Log(f"home has moved: its altitude is {line}", time),)
        return Advance(replace(state, items=items), lines)
    if not state.control.flies:
        line = Log(f"the mission has changed: {len(items)} items", time)
        return Advance(replace(state, items=items, leg=None), (line,))
    if state.pilot.replaced:
        return Advance(state)
    noted = replace(state, pilot=replace(state.pilot, replaced=True))
    text = "mission changed by others: AUTO flies it"
    return tell(noted, "mission", text, time, send=True)


def _change_fence(state: State, corners: tuple[Item, ...], time: int, margin: float) -> Advance:
    if corners == state.corners:
        return Advance(state)
    try:
        fence = areas_of(corners, margin)
    except InputError as problem:
        return tell(state, "download", str(problem), time, send=True)
    situation = replace(state.received.situation, fixed_areas=fence)
    received = replace(state.received, situation=situation)
    changed = replace(state, corners=corners, received=received)
    text = f"fence has changed: {len(fence)} areas"
    return tell(changed, "fence", text, time, send=True)
