"""The air mass that a monitor works in, and how what it remembers goes into another.

Reports and waypoints are over the ground. A monitor in a wind sees all of them as the air mass
does, so that limits are those in the air and a turn is one through it. A plan brings the wind that
its legs are flown in, and with that the air mass; how exactly that wind is known counts as in the
planner.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.assurance.inputs import Memory, no_areas
from agents.assurance.state import Monitor
from agents.kernel.traffic import Traffic
from agents.planner.request.reports import Intruder, velocity_std_in, with_state
from envs.areas import Area, in_air
from envs.arrays import Array, Float
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.trees import map_leaves
from envs.wind import NO_WIND, Wind, over_ground, through_air, turned_error


class Frame(NamedTuple):
    """An air mass."""

    wind: Wind = NO_WIND
    since: float = 0.0  # when it lies over the ground, on the monitor's clock, s

    @property
    def moves(self) -> bool:
        """Whether it does not stand still over the ground."""
        return bool(self.wind.speed > 0.0)

    def to_air(self, state: VehicleState[Ground], time: Float[Array, "..."]) -> VehicleState[Air]:
        """Return a state at a time, s, as the air mass sees it; one that is missing, NaN, stays."""
        missing = isinstance(state.x, float) and math.isnan(state.x)
        wind = self.wind if self.moves and not missing else NO_WIND
        return through_air(state, wind, time - self.since)

    def to_ground(
        self, state: VehicleState[Air], time: Float[Array, "..."]
    ) -> VehicleState[Ground]:
        """Return a state at a time, s, as the ground sees it."""
        return over_ground(state, self.wind if self.moves else NO_WIND, time - self.since)

    def report(self, report: Intruder[Ground], time: float) -> Intruder[Air]:
        """Return a report, as it is known at a time, s, as the air mass sees it."""
        state = self.to_air(report.state, time - report.age)
        return with_state(report, state, velocity_std_in(report, state, self.wind))

    def area(self, area: Area, time: float) -> Area:
        """Return an area as it is over the ground at a time, s, as the air mass sees it."""
        return in_air(area, self.wind, time - self.since) if self.moves else area

    def area_on_ground(self, area: Area, time: float) -> Area:
        """Return an area as the air mass sees it at a time, s, as it is over the ground."""
        if not self.moves:
            return area
        return in_air(area, Wind(-self.wind.east, -self.wind.north), time - self.since)


STILL = Frame()
"""Still air."""


def frame_of(wind: Wind, time: float) -> Frame:
    """Return the air mass of a wind that lies over the ground at a time, s; a calm one always
    does.
    """
    return Frame(wind, time if wind.speed > 0.0 else 0.0)


def carry(monitor: Monitor, old: Frame, new: Frame) -> Monitor:
    """Return a monitor with its memory, and the intruders that it expects, in another air mass.

    Its active plan and its backup are of the old one: they are to be replaced.
    """
    if old == new:
        return monitor

    def state(old_state: VehicleState[Air], time: Array) -> VehicleState[Air]:
        finite = np.isfinite(time)
        time = np.where(finite, time, 0.0)
        carried = new.to_air(old.to_ground(old_state, time), time)
        return map_leaves(lambda a, b: np.where(finite, a, b), carried, old_state)

    def traffic(old_traffic: Traffic, time: Array) -> Traffic:
        turn = old_traffic.turn_rate * (old_traffic.turn_time + old_traffic.age)  # since the report
        grown = old_traffic.velocity_std + turned_error(turn, new.wind.std - old.wind.std)
        return old_traffic._replace(
            state=state(old_traffic.state, time[:, None]), velocity_std=np.maximum(grown, 0.0)
        )

    memory = monitor.memory
    return monitor._replace(
        memory=memory._replace(
            own=state(memory.own, memory.own_time),
            intruders=state(memory.intruders, memory.reported),
            areas=_areas(memory, old, new),
        ),
        expected=traffic(monitor.expected, monitor.started),
        request_traffic=traffic(monitor.request_traffic, monitor.requested_at),
    )


def _areas(memory: Memory, old: Frame, new: Frame) -> Array:
    """Return the areas of the last step in another air mass."""
    carried = no_areas(memory.time.size)
    for n, (time, areas) in enumerate(zip(memory.time.tolist(), memory.areas, strict=True)):
        carried[n] = tuple(
            active._replace(area=new.area(old.area_on_ground(active.area, time), time))
            for active in areas
        )
    return carried
