"""BlueSky plugin: with ``RESO RLCAS`` every aircraft in conflict decides for itself by the shipped
policy.

It flies the policy from the moment BlueSky detects a conflict until the closest approach of its
last conflict is past, and its autopilot otherwise; climbs and descents stay with the autopilot
(docs/howto/bluesky.md). With ``RLCASPLAN ON`` it flies the planner's plans instead, where they are
SAFE, with ``RLCASMANEUVERS`` these climb and descend, too, and with ``RLCASAREAS ON`` they keep out
of BlueSky's areas.
"""

import math
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from agents.inference import Policy
from agents.planner import Intruder, RequestError, plan
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.request import Altitude
from commands.command import InputError
from envs.aircraft import GREATEST_VERTICAL, LEAST_VERTICAL, Aircraft, Vertical, new_aircraft
from envs.areas import Area, AreaError, Circle, Level, Polygon
from envs.frames import Air, Ground
from envs.kinematics import Limits, VehicleState, commands
from envs.profile import Profile, corner_error, height_flown, profile_of
from envs.trees import map_leaves, take
from envs.waypoints import Legs, RoutePoint, at, legs, plan_states
from envs.wind import NO_WIND, Wind, aim_point, over_ground, through_air

__all__ = ["RLCAS", "area_of", "init_plugin"]

# Without BlueSky the module can be imported, and no more.
_HERE = find_spec("bluesky") is not None
bs: Any = import_module("bluesky") if _HERE else None
_Resolution: Any = import_module("bluesky.traffic.asas").ConflictResolution if _HERE else object
_command: Any = bs.stack.command if _HERE else lambda **_: lambda function: function
_ROTOR = import_module("bluesky.traffic.performance.openap.coeff").LIFT_ROTOR if _HERE else None
# BlueSky's boxes, circles and polygons, by name.
_SHAPES: Any = import_module("bluesky.tools.areafilter").basic_shapes if _HERE else {}
_EARTH, _GRAVITY = 6_371_000.0, 9.80665  # m, m/s^2, as BlueSky
_MILE, _LIMITLESS = 1_852.0, 9e8  # m; limits of heights beyond this are none

_AHEAD = 20.0  # required separations; where the goal of an aircraft without a waypoint lies
# required separations, beyond which an aircraft that has waited long leaves the way to the other
_APART = 1.5
_CHANGE = 1.5  # m/s^2; with which BlueSky changes a climb: 300 ft/min in a second
_MORE = 0.01  # m/s beyond which no rate is, for rounding's sake
_OFF = 1.0  # m by which BlueSky leaves an altitude beside what the corners of a profile take
_AWAY = 1e4  # m; so far up or down the altitude is set towards which BlueSky is to climb
_ACCELERATION = 0.5  # m/s^2; the least that BlueSky grants every aircraft in flight
_SHARPEST = 0.11  # required separations; a tighter turn takes more than 1 rad in a time step
_REFERENCE = "pressure"  # of heights
_LONGEST = 3_600.0  # s, for which a goal is aimed at in a wind
_PLANNED = 10.0  # s, after which an aircraft plans again: the others decide, too
_SEARCH = {"exhaustive": False, "deadline_s": math.inf}  # no clock decides: a run can be repeated


def init_plugin() -> dict[str, str]:
    """Return the plugin's name and type."""
    return {"plugin_name": "RLCAS", "plugin_type": "sim"}


def _speeds(index: int) -> tuple[float, float]:
    """Return the least and the greatest true airspeed of an aircraft as BlueSky flies it, m/s.

    Of a rotorcraft BlueSky holds the true airspeed itself to the model's limits, of which the
    lower is that of flight backwards; its limits of a fixed wing are calibrated speeds and Mach.
    """
    performance = bs.traf.perf
    lift = getattr(performance, "lifttype", None)  # of OpenAP, BlueSky's usual model, alone
    if lift is not None and lift[index] == _ROTOR:
        return max(float(performance.vmin[index]), 0.0), float(performance.vmax[index])
    slowest, fastest = (float(limit[index]) for limit in performance.currentlimits()[:2])
    return slowest, fastest


def _vertical(index: int, separation: float) -> Vertical:
    """Return what an aircraft does up and down, with a vertical separation, m: the autopilot's
    usual rate, or what its model has, if that is less; what it does now, if that is more.
    """
    performance, usual = bs.traf.perf, abs(float(bs.traf.ap.vsdef[index]))
    lift = getattr(performance, "lifttype", None)  # of OpenAP alone, as the limits below
    up = down = usual
    if lift is not None:
        up = min(usual, abs(float(performance.vsmax[index])))
        # The least climb of a fixed wing's model is none of a descent.
        down = min(usual, abs(float(performance.vsmin[index]))) if lift[index] == _ROTOR else up
    climb = float(bs.traf.vs[index])
    up, down = max(up, climb) + _MORE, max(down, -climb) + _MORE
    separation = min(max(separation, LEAST_VERTICAL.separation), GREATEST_VERTICAL.separation)
    return Vertical(up, down, _CHANGE, separation)


def _wind_at(indices: np.ndarray) -> Wind | None:
    """Return the wind about aircraft ``[N]``, m/s; None: still air about all of them."""
    east, north = (np.asarray(part)[indices] for part in (bs.traf.windeast, bs.traf.windnorth))
    return Wind(east, north, np.zeros(len(indices))) if east.any() or north.any() else None


def _east_north(lat: Any, lon: Any, own_lat: Any, own_lon: Any) -> tuple[Any, Any]:
    """Return places, degrees, as seen from ownships, m."""
    middle = np.radians(0.5 * (np.asarray(lat) + own_lat))
    east = np.radians((np.asarray(lon) - own_lon + 180.0) % 360.0 - 180.0) * np.cos(middle)
    return _EARTH * east, _EARTH * np.radians(np.asarray(lat) - own_lat)


def area_of(shape: Any, own_lat: float, own_lon: float) -> Area:
    """Return one of BlueSky's shapes as an area to be kept out of, as seen from an ownship."""
    numbers = np.array(shape.coordinates, dtype=float)
    lat, lon = numbers[:2] if shape.kind() == "CIRCLE" else (numbers[::2], numbers[1::2])
    if shape.kind() == "BOX":  # by two opposite corners
        lat, lon = lat[[0, 0, 1, 1]], lon[[0, 1, 1, 0]]
    x, y = _east_north(lat, lon, own_lat, own_lon)
    limits: dict[str, Any] = {
        name: Level(float(value), _REFERENCE)
        for name, value in (("floor", shape.bottom), ("ceiling", shape.top))
        if abs(value) < _LIMITLESS
    }
    if shape.kind() == "CIRCLE":
        disc = Circle(float(x), float(y), float(numbers[2]) * _MILE)
        return Area(disc, name=shape.name, **limits)
    return Area(Polygon(tuple(zip(x.tolist(), y.tolist(), strict=True))), name=shape.name, **limits)


class _Plan(NamedTuple):
    """A plan in flight."""

    time: float  # when, s
    legs: Legs[Air] | None  # None: it was not SAFE
    wind: Wind | None  # that it is flown in
    profile: Profile | None = None  # of its altitudes; None: they are the autopilot's


_NO_PLAN = _Plan(-np.inf, None, None)


class _Request(NamedTuple):
    """What an aircraft is planned for."""

    own: VehicleState[Ground]
    intruders: list[Intruder[Ground]]
    goal: complex  # m
    wind: Wind | None


class _Scene(NamedTuple):
    """What aircraft ``[N]`` decide by, over the ground, each in a frame about its own place."""

    own: VehicleState[Ground]  # [N]
    intruders: VehicleState[Ground]  # [N, K]
    mask: np.ndarray  # [N, K]: which of the others count
    any_level: np.ndarray  # [N, K]: the same, whether they come to the ownship's level or not
    goal_x: np.ndarray  # m, [N]
    goal_y: np.ndarray
    wind: Wind | None  # None: still air


def _meets_level(indices: np.ndarray, conf: Any, ownship: Any, intruder: Any) -> np.ndarray:
    """Return which aircraft come to the level of which of ``[N]`` in the look-ahead time,
    ``[N, K]``.
    """
    above = intruder.alt - ownship.alt[indices, None]
    climb = intruder.vs - ownship.vs[indices, None]
    later = above + climb * conf.dtlookahead[indices, None]
    height = np.maximum(conf.hpz, conf.hpz[indices, None])
    return (np.minimum(np.abs(above), np.abs(later)) < height) | (above * later < 0.0)


def _gives_way(
    own: VehicleState[Ground], intruders: VehicleState[Ground], least_distance: float
) -> np.ndarray:
    """Return which of the others are to give way where both have waited long, ``[N, K]``.

    Two that wait for each other, side by side, would fly on so for ever: the other on an
    aircraft's left gives way, if it is farther away than a distance, m.
    """
    heading = own.heading
    on_left = intruders.y * np.cos(heading)[:, None] > intruders.x * np.sin(heading)[:, None]
    return on_left & (np.hypot(intruders.x, intruders.y) > least_distance)


def _policy_command(policy: Policy, scene: _Scene, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return yaw rates (rad/s) and speeds after some seconds (m/s), through the air, ``[N]``."""
    goal, wind = (scene.goal_x, scene.goal_y), scene.wind or NO_WIND
    wind_of_each = wind if scene.wind is None else Wind(wind.east[:, None], wind.north[:, None])
    own, intruders = (
        through_air(scene.own, wind, 0.0),
        through_air(scene.intruders, wind_of_each, 0.0),
    )
    if scene.wind is not None:
        # Decisions are made in the air mass about each aircraft, through which the goal drifts.
        goal = aim_point(own, goal, (-wind.east, -wind.north), _LONGEST, np)
    critical = policy.most_critical(own, intruders, scene.mask)
    critical_intruders, exists = map_leaves(
        lambda field: np.take_along_axis(field, critical, axis=-1), (intruders, scene.mask)
    )
    action = policy.command(own, critical_intruders, exists, *goal)
    acceleration, yaw_rate = commands(action.T, policy.limits, np)
    low, high = policy.limits[:2]
    return yaw_rate, np.clip(own.speed + acceleration * dt, low, high)


class RLCAS(_Resolution):
    """Conflict resolution by the policy: every aircraft in conflict, one call for all of equal
    limits.
    """

    def __init__(self) -> None:
        super().__init__()
        self.policy = Policy.load()
        self._begin()

    def reset(self) -> None:
        """Forget settings, plans and what has been said, as BlueSky does between scenarios."""
        super().reset()
        self._begin()

    def _begin(self) -> None:
        self.outside, self.planning, self.among_areas = "refuse", False, False
        self.maneuvers, self.floor, self.ceiling = Maneuvers.HORIZONTAL, -np.inf, np.inf
        self._policies: dict[tuple[float, ...], Policy | str] = {}
        self._messages: set[str] = set()
        self._lasting: dict[str, float] = {}  # s, for how long an aircraft has been in conflict
        self.plans: dict[str, _Plan] = {}
        self.climbing: set[str] = set()  # aircraft whose altitudes are those of their plans

    @property
    def altactive(self) -> np.ndarray:
        """Altitude and vertical speed are the autopilot's, but where a plan has some."""
        climbing = np.zeros_like(self.active)
        for index in np.flatnonzero(self.active) if self.climbing else ():
            climbing[index] = bs.traf.id[index] in self.climbing
        return climbing

    vsactive = altactive

    @_command(name="RLCASOUTSIDE", annotations="onoff")
    def setoutside(self, allow: bool | None = None) -> tuple[bool, str]:
        """Set whether aircraft that the policy was not trained for fly it, too; without an argument
        say it.
        """
        if allow is not None:
            self.outside = "allow" if allow else "refuse"
            self._policies.clear()
        state = "ON" if self.outside == "allow" else "OFF"
        behaviour = "fly it too" if self.outside == "allow" else "fly on without resolution"
        return True, (
            f"RLCASOUTSIDE is {state}: aircraft that the policy was not trained for {behaviour}"
        )

    @_command(name="RLCASPLAN", annotations="onoff")
    def setplanning(self, plans: bool | None = None) -> tuple[bool, str]:
        """Set whether aircraft fly plans, where they are SAFE, and the policy's decisions
        elsewhere; without an argument say it.
        """
        if plans is not None:
            self.planning = plans
            self.plans.clear()
        followed = "plans, where they are SAFE" if self.planning else "the policy"
        state = "ON" if self.planning else "OFF"
        return True, f"RLCASPLAN is {state}: aircraft in conflict fly {followed}"

    @_command(name="RLCASAREAS", annotations="onoff")
    def setareas(self, keep: bool | None = None) -> tuple[bool, str]:
        """Set whether plans keep out of BlueSky's areas (BOX, CIRCLE, POLY, POLYALT); without an
        argument say it.
        """
        if keep is not None:
            self.among_areas = keep
            self.plans.clear()
        behaviour = "keep out of the areas" if self.among_areas else "take no account of areas"
        needs = (
            "" if self.planning or not self.among_areas else " (RLCASPLAN is OFF: none are made)"
        )
        state = "ON" if self.among_areas else "OFF"
        return True, f"RLCASAREAS is {state}: plans {behaviour}{needs}"

    @_command(name="RLCASMANEUVERS")
    def setmaneuvers(self, maneuvers: str = "") -> tuple[bool, str]:
        """Set what plans may do: HORIZONTAL, VERTICAL (climb and descend along the route) or BOTH;
        without an argument say it.
        """
        kinds = {kind.name: kind for kind in Maneuvers}
        if maneuvers and maneuvers.upper() not in kinds:
            return False, f"{maneuvers} is no kind of plan; expected {', '.join(kinds)}"
        if maneuvers:
            self.maneuvers = kinds[maneuvers.upper()]
            self.plans.clear()
        climbs = self.maneuvers is not Maneuvers.HORIZONTAL
        needs = " (RLCASPLAN is OFF: none are made)" if climbs and not self.planning else ""
        return True, f"RLCASMANEUVERS is {self.maneuvers.name}{needs}"

    @_command(name="RLCASLEVELS", annotations="alt,alt")
    def setlevels(self, floor: float | None = None, ceiling: float | None = None) -> Any:
        """Set between which altitudes plans climb and descend, the floor first; without an argument
        say it.
        """
        if floor is not None and ceiling is not None:
            if not floor < ceiling:
                return False, f"the floor is {floor:.0f} m; expected less than {ceiling:.0f} m"
            self.floor, self.ceiling = floor, ceiling
            self.plans.clear()
        return True, f"RLCASLEVELS are {self.floor:.0f} to {self.ceiling:.0f} m"

    def update(self, conf: Any, ownship: Any, intruder: Any) -> None:
        """Decide which aircraft resolve a conflict, as every method of BlueSky does, and what each
        of them does.
        """
        if _Resolution.selected() is not RLCAS:
            return
        self.resumenav(conf, ownship, intruder)
        self.active &= ~self.resooffac
        names = [ownship.id[index] for index in np.flatnonzero(self.active)]
        self._lasting = {
            name: self._lasting.get(name, 0.0) + float(bs.traf.asastimer.dt_act) for name in names
        }
        self.plans = {
            name: kept_plan for name, kept_plan in self.plans.items() if name in self._lasting
        }
        self.climbing.clear()
        groups: dict[Policy, list[int]] = {}
        for index in np.flatnonzero(self.active).tolist():
            policy = self._policy_of(index, conf)
            if policy is None:
                self.active[index] = False
            else:
                groups.setdefault(policy, []).append(index)
        for policy, members in groups.items():
            self._decide(policy, np.array(members), conf, ownship, intruder)

    def _policy_of(self, index: int, conf: Any) -> Policy | None:
        """Return the policy for an aircraft as BlueSky flies it now, None if it is not for it."""
        traffic, performance = bs.traf, bs.traf.perf
        name, flown_type = traffic.type[index], str(performance.actype[index])
        if flown_type and flown_type.upper() != name.upper():
            self._say(
                name,
                f"BlueSky does not know the aircraft type {name}; it flies with the limits of "
                f"{flown_type}",
            )
        slowest, fastest = _speeds(index)
        phi = traffic.ap.turnphi[index]
        bank = phi if phi > traffic.eps[index] ** 2 else traffic.ap.bankdef[index]
        low, high = np.ceil(slowest), np.floor(fastest)  # through the air, as all that follows
        # As BlueSky's own methods: the larger zone of two aircraft counts.
        zone = conf.rpz[index] if conf.global_rpz else conf.rpz.max()
        separation = np.round(zone * self.resofach)
        key = float(low), float(high), float(bank), float(separation)
        if key not in self._policies:
            try:
                yaw_rate = _GRAVITY * np.tan(bank) / max(high, 1.0)
                yaw_rate = min(yaw_rate, high / (_SHARPEST * separation))
                limits = Limits(max(low, 0.0), high, -_ACCELERATION, _ACCELERATION, yaw_rate)
                self._policies[key] = self.policy.for_aircraft(
                    new_aircraft(limits, separation), outside=self.outside
                )
            except InputError as problem:
                self._policies[key] = str(problem)
        policy = self._policies[key]
        if isinstance(policy, str):
            self._say(
                f"{name} outside",
                f"{traffic.id[index]} ({name}) flies on without conflict resolution: {policy}",
            )
            return None
        return policy

    def _say(self, about: str, sentence: str) -> None:
        """Say something once."""
        if about not in self._messages:
            self._messages.add(about)
            bs.stack.echo(f"RLCAS: {sentence}")

    def _decide(
        self, policy: Policy, indices: np.ndarray, conf: Any, ownship: Any, intruder: Any
    ) -> None:
        """Set track (deg) and speed (m/s) of the aircraft ``[N]`` for the time until the next
        decision.
        """
        dt = float(bs.traf.asastimer.dt_act)
        scene = self._scene(policy.aircraft.separation, indices, conf, ownship, intruder)
        yaw_rate, speed = _policy_command(policy, scene, dt)
        track = (ownship.trk[indices] - np.degrees(yaw_rate * dt)) % 360.0
        if scene.wind is not None:
            # BlueSky takes a track and a speed over the ground.
            own = through_air(scene.own, scene.wind, 0.0)
            turned = own._replace(heading=own.heading + yaw_rate * dt, speed=speed)
            later = over_ground(turned, scene.wind, 0.0)
            speed, track = later.speed, (90.0 - np.degrees(later.heading)) % 360.0
        self.trk[indices], self.tas[indices] = track, speed
        if self.planning:
            self._follow_plans(policy, indices, scene, dt)

    def _scene(
        self, separation: float, indices: np.ndarray, conf: Any, ownship: Any, intruder: Any
    ) -> _Scene:
        """Return what aircraft ``[N]`` decide by."""

        def east_north(lat: Any, lon: Any) -> tuple[np.ndarray, np.ndarray]:
            return _east_north(
                lat, lon, ownship.lat[indices][:, None], ownship.lon[indices][:, None]
            )

        zeros = np.zeros(len(indices))
        own: VehicleState[Ground] = VehicleState(
            zeros, zeros, np.radians(90.0 - ownship.trk[indices]), ownship.gs[indices]
        )
        x, y = east_north(intruder.lat[None], intruder.lon[None])
        course = np.broadcast_to(np.arctan2(intruder.gsnorth, intruder.gseast), x.shape)
        intruders: VehicleState[Ground] = VehicleState(
            x, y, course, np.broadcast_to(intruder.gs, x.shape)
        )

        any_level = ~self.noresoac & (np.arange(ownship.ntraf) != indices[:, None])
        lasting = np.array([self._lasting[ownship.id[index]] for index in indices])
        waits = (lasting > conf.dtlookahead[indices])[:, None] & self.active
        any_level &= ~(waits & _gives_way(own, intruders, _APART * separation))
        mask = any_level & _meets_level(indices, conf, ownship, intruder)

        ahead, bearing = _AHEAD * separation, np.radians(90.0 - bs.traf.ap.trk[indices])
        waypoint = east_north(bs.traf.actwp.lat[indices, None], bs.traf.actwp.lon[indices, None])
        follows = np.asarray(bs.traf.swlnav[indices], bool)
        goal_x = np.where(follows, waypoint[0][:, 0], ahead * np.cos(bearing))
        goal_y = np.where(follows, waypoint[1][:, 0], ahead * np.sin(bearing))
        return _Scene(own, intruders, mask, any_level, goal_x, goal_y, _wind_at(indices))

    def _follow_plans(self, policy: Policy, indices: np.ndarray, scene: _Scene, dt: float) -> None:
        """Set track and speed, and where a plan climbs altitude and vertical speed, of those of the
        aircraft ``[N]`` that have a SAFE plan.
        """
        time, traffic = float(bs.sim.simt), bs.traf
        for row, index in enumerate(indices.tolist()):
            name = traffic.id[index]
            current = self.plans.get(name, _NO_PLAN)
            if time - current.time >= _PLANNED:
                current = self.plans[name] = self._plan(index, policy, self._request(row, scene))
            if current.legs is None:
                continue
            planned = at(current.legs, np.float64(time + dt - current.time), current.wind)
            self.trk[index] = (90.0 - np.degrees(planned.heading)) % 360.0
            self.tas[index] = planned.speed
            if current.profile is not None:
                later = np.float64(time + dt - current.time)
                height = float(height_flown(current.profile, _CHANGE, later).altitude)
                climb = (height - float(traffic.alt[index])) / dt
                # BlueSky climbs with this rate towards an altitude, and holds what it reaches.
                self.vs[index] = abs(climb)
                self.alt[index] = traffic.alt[index] + np.sign(climb) * _AWAY
                self.climbing.add(name)

    def _request(self, row: int, scene: _Scene) -> _Request:
        """Return what one of the aircraft ``[N]`` of a scene is planned for."""
        climbs = self.maneuvers is not Maneuvers.HORIZONTAL
        numbers = np.flatnonzero((scene.any_level if climbs else scene.mask)[row])
        intruders = list[Intruder[Ground]]()
        for number in numbers.tolist():
            state: VehicleState[Ground] = VehicleState(
                *(field[row, number] for field in scene.intruders)
            )
            altitude = _altitude_seen(number) if climbs else None
            intruders.append(Intruder(state, altitude=altitude))
        goal = complex(scene.goal_x[row], scene.goal_y[row])
        wind = None if scene.wind is None else take(scene.wind, row)
        return _Request(take(scene.own, row), intruders, goal, wind)

    def _areas(self, index: int) -> list[Area]:
        """Return the areas that an aircraft keeps out of; what cannot be used is said once."""
        traffic, areas = bs.traf, list[Area]()
        for shape in list(_SHAPES.values()) if self.among_areas else ():
            if shape.kind() not in ("BOX", "CIRCLE", "POLY"):
                continue
            try:
                areas.append(area_of(shape, float(traffic.lat[index]), float(traffic.lon[index])))
            except AreaError as problem:
                self._say(f"{shape.name} area", f"{shape.name} is no area for plans: {problem}")
        return areas

    def _plan(self, index: int, policy: Policy, request: _Request) -> _Plan:
        """Return the plan of an aircraft; where it cannot be made, that is said once."""
        name, time, ahead = (
            bs.traf.id[index],
            float(bs.sim.simt),
            _AHEAD * policy.aircraft.separation,
        )
        own, intruders, goal, wind = request
        goal *= min(1.0, ahead / max(abs(goal), 1.0))
        climbs = self.maneuvers is not Maneuvers.HORIZONTAL
        altitude = _altitude(index)
        target = float(bs.traf.ap.alt[index]) if climbs else None  # that of its own flight
        route = [
            RoutePoint(100 + i, point.real, point.imag, target)
            for i, point in enumerate((goal, 2.0 * goal))
        ]
        areas = self._areas(index)
        altitudes: dict[str, Any] = {"own_altitude": altitude} if areas or climbs else {}
        try:
            options = self._options(index, policy.aircraft)
            answer = plan(
                own, intruders, route, policy, options, wind=wind, areas=areas, **altitudes
            )
        except RequestError as problem:
            self._say(
                f"{name} plan",
                f"{name} flies the policy's decisions until it can be planned for: {problem}",
            )
            return _Plan(time, None, wind)
        if not answer.safe:
            return _Plan(time, None, wind)
        curves = legs(plan_states(own, answer.waypoints, wind=wind))
        rate = altitude.climb(0.0)[0]
        return _Plan(
            time, curves, wind, profile_of(altitude.value, rate, answer.waypoints, _CHANGE)
        )

    def _options(self, index: int, aircraft: Aircraft) -> Options:
        """Return how an aircraft is planned for."""
        if self.maneuvers is Maneuvers.HORIZONTAL:
            return Options.for_aircraft(aircraft, extend_route=True, **_SEARCH)
        zones = bs.traf.cd.hpz
        height = zones[index] if bs.traf.cd.global_hpz else zones.max()
        vertical = _vertical(index, float(height) * self.resofacv)
        # A plan may begin in a climb and have to descend.
        most = vertical.climb_max + vertical.descent_max
        margin = corner_error(most, _CHANGE) + _OFF
        # BlueSky's airspeeds are those over the horizon.
        fastest = aircraft.limits.speed_max
        legs_of = aircraft.limits._replace(speed_max=math.hypot(fastest, most))
        return Options.for_aircraft(
            aircraft._replace(vertical=vertical),
            legs_of,
            extend_route=True,
            maneuvers=self.maneuvers,
            vertical_margin=margin,
            **self._levels(index, margin),
            **_SEARCH,
        )

    def _levels(self, index: int, margin: float) -> dict[str, Level]:
        """Return floor and ceiling of an aircraft's plans, which they keep a margin from, m.

        Of aircraft that resolve, those that are in conflict with each other would all climb, as
        the cheapest: of two the one that BlueSky has had longer does not descend, and the other
        does not climb.
        """
        traffic = bs.traf
        altitude, target = float(traffic.alt[index]), float(traffic.ap.alt[index])
        floor, ceiling, leeway = self.floor, self.ceiling, margin + _OFF
        greatest = getattr(traffic.perf, "hmax", None)
        if greatest is not None:
            ceiling = min(ceiling, max(float(greatest[index]), altitude + leeway, target + leeway))
        for pair in self.resopairs:
            if traffic.id[index] not in pair:
                continue
            opponent = next(traffic.id2idx(name) for name in pair if name != traffic.id[index])
            if opponent >= 0 and self.active[opponent]:
                if index < opponent:
                    floor = max(floor, min(altitude, target) - leeway)
                else:
                    ceiling = min(ceiling, max(altitude, target) + leeway)
        levels = {"floor": floor, "ceiling": ceiling}
        return {
            name: Level(value, _REFERENCE) for name, value in levels.items() if np.isfinite(value)
        }


def _altitude_seen(index: int) -> Altitude:
    """Return the altitude of an aircraft as others know it: it may level off at any time.

    Two that avoid each other, one up and one down, would else count on the other's going on, and
    both come back at once.
    """
    own = _altitude(index)
    half = 0.5 * own.climb(0.0)[0]
    return replace(own, vertical_speed=half, climb_error=abs(half))


def _altitude(index: int) -> Altitude:
    """Return an aircraft's altitude."""
    value, climb = (float(field[index]) for field in (bs.traf.alt, bs.traf.vs))
    return Altitude(value, _REFERENCE, climb)
