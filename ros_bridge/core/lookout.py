"""A monitor without a plan: it looks at the traffic about the ownship, for bands and alerts.

Pure, as :mod:`ros_bridge.core.assurance`, whose monitor it is; what it has no plan for it does not
judge.
"""

import math
from dataclasses import replace

from agents.assurance.frames import frame_of
from agents.planner.answer import RequestError
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.assurance import Supervision, initial, serves, step_monitor
from ros_bridge.core.motion import ownship_wind
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Situation

_OTHER_WIND = 1.0  # m/s from the wind that it began in, from which on it begins anew


def step_without_plan(looking: Supervision, situation: Situation, moment: int) -> Supervision:
    """Return the monitor after the present moment, ns, with its assessment; it has none while the
    ownship is unknown, or where its wind is so uncertain that nothing is left of its limits.

    It begins anew where the ownship has flown far, or where the wind has changed.
    """
    own = situation.own.last
    if own is not None and not _serves(looking, own):
        looking = _begin(looking, own, moment)
    return step_monitor(looking, situation, moment)


def _serves(looking: Supervision, own: Report) -> bool:
    frame = looking.frame
    if frame is None:
        return False
    wind, before = ownship_wind(frame, own, looking.unknown), looking.air.wind
    changed = math.hypot(wind.east - before.east, wind.north - before.north)
    return serves(frame, own.place) and changed <= _OTHER_WIND and wind.std == before.std


def _begin(looking: Supervision, own: Report, moment: int) -> Supervision:
    frame = LocalFrame(own.latitude, own.longitude)
    wind = ownship_wind(frame, own, looking.unknown)
    begun = initial(looking.thresholds, looking.unknown, looking.categories)
    try:
        begun.thresholds.in_wind(wind)
    except RequestError:
        return begun  # without a frame nothing is judged
    return replace(begun, air=frame_of(wind, 0.0), frame=frame, zero=moment)
