"""The pilots: one that follows a plan, the network in closed loop, and one that flies under the
run-time monitor.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents import assurance
from agents.assurance.areas import may_be_met
from agents.assurance.asking import ALONG, renew
from agents.assurance.inputs import Inputs, believed
from agents.assurance.monitor import Decision, Thresholds
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Traffic as Known
from agents.planner.planner import Plans
from agents.planner.request.encounters import route_of
from agents.planner.request.options import Narrowed
from agents.planner.request.request import Options
from agents.planner.search.candidates import Candidates, empty
from agents.policy.inference import Policy
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
from eval.flights.among_areas import as_row, in_air_mass
from eval.flights.areas_seen import what_stands
from eval.flights.static_obstacles import as_intruders
from eval.hifi.wind import Route, plan_for


class _Level:
    """Holds the altitude of the start."""

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

    def height(self, time: float) -> Height | None:
        """Return the altitude of the plan and the climb ahead."""
        return None if self._ascent is None else height_to_hold(*self._ascent, time, self._gains)

    def decide(
        self, clock: int, own: VehicleState[Ground], intruders: VehicleState[Ground]
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
        self, clock: int, own: VehicleState[Ground], intruders: VehicleState[Ground]
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
    gains: Lookahead  # of the guidance
    sensor: Sensor | None  # of the intruders' reports, which are tracked; None: they are the truth


class _Flown(NamedTuple):
    """What is flown of a monitor; equal where the guidance stays as it is."""

    backup: bool
    began: float  # s after the start
    course: float  # of the backup, rad


class Assured(_Level):
    """A plan ``[1]``, in the air mass, under the run-time monitor, which asks for new plans and
    falls back to a backup.

    It was made at the start with the known intruders ``[1, K]``; the route is over the ground.
    Areas are over the ground, as they are at the start. The thresholds are those in the air mass.
    """

    def __init__(
        self,
        plans: Plans,
        traffic: Known,
        route: Route,
        policy: Policy,
        rules: Rules,
        thresholds: Thresholds[Narrowed],
        reckoning: Reckoning,
        areas: tuple[Area, ...] = (),
    ) -> None:
        self._frame, self._gains, self._sensor = reckoning
        self._sightings: Sightings[Air] | None = None
        self._route, self._policy, self._rules = route, policy, rules
        self._areas, self._thresholds = areas, thresholds
        monitor = assurance.start(1, traffic.mask.shape[1], thresholds)
        candidates = plans.candidates
        self._monitor = assurance.activate(
            monitor, np.arange(1), candidates.plan_states, candidates.safe, 0.0, traffic, thresholds
        )
        self._mask, self._separation = traffic.mask, traffic.separation
        self._guide: Guide | None = None
        self._flies: _Flown | None = None
        # The goal is the second point of the route.
        self._short, self._reached = candidates.goal > 1, np.zeros(1, dtype=bool)
        self.replans = 0  # new plans asked for
        self.taken_up = 0  # new plans that were flown
        self.backup_seconds = 0  # on the backup

    @property
    def late(self) -> float:
        """How much later than planned the aircraft was at its place, s."""
        return 0.0 if self._guide is None else self._guide.late

    def decide(
        self, clock: int, own: VehicleState[Ground], intruders: VehicleState[Ground]
    ) -> None:
        """Let the monitor judge the second, plan anew where it asks for that, and take up what it
        flies.
        """
        own_state = through_air(own, self._frame, float(clock))
        monitor, decision = assurance.step(
            self._monitor, self._inputs(clock, own_state, intruders), self._thresholds
        )
        goal_x, goal_y = self._route.x[1], self._route.y[1]
        self._reached |= math.hypot(goal_x - own.x, goal_y - own.y) <= self._rules.goal_radius
        began, time_left = monitor.started, self._rules.t_max - clock
        make = partial(self._plan, clock, own, decision)
        self._monitor, self._short, renewed, _ = renew(
            monitor, decision, self._short, self._reached, time_left, make, self._thresholds
        )
        self.replans += int(renewed[0])
        self.taken_up += int(self._monitor.started[0] != began[0])
        self.backup_seconds += int(self._monitor.on_backup[0])
        self._follow()

    def commands(self, state: VehicleState[Ground], time: float) -> tuple[float, float]:
        """Return acceleration and turn rate of the track."""
        assert self._guide is not None  # every second begins with a decision
        return self._guide.commands(state, time)

    def _inputs(
        self, clock: int, own: VehicleState[Air], intruders: VehicleState[Ground]
    ) -> Inputs:
        """Return what the monitor sees of a second: the ownship in the air mass, and the intruders
        as reported, over the ground.
        """
        own_row: VehicleState[Air] = VehicleState(*(np.array([float(field)]) for field in own))
        time, fields = float(clock), dict[str, Any](separation=self._separation)
        perceived = through_air(intruders, self._frame, time)
        reports = Reports(perceived, *declared_errors(self._sensor))
        self._sightings = observe(self._sightings, reports, time, self._mask)
        if self._areas:
            fields["areas"] = as_row(self._areas_met(time, own))
        turn_time = self._thresholds.turn_time
        return believed(time, own_row, self._sightings, self._mask, turn_time, **fields)

    def _areas_met(self, time: float, own: VehicleState[Air]) -> tuple[ActiveArea, ...]:
        """Return the areas that an ownship in the air mass may meet, s after the start."""
        areas, monitor = in_air_mass(self._areas, self._frame, time), self._monitor
        ends = float(monitor.plan.end[0] + monitor.started[0]) - time
        own_state: VehicleState[Air] = VehicleState(*(float(field) for field in own))
        return may_be_met(areas, own_state, (), ends, self._thresholds)

    def _plan(
        self,
        clock: int,
        own: VehicleState[Ground],
        decision: Decision,
        rows: np.ndarray,
        options: Options[Any],
        kind: int,
    ) -> Candidates:
        """Plan from the middle of the flight, a :data:`agents.assurance.asking.Planner` but for its
        first three arguments: to the goal from where the ownship is over the ground, or along the
        route; ``rows`` are always the one.
        """
        own_state: VehicleState[Air] = VehicleState(*(float(field[0]) for field in decision.own))
        route = self._route
        if kind != ALONG:
            place: VehicleState[Ground] = VehicleState(*(np.array([float(field)]) for field in own))
            x, y, _ = route_of(place, route.x[1:2], route.y[1:2], options.aircraft)
            route = Route(x[0], y[0])
        plan = plan_for(
            own_state,
            decision.traffic,
            route,
            float(clock),
            self._frame._replace(std=0.0),  # the options hold its uncertainty already
            self._policy,
            options,
            self._areas,
        )
        return plan.plans.candidates if plan.problem is None else empty(1, options.waypoints)

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
