"""The pilots: one that follows a plan, the network in closed loop, and one that flies under the
run-time monitor.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents import assurance
from agents.assurance.asking import ALONG, renew
from agents.assurance.backup import Sense
from agents.assurance.climbs import Climb, Met
from agents.assurance.inputs import Inputs, believed
from agents.assurance.monitor import Decision, Thresholds
from agents.assurance.space import Space, climb_of_backup
from agents.kernel.levels import Altitude, steady
from agents.kernel.traffic import Traffic as Known
from agents.planner.request.encounters import route_of
from agents.planner.request.options import Narrowed
from agents.planner.request.request import Options
from agents.planner.search.candidates import Candidates, empty
from agents.planner.search.in_space import Climber
from agents.policy.inference import Policy
from envs.altitudes import REFERENCE
from envs.areas import Area
from envs.c208.air_mass import ground_commands
from envs.c208.guidance import Guide, Lookahead, Path, height_to_hold
from envs.frames import Air, Ground
from envs.kinematics import Limits, VehicleState, commands
from envs.outcome import Rules
from envs.perception import Sensor, declared_errors
from envs.profile import Height, Profile
from envs.tracking.tracker import Reports, Sightings, observe
from envs.trees import take
from envs.wind import Wind, through_air
from eval.flights.among_areas import in_air_mass
from eval.flights.areas_seen import what_stands
from eval.flights.in_space import of_altitude
from eval.flights.static_obstacles import as_intruders
from eval.hifi.flight import Aloft, Held
from eval.hifi.wind import PlanResult, Route, plan_for


class _Level:
    """Holds the altitude of the start."""

    held: Sequence[Held] = ()

    def height(self, time: float) -> Height | None:
        """Return None: the altitude that is held."""
        return None


class Ascent(NamedTuple):
    """How a plan climbs and descends."""

    profile: Profile
    acceleration: float  # with which its climb changes, m/s^2


class Follower(Guide):
    """Follows the path of a plan that was made at the start, and its altitudes where it has any."""

    def __init__(self, path: Path, gains: Lookahead, ascent: Ascent | None = None) -> None:
        super().__init__(path, gains)
        self._ascent = ascent
        self.held = [] if ascent is None else [Held(0.0, ascent.profile, backup=False)]

    def height(self, time: float) -> Height | None:
        """Return the altitude of the plan and the climb ahead."""
        return None if self._ascent is None else height_to_hold(*self._ascent, time, self._gains)

    def decide(
        self,
        clock: int,
        own: VehicleState[Ground],
        intruders: VehicleState[Ground],
        aloft: Aloft,
    ) -> None:
        """Do nothing: the plan is decided."""


class Closed(_Level):
    """The network, once a second, in the frame of a wind; what it commands is held in the
    air mass.

    The goal is over the ground, m; the mask says which intruders exist, ``[1, K]``, the scales at
    which their distances count. Areas are over the ground, as they are at the start.
    """

    late = 0.0

    def __init__(
        self,
        policy: Policy,
        limits: Limits,
        goal: tuple[float, float],
        mask: np.ndarray,
        frame: Wind,
        areas: tuple[Area, ...] = (),
        distance_scale: np.ndarray | None = None,
    ) -> None:
        self._policy, self._limits, self._distance_scale = policy, limits, distance_scale
        self._stands = what_stands(in_air_mass(areas, frame, 0.0), policy.aircraft)
        self._goal, self._mask, self._frame = goal, mask, frame
        self._held = 0.0, 0.0  # acceleration, m/s^2, and yaw rate, rad/s

    def decide(
        self,
        clock: int,
        own: VehicleState[Ground],
        intruders: VehicleState[Ground],
        aloft: Aloft,
    ) -> None:
        """Decide by the policy."""
        frame, time = self._frame, float(clock)
        through_the_air = through_air(own, frame, time)
        goal = self._goal[0] - frame[0] * time, self._goal[1] - frame[1] * time
        perceived = through_air(intruders, frame, time)
        exist = np.flatnonzero(self._mask[0])
        others: list[VehicleState[Air]] = [
            VehicleState(*(float(field[0, k]) for field in perceived)) for k in exist
        ]
        distance_scale = (
            None if self._distance_scale is None else self._distance_scale[0, exist].tolist()
        )
        if self._stands.x.size:
            distance_scale = [1.0] * len(others) if distance_scale is None else distance_scale
            standing = as_intruders(self._stands, time, self._policy.aircraft.separation)
            for n in np.flatnonzero(standing.mask):
                others.append(VehicleState(*(float(field[n]) for field in standing.state)))
                distance_scale.append(float(standing.distance_scale[n]))
        own_state: VehicleState[Air] = VehicleState(*(float(field) for field in through_the_air))
        action = self._policy.command_one(own_state, others, *goal, distance_scale)
        acceleration, yaw_rate = commands(action, self._limits, np)
        self._held = float(acceleration), float(yaw_rate)

    def commands(self, state: VehicleState[Ground], time: float) -> tuple[float, float]:
        """Return acceleration and turn rate of the track."""
        return ground_commands(through_air(state, self._frame, time), *self._held, self._frame)


class Reckoning(NamedTuple):
    """What the assured loop reckons with."""

    wind: Wind
    level: float  # altitude of the route, m above the sea
    gains: Lookahead  # of the guidance
    sensor: Sensor | None  # of the intruders' reports, which are tracked; None: they are the truth


class _Flown(NamedTuple):
    """What is flown of a monitor; equal where the guidance stays as it is."""

    backup: bool
    began: float  # s after the start
    course: float  # of the backup, rad


class _Now(NamedTuple):
    """What is known at the beginning of a second."""

    time: float  # s after the start
    own: VehicleState[Ground]
    space: Space
    altitude: Altitude | None  # of the ownship; None: flights in the plane


class Assured:
    """A plan ``[1]``, in the air mass, under the run-time monitor, which asks for new plans and
    falls back to a backup.

    It was made at the start with the known intruders ``[1, K]``; the route is over the ground.
    Areas are over the ground, as they are at the start. The thresholds are those in the air mass;
    where they allow climbs, the route is at the altitude of the start.
    """

    def __init__(
        self,
        initial: PlanResult,
        traffic: Known,
        route: Route,
        policy: Policy,
        rules: Rules,
        thresholds: Thresholds[Narrowed],
        reckoning: Reckoning,
        areas: tuple[Area, ...] = (),
    ) -> None:
        self._frame, self._level, self._gains, self._sensor = reckoning
        self._sightings: Sightings[Air] | None = None
        self._route, self._policy, self._rules = route, policy, rules
        self._areas, self._thresholds = areas, thresholds
        monitor = assurance.start(1, traffic.mask.shape[1], thresholds)
        candidates = initial.plans.candidates
        self._monitor = assurance.activate(
            monitor, np.arange(1), candidates.plan_states, candidates.safe, 0.0, traffic, thresholds
        )
        self._mask, self._separation = traffic.mask, traffic.separation
        self._guide: Guide | None = None
        self._flies: _Flown | None = None
        self._in_space = thresholds.options.climbs
        self._climb: Climb | None = None  # of the active plan
        if initial.profile is not None and not self._monitor.on_backup[0]:
            self._climb = Climb(initial.profile, REFERENCE)
        self.held = list[Held]()
        # The goal is the second point of the route.
        self._short, self._reached = candidates.goal > 1, np.zeros(1, dtype=bool)
        self.replans = 0  # new plans asked for
        self.taken_up = 0  # new plans that were flown
        self.backup_seconds = 0  # on the backup
        self.climbing_seconds = 0  # of these on one that climbs or descends

    @property
    def late(self) -> float:
        """How much later than planned the aircraft was at its place, s."""
        return 0.0 if self._guide is None else self._guide.late

    def decide(
        self,
        clock: int,
        own: VehicleState[Ground],
        intruders: VehicleState[Ground],
        aloft: Aloft,
    ) -> None:
        """Let the monitor judge the second, plan anew where it asks for that, and take up what it
        flies.
        """
        now = self._now(float(clock), own, aloft)
        inputs = self._inputs(now, intruders)
        monitor, decision = assurance.step(self._monitor, inputs, self._thresholds)
        goal_x, goal_y = self._route.x[1], self._route.y[1]
        self._reached |= math.hypot(goal_x - own.x, goal_y - own.y) <= self._rules.goal_radius
        began, time_left = monitor.started, self._rules.t_max - clock
        make = partial(self._plan, now, decision)
        meets = partial(self._meets, now) if self._in_space else None
        self._monitor, self._short, renewed, profiles = renew(
            monitor, decision, self._short, self._reached, time_left, make, self._thresholds, meets
        )
        if profiles is not None and profiles[0] is not None:
            self._climb = Climb(profiles[0].since(-now.time), REFERENCE)
        self.replans += int(renewed[0])
        self.taken_up += int(self._monitor.started[0] != began[0])
        self.backup_seconds += int(self._monitor.on_backup[0])
        self._follow()
        if self._in_space:
            self._climb_on(now)

    def commands(self, state: VehicleState[Ground], time: float) -> tuple[float, float]:
        """Return acceleration and turn rate of the track."""
        assert self._guide is not None  # every second begins with a decision
        return self._guide.commands(state, time)

    def height(self, time: float) -> Height | None:
        """Return the altitude of plan or backup, and the climb ahead; None: in the plane."""
        if not self.held:
            return None
        acceleration = self._thresholds.options.vertical.acceleration
        return height_to_hold(self.held[-1].profile, acceleration, time, self._gains)

    def _now(self, time: float, own: VehicleState[Ground], aloft: Aloft) -> _Now:
        """Return what is known at a time, s."""
        own_state = through_air(own, self._frame, time)
        reports = [of_altitude(altitude) for altitude in aloft.intruders or ()]
        monitor = self._monitor
        ends = float(monitor.plan.end[0] + monitor.started[0]) - time
        space = Space(
            VehicleState(*(float(field) for field in own_state)),
            reports,
            in_air_mass(self._areas, self._frame, time),
            ends,
            self._thresholds,
            Climb(self.held[-1].profile.since(time), REFERENCE) if self.held else None,
        )
        return _Now(time, own, space, aloft.own if self._in_space else None)

    def _inputs(self, now: _Now, intruders: VehicleState[Ground]) -> Inputs:
        """Return what the monitor is given of a second: the ownship in the air mass, and the
        intruders as reported, over the ground.
        """
        time, space, altitude = now.time, now.space, now.altitude
        own_row: VehicleState[Air] = VehicleState(*(np.array([field]) for field in space.own))
        perceived = through_air(intruders, self._frame, time)
        reports = Reports(perceived, *declared_errors(self._sensor))
        self._sightings = observe(self._sightings, reports, time, self._mask)
        met = space.find_met(steady(altitude))
        fields: dict[str, Any] = {"separation": self._separation, "areas": met.areas}
        if self._in_space:
            fields["window"] = met.all_times
        inputs = believed(time, own_row, self._sightings, self._mask, **fields)
        return space.complete(inputs, self._climb, altitude) if self._in_space else inputs

    def _plan(
        self, now: _Now, decision: Decision, rows: np.ndarray, options: Options[Any], kind: int
    ) -> Candidates:
        """Plan from the middle of the flight, a :data:`agents.assurance.asking.Planner` but for its
        first two arguments: to the goal from where the ownship is over the ground, or along the
        route; ``rows`` are always the one.
        """
        own_state: VehicleState[Air] = VehicleState(*(float(field[0]) for field in decision.own))
        route, altitude = self._route, now.altitude
        if kind != ALONG:
            place: VehicleState[Ground] = VehicleState(
                *(np.array([float(field)]) for field in now.own)
            )
            x, y, _ = route_of(place, route.x[1:2], route.y[1:2], options.aircraft)
            route = Route(x[0], y[0])
        climber = None
        if altitude is not None:
            climber = Climber(altitude, self._level, now.space.reports)
        plan = plan_for(
            own_state,
            decision.traffic,
            route,
            now.time,
            self._frame._replace(std=0.0),  # the options hold its uncertainty already
            self._policy,
            options,
            self._areas,
            climber=climber,
        )
        if plan.problem is not None:
            return empty(1, options.waypoints, in_space=self._in_space)
        return plan.plans.candidates

    def _meets(self, now: _Now, rows: np.ndarray, candidates: Candidates) -> Met:
        """Return what plans that climb or descend meet from now on, a
        :data:`agents.assurance.asking.Meets` but for its first argument.
        """
        flight, profiles = steady(now.altitude), candidates.profile
        if profiles is not None and profiles.size and profiles[0] is not None:
            climb, options = Climb(profiles[0], REFERENCE), self._thresholds.options
            flight = climb.flight(now.altitude, 0.0, options)
        return take(now.space.find_met(flight), np.arange(rows.size))

    def _follow(self) -> None:
        """Build the guidance anew where something else is to be flown than before."""
        monitor = self._monitor
        backup = bool(monitor.on_backup[0])
        began = float((monitor.backup.started if backup else monitor.started)[0])
        flies = _Flown(backup, began, float(monitor.backup.course[0]) if backup else 0.0)
        if flies != self._flies:
            curves = take(monitor.backup.legs if backup else monitor.plan.legs, 0)
            self._guide = Guide(Path(curves, self._frame, began), self._gains)
            self._flies = flies

    def _climb_on(self, now: _Now) -> None:
        """Take up the altitudes of what is flown now where they are others than before."""
        monitor, climb = self._monitor, self._climb
        backup = bool(monitor.on_backup[0])
        if backup:
            sense, begin = Sense(int(monitor.backup.sense[0])), now.space.begin_backup(now.altitude)
            self.climbing_seconds += sense is not Sense.LEVEL_OFF
            climb = climb_of_backup(sense, begin, now.time, now.space.options_from(begin))
        if climb is not None and (not self.held or climb.profile is not self.held[-1].profile):
            self.held.append(Held(now.time, climb.profile, backup))
