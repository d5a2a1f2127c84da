"""Requests that try to make the planner call a bad plan safe, drawn by number.

Request 1234 of a seed is the same with however many others it is drawn: its family follows from the
number, the options that it is planned with too, and its draws from :mod:`envs.draws`. Frame: local
ENU, metres, radians. They are of the paper's aircraft, and can be scaled to others, drawn at random
too.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.traffic import Requirement, Traffic
from agents.planner.request.request import Options, Request
from agents.policy.inference import Policy
from benchmarks.safety.resimulation import displacement
from envs import draws
from envs.aircraft import PAPER, Aircraft, new_aircraft
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits, VehicleState

__all__ = [
    "FAMILIES",
    "MOST_INTRUDERS",
    "MOST_POINTS",
    "VARIANTS",
    "Drawn",
    "Family",
    "draw_requests",
    "policy_for",
    "random_aircraft",
    "random_options",
    "scale",
    "variants",
]

MOST_INTRUDERS = 8
MOST_POINTS = 20

_OWN, _PER_POINT, _PER_INTRUDER = 20, 4, 20  # draws
_KINDS = ("meeting", "near", "ahead", "trail", "goal", "co-located", "inside")


@dataclass(frozen=True)
class Family:
    """What the requests of a family have in common."""

    name: str
    share: int
    """Of 100 requests."""
    kinds: tuple[str, ...] = ("meeting",)
    """Of intruders, alike in number: ``meeting`` (closest to the ownship's straight flight within
    250 s), ``near`` (1000..1100 m away at the request), ``ahead`` (close to the route when the
    ownship should be there, 60..500 s), ``trail`` (on the route now, the same way or against it),
    ``goal`` (over a point of the route when the ownship should be), ``co-located`` (at the
    beginning of the route), ``inside`` (closer than 1000 m at the request)."""
    intruders: tuple[int, int] = (1, 1)
    """Fewest and most."""
    bend: float = 0.0
    """Largest turn between two legs of the route, degrees."""
    zigzag: bool = False
    """Whether all turns are the largest, and change sides."""
    spacing: tuple[float, float] = (5_000.0, 5_000.0)
    """Between the route's points, log-uniform, m."""
    coincident: float = 0.0
    """Share of spacings that are 1..30 m instead."""
    off: float = 0.0
    """Largest distance of the ownship from the first point, m."""
    astray: float = 0.0
    """Largest angle between the ownship's heading and the route's, degrees."""
    ends: float = 0.0
    """Share of speeds at an end of the envelope."""
    turning: float = 0.0
    """Share of intruders that turn."""
    unsure: float = 0.0
    """Share of intruders of which position or velocity are not known exactly."""


_DENSE = (300.0, 20_000.0)
_MIXED = ("meeting", "near", "ahead", "trail", "goal")

FAMILIES = (
    Family("circle", 14, intruders=(1, 1), astray=8.0),
    Family("circle of many", 6, intruders=(2, 8), astray=8.0),
    Family("near starts", 12, ("near",), (1, 2), astray=30.0),
    Family("envelope ends", 8, ("meeting", "near"), (1, 3), ends=0.9, astray=60.0),
    Family(
        "bends",
        8,
        ("meeting", "ahead", "goal"),
        (0, 3),
        bend=150.0,
        spacing=_DENSE,
        off=1_000.0,
        astray=30.0,
    ),
    Family(
        "zig-zag",
        5,
        ("meeting", "ahead"),
        (0, 2),
        bend=150.0,
        zigzag=True,
        spacing=_DENSE,
        ends=0.3,
    ),
    Family(
        "coincident points",
        5,
        ("meeting", "goal"),
        (0, 2),
        bend=90.0,
        spacing=_DENSE,
        coincident=0.4,
    ),
    Family(
        "off the route", 8, _MIXED, (0, 3), bend=60.0, spacing=_DENSE, off=5_000.0, astray=180.0
    ),
    Family(
        "after the rejoin", 10, ("ahead", "trail"), (1, 3), bend=40.0, spacing=(3_000.0, 10_000.0)
    ),
    Family(
        "at the goal", 6, ("goal",), (1, 2), bend=40.0, spacing=(4_000.0, 12_000.0), astray=20.0
    ),
    Family("turning", 8, ("meeting", "near", "ahead"), (1, 3), turning=1.0, astray=20.0),
    Family("uncertain", 5, _MIXED, (1, 3), bend=30.0, unsure=1.0, turning=0.3),
    Family(
        "co-located",
        2,
        ("co-located", "inside", "near"),
        (1, 2),
        bend=20.0,
        off=5_000.0,
        astray=90.0,
    ),
    Family(
        "everything",
        3,
        _KINDS,
        (0, 8),
        bend=150.0,
        spacing=_DENSE,
        coincident=0.1,
        off=5_000.0,
        astray=180.0,
        ends=0.3,
        turning=0.4,
        unsure=0.3,
    ),
)
"""In the order of the tally; their shares sum to 100."""


def variants(aircraft: Aircraft) -> dict[str, Options]:
    """Return how requests are planned, by name; only the last with the slow last stages of the
    fallback.
    """

    def options(
        margin: float | None = 1e-4, *, exhaustive: bool = False, **changes: Any
    ) -> Options:
        if margin is not None:
            changes["requirement"] = Requirement(aircraft.separation, margin * aircraft.separation)
        return Options.for_aircraft(aircraft, exhaustive=exhaustive, **changes)

    return {
        "default": options(None),
        "no margin": options(0.0),
        "margin 50 m": options(0.05),
        "extended route": options(extend_route=True),
        "one goal": options(goals=1),
        "not direct": options(direct=False),
        "cheapest": options(fallback_cost_threshold=0.0, extend_route=True),
        "rejoin by 60 s": options(rejoin_by=60.0 * aircraft.dt, extend_route=True),
        "rejoin by 340 s": options(0.01, rejoin_by=340.0 * aircraft.dt, goals=2),
        "exhaustive": options(extend_route=True, exhaustive=True),
    }


VARIANTS = variants(PAPER)
"""Of the paper's aircraft."""

_TURNS = np.concatenate([np.tile(np.arange(len(VARIANTS) - 1), 7), [len(VARIANTS) - 1]])
"""Variants of successive hundreds of requests: each alike often, exhaustive planning for 1 in 64.
"""

_CYCLE = np.random.default_rng(1).permutation(
    np.repeat(np.arange(len(FAMILIES)), [family.share for family in FAMILIES])
)


class Drawn(NamedTuple):
    """Requests and where they come from; fields ``[N]``."""

    request: Request
    """Intruders ``[N, MOST_INTRUDERS]``; those that the mask leaves out are there to be ignored.
    Routes ``[N, MOST_POINTS]``."""
    number: Array
    family: Array
    """Place in :data:`FAMILIES`."""
    variant: Array
    """Place in :data:`VARIANTS`."""


def draw_requests(seed: int, first: int, count: int) -> Drawn:
    """Return the requests ``first .. first + count - 1`` of a seed."""
    number = np.arange(first, first + count)
    family = _CYCLE[number % 100]
    u = _Uniforms.draw(seed, first, count)
    origin, course = _origins(u)
    route, points = _routes(family, origin, course, u)
    own = _ownships(family, route[:, 0], course, u)
    traffic = _traffic(family, own, route, points, u)
    state: VehicleState[Air] = VehicleState(
        own.place.real.copy(), own.place.imag.copy(), _wrap(own.heading), own.speed
    )
    request = Request(state, traffic, route.real.copy(), route.imag.copy(), points)
    return Drawn(request, number, family, _TURNS[number // 100 % _TURNS.size])


class _Uniforms(NamedTuple):
    """Draws in [0, 1) of N requests."""

    own: Array
    """``[_OWN, N]``."""
    point: Array
    """Of each point of the route, ``[_EACH_POINT, N, MOST_POINTS]``."""
    intruder: Array
    """Of each intruder, ``[_EACH_INTRUDER, N, MOST_INTRUDERS]``."""

    @classmethod
    def draw(cls, seed: int, first: int, count: int) -> "_Uniforms":
        """Return the draws of requests with consecutive numbers."""
        of_points = _PER_POINT * MOST_POINTS
        total = _OWN + of_points + _PER_INTRUDER * MOST_INTRUDERS
        own, point, intruder = np.split(
            draws.uniforms(seed, first, count, (total,)).T, [_OWN, _OWN + of_points]
        )
        return cls(
            own,
            point.reshape(_PER_POINT, MOST_POINTS, count).swapaxes(1, 2),
            intruder.reshape(_PER_INTRUDER, MOST_INTRUDERS, count).swapaxes(1, 2),
        )


class _Ownships(NamedTuple):
    """Ownships at the request; fields ``[N]``."""

    place: Array
    """Complex, m."""
    heading: Array
    speed: Array


def _of_families(name: str) -> Array:
    """Return one property of all families as an array."""
    return np.array([getattr(family, name) for family in FAMILIES])


def _origins(u: _Uniforms) -> tuple[Array, Array]:
    """Return where routes begin, complex m, and their first courses, rad, ``[N]``; one in ten
    begins far from the frame's origin.
    """
    far = np.where(u.own[0] < 0.1, 8e5, 2e4)
    origin = far * (2.0 * u.own[1] - 1.0) + 1j * far * (2.0 * u.own[2] - 1.0)
    return origin, math.pi * (2.0 * u.own[3] - 1.0)


_EDGE = np.array([49.0, 49.5, 50.0, 50.0, 99.5, 99.6, 99.9, 100.0, 100.5, 101.0])
"""Speeds about the ends of the envelope, m/s."""


def _ownships(family: Array, begin: Array, course: Array, u: _Uniforms) -> _Ownships:
    """Return the ownships near where their routes begin, complex m, with about their courses."""
    at_edge = u.own[7] < _of_families("ends")[family]
    edge = _EDGE[(u.own[8] * _EDGE.size).astype(int)]
    speed = np.where(at_edge, edge, 50.0 + 50.0 * u.own[6])
    # Half of those that may be astray are, by a share of the most that grows slowly.
    share = np.where(u.own[9] < 0.5, u.own[10] ** 2, u.own[10])
    astray = np.radians(_of_families("astray")[family]) * share
    heading = course + np.where(u.own[11] < 0.5, -astray, astray)
    off = _of_families("off")[family] * u.own[12] * np.exp(2j * math.pi * u.own[13])
    return _Ownships(begin + off, heading, speed)


def _routes(family: Array, origin: Array, course: Array, u: _Uniforms) -> tuple[Array, Array]:
    """Return routes ``[N, MOST_POINTS]`` as complex positions, m, and how many points each has."""
    low, high = (_of_families("spacing")[family][:, side] for side in (0, 1))
    plain = low == high
    spacing = low[:, None] * (high / low)[:, None] ** u.point[1]
    coincident = u.point[2] < _of_families("coincident")[family][:, None]
    spacing = np.where(coincident, 1.0 + 29.0 * u.point[3], spacing)
    # The first leg of straight routes is as long as an encounter's.
    spacing[:, 0] = np.where(plain, 6_000.0 + 14_000.0 * u.own[4], spacing[:, 0])
    count = np.where(plain, 11 + u.own[5] * 9.0, 2 + u.own[5] * 19.0).astype(int)
    # Half of the routes that are too short for the horizon get a long last leg.
    number = np.arange(MOST_POINTS)
    last_leg = count[:, None] - 2
    short = 45_000.0 - np.sum(np.where(number < last_leg, spacing, 0.0), axis=1)
    stretch = (number == last_leg) & (u.own[14] < 0.5)[:, None]
    spacing = np.where(stretch, np.maximum(spacing, short[:, None]), spacing)
    turn = np.cumsum(_turns(family, u.point[0]), axis=1)
    steps = spacing * np.exp(1j * (course[:, None] + turn))
    places = origin[:, None] + np.cumsum(steps, axis=1) - steps
    return places, count


def _turns(family: Array, u: Array) -> Array:
    """Return the turns of routes at their points, rad, ``[N, MOST_POINTS]``; the first is none."""
    sides = np.where(np.arange(MOST_POINTS) % 2 == 0, 1.0, -1.0)
    zigzag = _of_families("zigzag")[family][:, None]
    share = np.where(zigzag, sides * (0.5 + 0.5 * u), 2.0 * u - 1.0)
    turn = share * np.radians(_of_families("bend")[family])[:, None]
    turn[:, 0] = 0.0
    return turn


def _traffic(
    family: Array, own: _Ownships, route: Array, points: Array, uniforms: _Uniforms
) -> Traffic:
    """Return the intruders ``[N, MOST_INTRUDERS]``."""
    u = uniforms.intruder
    kind = _kinds(family, u)
    speed = _speeds(kind, own.speed[:, None], u)
    turns = u[4] < _of_families("turning")[family][:, None]
    rate = np.where(turns, np.radians(5.0) * (2.0 * u[5] - 1.0), 0.0)
    lasts = np.where(turns, 400.0 * u[6] ** 2, 0.0)

    there = _meetings(kind, own, route, points, u)
    begin = there.course - rate * np.minimum(there.time, lasts)
    start = there.place - displacement(begin, speed, rate, lasts, there.time)

    unsure = u[14] < _of_families("unsure")[family][:, None]
    worst = np.where(u[16] < 0.1, 400.0, 60.0)
    fewest, most = (_of_families("intruders")[family][:, side] for side in (0, 1))
    count = fewest + np.floor(uniforms.own[15] * (most - fewest + 1))
    return Traffic(
        state=VehicleState(start.real.copy(), start.imag.copy(), _wrap(begin), speed),
        mask=np.argsort(np.argsort(u[3], axis=1), axis=1) < count[:, None],
        turn_rate=rate,
        turn_time=lasts,
        position_std=np.where(unsure & (u[15] < 0.8), worst * u[17], 0.0),
        velocity_std=np.where(unsure & (u[18] < 0.7), 3.0 * u[19], 0.0),
        age=0.0 * speed,
    )


def _kinds(family: Array, u: Array) -> Array:
    """Return the name of the kind of each intruder, one of its family's."""
    lists = [[_KINDS.index(name) for name in family.kinds] for family in FAMILIES]
    lengths = np.array([len(kinds) for kinds in lists])
    table = np.array([kinds + [0] * (len(_KINDS) - len(kinds)) for kinds in lists])
    kind = table[family[:, None], (u[0] * lengths[family][:, None]).astype(int)]
    return np.array(_KINDS)[kind]


def _speeds(kind: Array, own_speed: Array, u: Array) -> Array:
    """Return the speeds: none, the greatest, any or the usual; on the ownship's route also one near
    its own.
    """
    fast = np.where(u[1] < 0.2, 150.0, np.where(u[1] < 0.5, 150.0 * u[2], 50.0 + 50.0 * u[2]))
    any_speed = np.where(u[1] < 0.1, 0.0, fast)
    similar = (kind == "trail") | ((kind == "ahead") & (u[3] < 0.6))
    return np.where(similar, own_speed + 40.0 * (u[2] - 0.5), any_speed)


class _Meeting(NamedTuple):
    """Where each intruder shall be, when, and its course there; fields ``[N, MOST_INTRUDERS]``."""

    place: Array
    """Complex, m."""
    time: Array
    """s after the request."""
    course: Array
    """rad."""


def _meetings(kind: Array, own: _Ownships, route: Array, points: Array, u: Array) -> _Meeting:
    """Return the meeting of each intruder by its kind."""
    own = _Ownships(*(field[:, None] for field in own))
    near = _near(own, u, np.where(kind == "inside", 1_000.0 * u[11], 1_000.0 + 100.0 * u[11] ** 2))
    named = {
        "meeting": _meeting(own, u),
        "ahead": _ahead(own, route, points, u),
        "trail": _trail(own, route, points, u),
        "goal": _at_goal(own, route, points, u),
        "co-located": _Meeting(
            route[:, :1] + np.zeros(u[0].shape), np.zeros(u[0].shape), _any_course(u)
        ),
    }
    holds = [kind == name for name in named]
    fields = zip(*named.values(), strict=True)
    return _Meeting(
        *(np.select(holds, choices, default) for choices, default in zip(fields, near, strict=True))
    )


def _any_course(u: Array) -> Array:
    """Return any courses, rad."""
    return 2.0 * math.pi * u[10]


def _misses(u: Array) -> Array:
    """Return by how much intruders miss, none or up to 3 km, complex m."""
    return np.where(u[7] < 0.3, 0.0, 3_000.0 * u[8] ** 2) * np.exp(2j * math.pi * u[9])


def _meeting(own: _Ownships, u: Array) -> _Meeting:
    """Return meetings straight ahead of the ownships."""
    time = 15.0 + 235.0 * u[11]
    place = own.place + own.speed * time * np.exp(1j * own.heading) + _misses(u)
    return _Meeting(place, time, _any_course(u))


def _ahead(own: _Ownships, route: Array, points: Array, u: Array) -> _Meeting:
    """Return meetings on the route when the ownships are there, with, against or across it."""
    time = 60.0 + 440.0 * u[11]
    place, along = _on_route(route, points, own.place, own.speed * time)
    angle = np.array([0.0, 0.0, math.pi, 0.5 * math.pi])[(u[12] * 4.0).astype(int)]
    return _Meeting(place + _misses(u), time, along + (angle + 0.2 * (u[13] - 0.5)))


def _trail(own: _Ownships, route: Array, points: Array, u: Array) -> _Meeting:
    """Return places on the route now, with it or against it."""
    place, along = _on_route(route, points, own.place, 30_000.0 * u[11])
    back = np.where(u[12] < 0.8, 0.0, math.pi)
    return _Meeting(place + 0.3 * _misses(u), np.zeros(u[0].shape), along + back)


def _at_goal(own: _Ownships, route: Array, points: Array, u: Array) -> _Meeting:
    """Return meetings at one of the next points, about when the ownships could be there."""
    number = 1 + (u[12] * np.minimum(points[:, None] - 1, 2)).astype(int)
    point = np.take_along_axis(route, number, 1)
    time = np.abs(point - own.place) / own.speed + 30.0 * (u[13] - 0.5)
    return _Meeting(point + np.where(u[7] < 0.5, 0.0, _misses(u)), time, _any_course(u))


def _near(own: _Ownships, u: Array, distance: Array) -> _Meeting:
    """Return places around the ownships now, at some distance, m, some flying towards them."""
    bearing = _any_course(u)
    inwards = bearing + math.pi + 1.5 * (u[13] - 0.5)
    course = np.where(u[12] < 0.5, inwards, 2.0 * math.pi * u[13])
    place = own.place + distance * np.exp(1j * bearing)
    return _Meeting(place, np.zeros(u[0].shape), course)


def _on_route(route: Array, points: Array, place: Array, length: Array) -> tuple[Array, Array]:
    """Return the positions and courses at lengths ``[N, K]`` along routes, beyond their ends
    straight on.

    The first leg is that from the ownship to the first point.
    """
    path = np.concatenate([place, route], axis=1)
    number = np.arange(path.shape[1])
    steps = np.diff(path, axis=1)
    begin = np.concatenate([np.zeros((len(path), 1)), np.cumsum(np.abs(steps), axis=1)], axis=1)
    begin = np.where(number <= points[:, None], begin, np.inf)
    leg = np.clip(np.sum(length[..., None] >= begin[:, None], axis=-1) - 1, 0, points[:, None] - 1)
    # The leg to the first point may have no length; the one after it has the route's course.
    leg = np.maximum(leg, np.where(np.abs(steps[:, :1]) < 1.0, 1, 0))
    leg = np.minimum(leg, points[:, None] - 1)
    course = np.angle(np.take_along_axis(steps, leg, 1))
    remaining = length - np.take_along_axis(begin, leg, 1)
    return np.take_along_axis(path, leg, 1) + remaining * np.exp(1j * course), course


def _wrap(angle: Array) -> Array:
    """Return angles in [-pi, pi), rad."""
    return np.mod(angle + math.pi, 2.0 * math.pi) - math.pi


def random_aircraft(rng: np.random.Generator) -> Aircraft:
    """Return an aircraft of 25 to 240 m/s that flies 4 to 60 s for a separation, and turns in 0.3
    to 2.5 of them.
    """
    fastest = float(25.0 * (240.0 / 25.0) ** rng.uniform())
    separation = fastest * float(4.0 * 15.0 ** rng.uniform())
    turn = fastest / (float(rng.uniform(0.3, 2.5)) * separation)
    push = fastest * fastest / separation * rng.uniform(0.02, 0.1, 2)
    slowest = float(rng.uniform(0.3, 0.7)) * fastest
    return new_aircraft(
        Limits(slowest, fastest, -1.5 * float(push[0]), float(push[1]), turn), separation
    )


def random_options(aircraft: Aircraft, rng: np.random.Generator) -> Options:
    """Return options of plans for an aircraft, with some requirement."""
    unit = aircraft.separation / PAPER.separation
    margin = float(rng.choice([0.0, 0.02, 0.1, 10.0, 50.0])) * unit
    sigmas = float(rng.choice([0.0, 1.0, 2.0, 3.0]))
    return Options.for_aircraft(
        aircraft,
        requirement=Requirement(aircraft.separation, margin, sigmas),
        goals=1,
        extend_route=bool(rng.random() < 0.5),
        exhaustive=False,
    )


def policy_for(aircraft: Aircraft) -> Policy:
    """Return the policy that ships, for an aircraft that may be outside its family."""
    return Policy.load().for_aircraft(aircraft, outside="allow")


def scale(request: Request, aircraft: Aircraft) -> Request:
    """Return requests for the paper's aircraft as another's: lengths in separations, speeds in its
    greatest speed.
    """
    length = aircraft.separation / PAPER.separation
    pace = aircraft.limits.speed_max / PAPER.limits.speed_max
    time = length / pace
    own, traffic = _scale_state(request.own, length, pace), request.traffic
    speed = np.clip(own.speed, aircraft.limits.speed_min, aircraft.limits.speed_max)
    return request._replace(
        own=own._replace(speed=speed),
        traffic=traffic._replace(
            state=_scale_state(traffic.state, length, pace),
            turn_rate=traffic.turn_rate / time,
            turn_time=traffic.turn_time * time,
            position_std=traffic.position_std * length,
            velocity_std=traffic.velocity_std * pace,
        ),
        route_x=length * request.route_x,
        route_y=length * request.route_y,
    )


def _scale_state(state: VehicleState[Air], length: float, pace: float) -> VehicleState[Air]:
    return VehicleState(length * state.x, length * state.y, state.heading, pace * state.speed)
