"""Areas as messages of ``rlcas_msgs``; the other direction is :mod:`ros_bridge.core.areas`."""

import math
from collections.abc import Sequence

from rlcas_msgs.msg import Area as AreaMessage
from rlcas_msgs.msg import Areas, Ring

from envs.areas import Area, Circle, Keep
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.areas import REFERENCES
from ros_bridge.core.fields import SECOND
from ros_bridge.transport.messages import header, time_message

_CODES = {name: code for code, name in REFERENCES.items()}


def areas_message(areas: Sequence[Area], time: int, frame: LocalFrame, frame_id: str) -> Areas:
    """Return areas of a local frame as they are at a time, ns."""
    messages = [_area_message(area, time, frame) for area in areas]
    return Areas(header=header(time, frame_id), areas=messages)


def _area_message(area: Area, time: int, frame: LocalFrame) -> AreaMessage:
    message = AreaMessage(
        id=area.name,
        keep=AreaMessage.KEEP_IN if area.keep is Keep.IN else AreaMessage.KEEP_OUT,
        growth=area.growth,
        clearance=area.clearance,
    )
    message.velocity.x, message.velocity.y = area.velocity
    if isinstance(area.shape, Circle):
        centre = frame.geodetic(area.shape.x, area.shape.y)
        message.latitude, message.longitude = float(centre.latitude), float(centre.longitude)
        message.radius = area.shape.radius
    else:
        for ring in area.shape.rings:
            points = frame.geodetic(*zip(*ring, strict=True))
            message.rings.append(
                Ring(latitude=points.latitude.tolist(), longitude=points.longitude.tolist())
            )
    if area.floor is not None:
        message.valid |= AreaMessage.VALID_FLOOR
        message.floor = area.floor.value
        message.floor_reference = _CODES[area.floor.reference]
    if area.ceiling is not None:
        message.valid |= AreaMessage.VALID_CEILING
        message.ceiling = area.ceiling.value
        message.ceiling_reference = _CODES[area.ceiling.reference]
    if math.isfinite(area.valid_from):
        message.valid |= AreaMessage.VALID_FROM
        message.valid_from = time_message(time + round(area.valid_from * SECOND))
    if math.isfinite(area.valid_until):
        message.valid |= AreaMessage.VALID_UNTIL
        message.valid_until = time_message(time + round(area.valid_until * SECOND))
    return message
