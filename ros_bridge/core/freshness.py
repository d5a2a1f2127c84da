"""For how long what was received counts: one value for ROS nodes, MAVLink program and display.

A report counts by the age of its state, an aircraft is remembered by when its last message arrived,
whatever time that message tells: a source whose clock is behind is stale, never silent.
"""

from collections.abc import Mapping
from typing import NamedTuple, Self

from agents.assurance.thresholds import OWN_AGE
from agents.planner.request.options import MAX_AGE
from agents.planner.request.reports import AHEAD
from envs.aircraft import Aircraft
from ros_bridge.core.fields import number

_LONGEST = 1e9  # s


class Freshness(NamedTuple):
    """For how long things count, s; reports as planner and monitor take them with steps of 1 s."""

    own: float = OWN_AGE  # oldest state of the ownship that is used
    intruder: float = MAX_AGE  # oldest state of an intruder that is planned with
    alert: float = 10.0  # for how long an alert of another function holds
    silence: float = 60.0  # without any message of an aircraft, after which it is forgotten
    monitor: float = 1.0  # the monitor's last status; after it there is no monitor
    future: float = AHEAD  # by how much a stamp may lie ahead of the clock
    request: float = 1.0  # oldest request that is answered
    guidance: float = 5.0  # the monitor's last bands and alerts
    node: float = 3.0  # the last sign of life of any other node
    wind: float = 5.0  # the last wind and airspeed of an autopilot
    receiver: float = 10.0  # without anything of an ADS-B receiver, after which it is silent

    @classmethod
    def for_aircraft(cls, aircraft: Aircraft) -> Self:
        """Return what is usual: slower than a step a second, traffic counts for longer."""
        usual, steps = cls(), max(1.0, aircraft.dt)
        intruder = steps * usual.intruder
        return usual._replace(
            intruder=intruder, alert=steps * usual.alert, silence=max(usual.silence, intruder)
        )

    @classmethod
    def of_texts(cls, texts: Mapping[str, str]) -> Self | None:
        """Return what :meth:`texts` wrote; None: nothing of it is there.

        Raises:
            FieldError: a value is no number of seconds.
        """
        values = {
            name: number(key, texts[key], 0.0, _LONGEST, "s")
            for name, key in _KEYS.items()
            if key in texts
        }
        return cls(**values) if values else None

    def texts(self) -> dict[str, str]:
        """Return the values by their names in diagnostics."""
        return {key: f"{getattr(self, name):g}" for name, key in _KEYS.items()}

    def longest(self, other: Self) -> Self:
        """Return what counts where it does for either."""
        return type(self)(*map(max, self, other))


_KEYS = {
    "own": "ownship counts for, s",
    "intruder": "intruders count for, s",
    "alert": "alerts count for, s",
    "silence": "silent aircraft are forgotten after, s",
    "monitor": "the monitor is silent after, s",
}

USUAL_FRESHNESS = Freshness()
"""Where nobody says otherwise."""
