"""The simulated world: the ownship on its vehicle, intruders, the truth about how far apart they
come. No ROS.

The ownship flies lines: straight on at first, then plans and backups as they are published. A
kinematic vehicle is led along them by :mod:`envs.follower`, one with an aircraft's lags by
:mod:`envs.c208.guidance`.
"""

import importlib.util
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from envs import intruder
from envs.aircraft import Aircraft
from envs.area_geometry import signed_distance
from envs.areas import Area
from envs.encounters import Encounter
from envs.follower import PERIOD, KinematicVehicle, Vehicle, guidance
from envs.frames import Air, Ground
from envs.kinematics import C208_PUBLISHED, Limits, VehicleState, velocity
from envs.profile import Height, Profile, height_flown, levelling
from envs.relative import leg_separation, straight_cpa
from envs.trees import take
from envs.waypoints import Legs, Waypoint, at, legs, plan_states
from envs.wind import NO_WIND, Wind, over_ground
from ros_bridge.sim.climbing import follow
from ros_bridge.sim.plan_flight import PlanFlight

if TYPE_CHECKING:
    from envs.c208.flightgear import FlightGear
    from envs.c208.guidance import Guide

ALTITUDE = 2_500.0
"""At which all begin, m, and the intruders stay."""

OWN = "own"
"""The ownship's name."""

VEHICLES = ("kinematic", "point_mass", "c208")
"""Ownships: limits without lags, the aircraft's lags and powers, and the aircraft in JSBSim."""

_LONGEST = 1_000.0  # s; no encounter lasts longer


class SimulationError(ValueError):
    """What cannot be simulated; the message says which and what was expected."""


class Truth(NamedTuple):
    """What has happened so far."""

    # smallest distance over the ground to any intruder that is nearer above or below than the
    # vertical separation, m
    separation: float = math.inf
    when: float = math.nan  # of that, s
    error: float = 0.0  # largest distance from where the line was at the time, m, plans only
    clear: float = math.inf  # smallest distance from an area, m; negative: inside of it
    # smallest distance above or below an intruder that is nearer over the ground than the
    # separation, m
    height: float = math.inf


def check_installed(name: str) -> None:
    """Raise :class:`SimulationError` for a kind of ownship that is unknown, or whose needs are not
    installed.
    """
    if name not in VEHICLES:
        raise SimulationError(f"vehicle is {name!r}, expected one of {', '.join(VEHICLES)}")
    if name != "kinematic" and importlib.util.find_spec("jsbsim") is None:
        raise SimulationError(
            f"vehicle {name!r} needs jsbsim, which is not installed (pip install "
            "'rlcas-toolkit[sim]')"
        )


def vehicle(
    name: str, state: VehicleState[Air], limits: Limits, viewer: "FlightGear | None" = None
) -> Vehicle[Any]:
    """Return an ownship of these limits, or raise :class:`SimulationError`; JSBSim is loaded where
    it is needed.

    A viewer, an :class:`envs.c208.flightgear.FlightGear`, shows the one in JSBSim.
    """
    check_installed(name)
    if name == "kinematic":
        return KinematicVehicle(state, limits)
    low, high = C208_PUBLISHED.speed_min, C208_PUBLISHED.speed_max
    if limits.speed_min < low or limits.speed_max > high:
        expectation = f"expected no aircraft of {limits.speed_min:g} to {limits.speed_max:g} m/s"
        raise SimulationError(
            f"vehicle {name!r} is a Cessna 208B of {low:g} to {high:g} m/s, {expectation}"
        )
    from envs.c208.point_mass import PointMassVehicle
    from envs.c208.vehicle import C208Vehicle, FlightError

    if name == "point_mass":
        return PointMassVehicle(over_ground(state, NO_WIND, 0.0), altitude=ALTITUDE)
    try:
        return C208Vehicle(over_ground(state, NO_WIND, 0.0), altitude=ALTITUDE, viewer=viewer)
    except FlightError as error:
        raise SimulationError(f"vehicle {name!r}: {error}") from error


def _goal_over_ground(
    encounter: Encounter, start: VehicleState[Air], wind: Wind
) -> tuple[float, float]:
    """Return the goal of an encounter that a wind carries, over the ground, m."""
    x, y = float(encounter.goal_x[0]), float(encounter.goal_y[0])
    seconds = math.hypot(x - start.x, y - start.y) / max(start.speed, 1.0)
    return x + wind.east * seconds, y + wind.north * seconds


class EncounterFlight:
    """One encounter in flight; :class:`SimulationError` where the vehicle cannot fly it.

    All of it is in an air mass that lies over the ground at the beginning. The goal is over the
    ground, where the ownship would arrive if it flew straight on.

    Args:
        encounter: one, own fields ``[1]``, intruders ``[1, K]``.
        aircraft: the ownship and its task.
        limits: what the ownship's vehicle can do.
        kind: of the ownship's vehicle, one of :data:`VEHICLES`.
        viewer: as :func:`vehicle` has it.
        wind: that carries the air mass.
        areas: over the ground, at all heights.
    """

    def __init__(
        self,
        encounter: Encounter,
        aircraft: Aircraft,
        limits: Limits,
        kind: str = "kinematic",
        viewer: "FlightGear | None" = None,
        wind: Wind = NO_WIND,
        areas: Sequence[Area] = (),
    ) -> None:
        start: VehicleState[Air] = VehicleState(*(float(field[0]) for field in encounter.own))
        self.vehicle: Any = vehicle(kind, start, limits, viewer)
        self._viewer, self._lags = viewer, kind != "kinematic"
        self._goal_radius, self._response = aircraft.goal_radius, aircraft.dt
        self._separation, self._vertical = float(aircraft.separation), aircraft.vertical
        self._heights = [Height(ALTITUDE, 0.0)]  # of the ownship, every period
        self._profile: Profile | None = None
        self.time = 0.0  # s since the beginning
        self.plans: list[PlanFlight] = []  # that were flown
        self.wind, self.areas = wind, areas
        self.goal = _goal_over_ground(encounter, start, wind)  # over the ground, m
        existing = np.flatnonzero(encounter.mask[0])
        self._intruders = intruder.start(
            VehicleState(*(field[0][existing] for field in encounter.intruders)), np
        )
        self._towards = self.goal[0] - start.x, self.goal[1] - start.y
        self._hold(start)
        self.truth = Truth()  # since the beginning, or since a new one was put here
        self.reached: float | None = None  # when the goal was passed, s
        self._intent = take(take(encounter.intent, 0), existing)
        # of the intruders
        self.names = tuple(f"4b{number + 1:04x}" for number in range(len(existing)))

    @property
    def own(self) -> VehicleState[Air]:
        """The ownship's true state."""
        return VehicleState(*(float(field) for field in self.vehicle.state))

    def height_at(self, time: float) -> Height:
        """Return where the ownship was up and down at a time, s, at which a period ended."""
        return self._heights[round(time / PERIOD)]

    @property
    def traffic(self) -> dict[str, VehicleState[Air]]:
        """The intruders' true states by name."""
        rows = np.stack(self._intruders.vehicle, axis=-1).tolist()
        return {name: VehicleState(*row) for name, row in zip(self.names, rows, strict=True)}

    def fly(
        self, curves: Legs[Air], began: float, *, plan: bool, profile: Profile | None = None
    ) -> None:
        """Fly other legs ``[L]`` from now on, whose clock was 0 at ``began`` (s), on a profile of
        that clock, or level; errors from a plan count.
        """
        if self._lags and profile is None:
            profile = self._levelling(began)
        self._curves, self._began, self._on_plan = curves, began, plan
        self._profile = profile
        if plan:
            own, planned = self.own, self._planned_place()
            self.plans.append(
                PlanFlight(
                    began,
                    self.time,
                    math.hypot(own.x - planned.x, own.y - planned.y),
                    math.remainder(own.heading - planned.heading, 2.0 * math.pi),
                    self.time,
                )
            )
            self._courses = self.time, self._intruders.vehicle
        self._guide: Guide | None = None
        if self._lags:
            from envs.c208 import guidance as lagging

            self._guide = lagging.Guide(lagging.Path(curves, began=began))

    def hold(self) -> None:
        """Hold course and speed from now on, as where nothing is commanded."""
        self._hold(self.own)

    def _hold(self, own: VehicleState[Air]) -> None:
        reach = own.speed * _LONGEST
        x = own.x + reach * math.cos(own.heading)
        y = own.y + reach * math.sin(own.heading)
        end = Waypoint(0, x, y, own.heading, own.speed, _LONGEST)
        self.fly(legs(plan_states(over_ground(own, NO_WIND, 0.0), [end])), self.time, plan=False)

    def step(self) -> None:
        """Fly on by one period, or raise :class:`envs.c208.vehicle.FlightError`."""
        own_before, intruders_before = self.own, self._intruders.vehicle
        if self._guide is not None:
            self._hold_height()
            self.vehicle.step(
                *self._guide.commands(over_ground(own_before, NO_WIND, 0.0), self.time), PERIOD
            )
        else:
            self.vehicle.step(
                *guidance(self._curves, own_before, np.float64(self.time - self._began)), PERIOD
            )
        own_after = self.own
        self._intruders = intruder.step(
            self._intruders, self._intent, self.time, PERIOD, np, response=self._response
        )
        self._climb()
        self.time = round(self.time + PERIOD, 6)
        if self._viewer is not None:
            self.vehicle.show(self._intruders.vehicle)
        apart = leg_separation(
            own_before, own_after, intruders_before, self._intruders.vehicle, PERIOD, np
        )
        least = self._nearest_level(float(np.min(apart, initial=math.inf)))
        if least < self.truth.separation:
            self.truth = self.truth._replace(separation=least, when=self.time)
        if self._on_plan:
            self._record(own_after, least)
        self._note_place(over_ground(own_after, self.wind, self.time))

    def _climb(self) -> None:
        """Fly on up or down by one period, or see where the vehicle has flown."""
        height = self._heights[-1]
        if self._lags:
            height = self.vehicle.height
        elif self._vertical is not None:
            time = self.time - self._began
            height = follow(height, self._profile, time, self._vertical, PERIOD)
        self._heights.append(height)

    def _hold_height(self) -> None:
        """Command the height of the profile to a vehicle that holds one."""
        if self._profile is not None and self._vertical is not None:
            from envs.c208.guidance import height_to_hold

            time, acceleration = self.time - self._began, self._vertical.acceleration
            self.vehicle.hold(height_to_hold(self._profile, acceleration, time))

    def _levelling(self, began: float) -> Profile | None:
        """Return the profile of a clock that was 0 at ``began``, s, on which the ownship levels off
        from the one that it flies; None where it flies none.
        """
        if self._profile is None or self._vertical is None:
            return None
        acceleration = self._vertical.acceleration
        height = height_flown(self._profile, acceleration, np.float64(self.time - self._began))
        return levelling(height, acceleration).since(began - self.time)

    def _nearest_level(self, distance: float) -> float:
        """Return the distance from the nearest intruder over the ground, m, if it counts: inf where
        all are above or below.
        """
        above = min(abs(height.altitude - ALTITUDE) for height in self._heights[-2:])
        if distance < self._separation and above < self.truth.height:
            self.truth = self.truth._replace(height=above)
        apart = self._vertical is not None and above >= self._vertical.separation
        return math.inf if apart else distance

    def _note_place(self, place: VehicleState[Ground]) -> None:
        """Note how near a place over the ground is to areas, and whether it is at the goal."""
        for area in self.areas:
            clear = float(signed_distance(area, place.x, place.y, self.time))
            self.truth = self.truth._replace(clear=min(self.truth.clear, clear))
        if self.reached is None:
            east, north = place.x - self.goal[0], place.y - self.goal[1]
            passed = east * self._towards[0] + north * self._towards[1] > 0.0
            if passed or math.hypot(east, north) <= self._goal_radius:
                self.reached = self.time

    def _planned_place(self) -> VehicleState[Air]:
        """Return where the line that is flown is now."""
        place = at(self._curves, np.float64(self.time - self._began))
        return VehicleState(*(float(field) for field in place))

    def _record(self, own: VehicleState[Air], separation: float) -> None:
        """Note how the last period went, against the plan that was flown."""
        place, plan = self._planned_place(), self.plans[-1]
        error = math.hypot(place.x - own.x, place.y - own.y)
        self.truth = self.truth._replace(error=max(self.truth.error, error))
        plan.ended = self.time
        if error > plan.error:
            plan.error, plan.error_at = error, self.time
        if separation < plan.separation:
            plan.separation, plan.separation_at = separation, self.time
        since, courses = self._courses
        seconds, vehicles = self.time - since, self._intruders.vehicle
        east, north = velocity(courses, np)
        strayed = np.hypot(
            vehicles.x - courses.x - seconds * east, vehicles.y - courses.y - seconds * north
        )
        plan.strayed = max(plan.strayed, float(np.max(strayed, initial=0.0)))

    def over(self) -> bool:
        """Return whether the goal has been passed and all fly apart."""
        if self.reached is None:
            return False
        intruders = self._intruders.vehicle
        return bool(np.all(straight_cpa(self.own, intruders, np).time <= 0.0))

    def closest(self) -> float:
        """Return how close an intruder would come if all flew straight on, m."""
        cpa = straight_cpa(self.own, self._intruders.vehicle, np)
        return float(np.min(cpa.distance, initial=math.inf))
