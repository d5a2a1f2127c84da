"""One flight, tenth of a second by tenth of a second: a vehicle, a pilot that commands it, and the
traffic.

All positions are over the ground. The traffic flies in the air mass, as the surrogate's does, and
is carried with it.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from agents.kernel.levels import Altitude
from envs import intruder
from envs.altitudes import REFERENCE
from envs.angles import wrap
from envs.c208.vehicle import FlightError
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.frames import Air, Ground
from envs.kinematics import VehicleState, advance
from envs.outcome import Rules
from envs.profile import Height, Profile
from envs.relative import leg_separation
from envs.trees import take
from envs.wind import Wind, over_ground
from envs.world import begin, move_intruders, perceive_intruders
from eval.flights.plan_flight import SUBSTEPS
from eval.hifi.vehicle import Airborne, Navigation


class Levels(NamedTuple):
    """Intruders up and down, which climb evenly; ``[1, K]``."""

    start: Height
    flatness: np.ndarray
    """What heights count as in the plane: the horizontal separation over the vertical one. The
    cylindrical distance is the greater of the horizontal one and the vertical one times this."""

    def altitudes(self, time: np.ndarray) -> np.ndarray:
        """Return the altitudes at times, s, ``[P]``: m, ``[P, K]``."""
        return self.start.altitude + self.start.climb * time[:, None]

    def reports(self, time: float) -> list[Altitude]:
        """Return the altitudes at a time, s, with their vertical speeds, of all K."""
        altitudes = self.altitudes(np.array([time]))[0].tolist()
        pairs = zip(altitudes, self.start.climb[0].tolist(), strict=True)
        return [Altitude(altitude, REFERENCE, climb) for altitude, climb in pairs]

    def heights(self, own: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Return how near the ownship is above or below in each period at the least, as that counts
        in the plane, m, ``[P, K]``.

        Args:
            own: its altitudes at the beginning and after every period, m, ``[P + 1]``.
            time: of these, s, ``[P + 1]``.
        """
        above = self.altitudes(time) - own[:, None]
        first, last = above[:-1], above[1:]
        near = np.minimum(np.abs(first), np.abs(last))
        return self.flatness * np.where(first * last <= 0.0, 0.0, near)


class Aloft(NamedTuple):
    """What is believed of altitudes, with their vertical speeds."""

    own: Altitude
    intruders: Sequence[Altitude] | None
    """Of all K; None: they are at the ownship's."""


class Held(NamedTuple):
    """Altitudes that are flown from a time on, s after the start."""

    since: float
    profile: Profile  # of times after the start
    backup: bool  # whether it is that of a backup, and not of a plan


class Pilot(Protocol):
    """Commands a flight."""

    @property
    def held(self) -> Sequence[Held]:
        """What was flown up and down so far, in order of time; none: the altitude of the start."""
        ...

    @property
    def late(self) -> float:
        """How much later than planned the aircraft is at its place, s; 0 where nothing is
        planned.
        """
        ...

    def decide(
        self,
        clock: int,
        own: VehicleState[Ground],
        intruders: VehicleState[Ground],
        aloft: Aloft,
    ) -> None:
        """Decide at the beginning of a second by states over the ground as believed, of the
        intruders ``[1, K]``, and by altitudes.
        """

    def commands(self, state: VehicleState[Ground], time: float) -> tuple[float, float]:
        """Return acceleration (m/s^2) and turn rate (rad/s) of the track for the coming period."""
        ...

    def height(self, time: float) -> Height | None:
        """Return the altitude to hold in the coming period, and the climb; None: the one that is
        held.
        """
        ...


class Flight(NamedTuple):
    """What happened; T periods, S whole seconds. Positions over the ground."""

    own: VehicleState[Ground]  # at the start and after every period, [T + 1]
    altitude: np.ndarray  # m above the sea, [T + 1]
    late: np.ndarray  # as the guidance had it, s, [T + 1]
    intruders: VehicleState[Ground]  # at the start and after every second, [S + 1, K]
    # smallest distance to any intruder in each second, m, [S]; to one with a separation of its own
    # in shares of it, times the aircraft's; in space the cylindrical one
    separation: np.ndarray
    distance: np.ndarray  # the same in metres to each of them, [S]
    goal_distance: np.ndarray  # at the start and after every period, m, [T + 1]
    failure: str | None  # why the flight could not go on; None: it could


class Traffic:
    """The intruders of one encounter ``[1]`` in an air mass that the wind carries: true motion, and
    reports.

    The noise of the sensors is by second, ``[4, 1, K]``; None for perfect knowledge. ``watch`` is
    called after every period with the intruders that exist, ``mask [1, K]``, and their altitudes.
    Distances to them count at the scales of :func:`envs.world.distance_scales`, ``[1, K]``; without
    levels all are at the ownship's.
    """

    def __init__(
        self,
        encounter: Encounter,
        wind: Wind,
        noise: Callable[[int], np.ndarray] | None = None,
        watch: Callable[[VehicleState[Ground], np.ndarray | None], None] | None = None,
        distance_scale: np.ndarray | None = None,
        levels: Levels | None = None,
    ) -> None:
        self._state, self.mask = begin(encounter, np, history_dt=1.0), encounter.mask
        self.distance_scale, self.levels = distance_scale, levels
        self._wind, self._noise, self._watch, self._clock = wind, noise, watch, 0

    def ground(self) -> VehicleState[Ground]:
        """Return the intruders, ``[1, K]``."""
        return over_ground(self._state.intruders.vehicle, self._wind, float(self._clock))

    def report_intruders(self) -> VehicleState[Ground]:
        """Return the intruders as reported, ``[1, K]``."""
        noise = None if self._noise is None else self._noise(self._clock)
        return over_ground(
            perceive_intruders(self._state, noise, 1.0, np), self._wind, float(self._clock)
        )

    def report_altitudes(self) -> list[Altitude] | None:
        """Return the altitudes of the intruders as reported, which are the true ones."""
        return None if self.levels is None else self.levels.reports(float(self._clock))

    def second(self) -> VehicleState[Ground]:
        """Move on by a second and return the states at its beginning and after every period, ``[P +
        1, K]``.
        """
        state, clock = self._state, float(self._clock)
        began, following = state.intruders.vehicle, move_intruders(state, 1.0, np)
        # Over a second the intruder's controller holds its yaw rate.
        turn = wrap(following.vehicle.heading - began.heading, np)
        times = PERIOD * np.arange(SUBSTEPS + 1)[:, None]
        moved = advance(began, began.speed * 0.0, turn, times, intruder.COASTING, np)
        whole: VehicleState[Air] = VehicleState(
            *(np.broadcast_to(field, (SUBSTEPS + 1, turn.shape[-1])) for field in moved)
        )
        previous = None if state.previous is None else (began, state.previous[0])
        self._state = state._replace(
            intruders=following, steps=state.steps + 1.0, previous=previous
        )
        self._clock += 1
        return over_ground(whole, self._wind, clock + times)

    def show(self, whole: VehicleState[Ground], period: int) -> None:
        """Let the watch see a period of what :meth:`second` returned last."""
        if self._watch is None:
            return
        altitudes = None
        if self.levels is not None:
            time = np.array([self._clock - 1 + period * PERIOD])
            altitudes = self.levels.altitudes(time)[0, self.mask[0]]
        self._watch(take(whole, (period, self.mask[0])), altitudes)


class _Log:
    """What is known of a flight so far."""

    def __init__(self, vehicle: Airborne, traffic: Traffic) -> None:
        self.states, self.altitudes, self.lates = [vehicle.state], [vehicle.height.altitude], [0.0]
        self.intruders = [traffic.ground()]
        self.separations, self.distances = list[float](), list[float]()

    def add_period(self, vehicle: Airborne, late: float) -> None:
        self.states.append(vehicle.state)
        self.altitudes.append(vehicle.height.altitude)
        self.lates.append(late)

    def add_second(self, whole: VehicleState[Ground], traffic: Traffic) -> None:
        """Add a second with the intruders at its beginning and after every period, ``[P + 1, K]``,
        of the traffic.
        """
        self.intruders.append(take(whole, slice(-1, None)))
        own = _stack(self.states[-SUBSTEPS - 1 :])
        apart = _apart_by_period(own, whole, traffic.mask)
        if traffic.levels is not None:
            altitudes = np.array(self.altitudes[-SUBSTEPS - 1 :], dtype=float)
            began = len(self.states) - SUBSTEPS - 1
            times = PERIOD * np.arange(began, began + SUBSTEPS + 1)
            apart = np.maximum(apart, traffic.levels.heights(altitudes, times))
        self.distances.append(float(apart.min(initial=np.inf)))
        self.separations.append(float(_nearest(apart, traffic.distance_scale).min(initial=np.inf)))

    def flight(self, goal: tuple[float, float], failure: str | None) -> Flight:
        own = _stack(self.states)
        return Flight(
            own=own,
            altitude=np.array(self.altitudes, dtype=float),
            late=np.array(self.lates, dtype=float),
            intruders=VehicleState(
                *(np.concatenate(field) for field in zip(*self.intruders, strict=True))
            ),
            separation=np.array(self.separations, dtype=float),
            distance=np.array(self.distances, dtype=float),
            goal_distance=np.hypot(goal[0] - own.x, goal[1] - own.y),
            failure=failure,
        )


def fly(
    vehicle: Airborne,
    pilot: Pilot,
    navigation: Navigation,
    traffic: Traffic,
    goal: tuple[float, float],
    rules: Rules,
    until: int,
    ends: tuple[str, ...] = (),
) -> Flight:
    """Fly until a time, at least 1 s, the end of the aircraft, or one of ``ends``: ``"violation"``,
    ``"goal"``.

    The navigation says how the own place is known, the traffic is moved on, the goal is over the
    ground, m.
    """
    log = _Log(vehicle, traffic)
    for clock in range(until):
        own = navigation.believe(vehicle.state, float(clock))
        height = vehicle.height
        aloft = Aloft(
            Altitude(height.altitude, REFERENCE, height.climb), traffic.report_altitudes()
        )
        pilot.decide(clock, own, traffic.report_intruders(), aloft)
        whole = traffic.second()
        try:
            for period in range(SUBSTEPS):
                _fly_period(vehicle, pilot, navigation, clock + period * PERIOD)
                log.add_period(vehicle, pilot.late)
                traffic.show(whole, period + 1)
        except FlightError as problem:
            return log.flight(goal, str(problem))
        log.add_second(whole, traffic)
        place = log.states[-1]
        at_goal = math.hypot(goal[0] - place.x, goal[1] - place.y) <= rules.goal_radius
        lost = log.separations[-1] < rules.separation
        if ("violation" in ends and lost) or ("goal" in ends and at_goal):
            break
    return log.flight(goal, None)


def _fly_period(vehicle: Airborne, pilot: Pilot, navigation: Navigation, time: float) -> None:
    """Fly a period from a time, s, on; ``FlightError``: the aircraft is lost in it."""
    height = pilot.height(time)
    if height is not None:
        vehicle.hold(height)
    vehicle.step(*pilot.commands(navigation.believe(vehicle.state, time), time), PERIOD)
    if not math.isfinite(sum(vehicle.state) + vehicle.height.altitude):
        raise FlightError(f"the state is not finite at {time + PERIOD:.2f} s")


def straight_separation(
    flight: Flight,
    intruders: VehicleState[Ground],
    mask: np.ndarray,
    seconds: int,
    distance_scale: np.ndarray | None = None,
    levels: Levels | None = None,
) -> np.ndarray:
    """Return how near the aircraft would have come to intruders that fly straight on, m, ``[S]``.

    The aircraft flies as it did. The intruders are states at its start,
    ``[1, K]``; the result is the smallest distance to any of them in each of the first seconds,
    counted at the scales ``[1, K]``, and on their levels.
    """
    periods = SUBSTEPS * seconds + 1
    own = take(flight.own, slice(periods))
    times = PERIOD * np.arange(own.x.size)[:, None]
    straight: VehicleState[Ground] = VehicleState(
        intruders.x + intruders.speed * np.cos(intruders.heading) * times,
        intruders.y + intruders.speed * np.sin(intruders.heading) * times,
        intruders.heading + 0.0 * times,
        intruders.speed + 0.0 * times,
    )
    every = _apart_by_period(own, straight, mask)
    if levels is not None:
        altitudes = flight.altitude[: own.x.size]
        every = np.maximum(every, levels.heights(altitudes, times[:, 0]))
    apart = _nearest(every, distance_scale)
    whole = apart.size // SUBSTEPS
    return apart[: whole * SUBSTEPS].reshape(whole, SUBSTEPS).min(axis=1)


def _stack(states: list[VehicleState[Ground]]) -> VehicleState[Ground]:
    """Return states of plain floats one after the other, ``[T]``."""
    return VehicleState(*(np.array(field, dtype=float) for field in zip(*states, strict=True)))


def _apart_by_period(
    own: VehicleState[Ground], others: VehicleState[Ground], mask: np.ndarray
) -> np.ndarray:
    """Return the smallest distance of states ``[P + 1]`` to each of ``[P + 1, K]`` in each of the
    periods between them, m, ``[P, K]``; inf where the mask ``[1, K]`` has none.
    """
    own = VehicleState(*(field[:, None] for field in own))
    (before, first), (after, last) = (
        take((own, others), part) for part in (slice(None, -1), slice(1, None))
    )
    apart = leg_separation(before, after, first, last, PERIOD, np)
    return np.where(mask, apart, np.inf)


def _nearest(apart: np.ndarray, distance_scale: np.ndarray | None) -> np.ndarray:
    """Return the smallest of distances ``[P, K]``, counted at scales ``[1, K]``, ``[P]``."""
    counted = apart if distance_scale is None else apart * distance_scale
    return np.min(counted, axis=1, initial=np.inf)
