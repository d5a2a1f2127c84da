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

from agents.planner.request import Options, Request
from agents.planner.traffic import Requirement, Traffic
from agents.policy.inference import Policy
from benchmarks.safety.resimulation import displacement
from envs import draws
from envs.aircraft import PAPER, Aircraft, new_aircraft
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

_OWN, _EACH_POINT, _EACH_INTRUDER = 20, 4, 20  # draws
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
        150.0,
        spacing=_DENSE,
        off=1_000.0,
        astray=30.0,
    ),
    Family("zig-zag", 5, ("meeting", "ahead"), (0, 2), 150.0, True, _DENSE, ends=0.3),
    Family(
        "coincident points", 5, ("meeting", "goal"), (0, 2), 90.0, spacing=_DENSE, coincident=0.4
    ),
    Family("off the route", 8, _MIXED, (0, 3), 60.0, spacing=_DENSE, off=5_000.0, astray=180.0),
    Family("after the rejoin", 10, ("ahead", "trail"), (1, 3), 40.0, spacing=(3_000.0, 10_000.0)),
    Family("at the goal", 6, ("goal",), (1, 2), 40.0, spacing=(4_000.0, 12_000.0), astray=20.0),
    Family("turning", 8, ("meeting", "near", "ahead"), (1, 3), turning=1.0, astray=20.0),
    Family("uncertain", 5, _MIXED, (1, 3), 30.0, unsure=1.0, turning=0.3),
    Family(
        "co-located", 2, ("co-located", "inside", "near"), (1, 2), 20.0, off=5_000.0, astray=90.0
    ),
    Family(
        "everything", 3, _KINDS, (0, 8), 150.0, False, _DENSE, 0.1, 5_000.0, 180.0, 0.3, 0.4, 0.3
    ),
)
"""In the order of the tally; their shares sum to 100."""

_NAMES = (
    "default",
    "no margin",
    "margin 50 m",
    "extended route",
    "one goal",
    "not direct",
    "cheapest",
    "rejoin by 60 s",
    "rejoin by 340 s",
    "exhaustive",
)


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

    every = (
        options(None),
        options(0.0),
        options(0.05),
        options(extend_route=True),
        options(goals=1),
        options(direct=False),
        options(fallback_cost_threshold=0.0, extend_route=True),
        options(rejoin_by=60.0 * aircraft.dt, extend_route=True),
        options(0.01, rejoin_by=340.0 * aircraft.dt, goals=2),
        options(extend_route=True, exhaustive=True),
    )
    return dict(zip(_NAMES, every, strict=True))


VARIANTS = variants(PAPER)
"""Of the paper's aircraft."""

_TURNS = np.concatenate([np.tile(np.arange(len(VARIANTS) - 1), 7), [len(VARIANTS) - 1]])
"""Variants of successive hundreds of requests: each alike often, exhaustive planning for 1 in 64.
"""

_CYCLE = np.random.default_rng(1).permutation(
    np.repeat(np.arange(len(FAMILIES)), [one.share for one in FAMILIES])
)


class Drawn(NamedTuple):
    """Requests and where they come from; fields ``[N]``."""

    request: Request
    """Intruders ``[N, MOST_INTRUDERS]``; those that the mask leaves out are there to be ignored.
    Routes ``[N, MOST_POINTS]``."""
    number: Any
    family: Any
    """Place in :data:`FAMILIES`."""
    variant: Any
    """Place in :data:`VARIANTS`."""


def draw_requests(seed: int, first: int, count: int) -> Drawn:
    """Return the requests ``first .. first + count - 1`` of a seed."""
    number = np.arange(first, first + count)
    which = _CYCLE[number % 100]
    variant = _TURNS[number // 100 % _TURNS.size]
    total = _OWN + _EACH_POINT * MOST_POINTS + _EACH_INTRUDER * MOST_INTRUDERS
    uniform = draws.uniforms(seed, first, count, (total,)).T
    own_draws, rest = uniform[:_OWN], uniform[_OWN:]
    split = _EACH_POINT * MOST_POINTS
    point_draws = rest[:split].reshape(_EACH_POINT, MOST_POINTS, count).swapaxes(1, 2)
    each = rest[split:].reshape(_EACH_INTRUDER, MOST_INTRUDERS, count).swapaxes(1, 2)

    scene = own_draws[0] < 0.1
    far = np.where(scene, 8e5, 2e4)
    origin = far * (2.0 * own_draws[1] - 1.0) + 1j * far * (2.0 * own_draws[2] - 1.0)
    course = math.pi * (2.0 * own_draws[3] - 1.0)
    route, points = _routes(which, origin, course, own_draws, point_draws)
    speed = 50.0 + 50.0 * own_draws[6]
    edge = np.array([49.0, 49.5, 50.0, 50.0, 99.5, 99.6, 99.9, 100.0, 100.5, 101.0])
    speed = np.where(
        own_draws[7] < _each("ends")[which], edge[(own_draws[8] * edge.size).astype(int)], speed
    )
    # Half of those that may be astray are, by a share of the most that grows slowly.
    astray = np.radians(_each("astray")[which]) * np.where(
        own_draws[9] < 0.5, own_draws[10] ** 2, own_draws[10]
    )
    heading = course + np.where(own_draws[11] < 0.5, -astray, astray)
    off = _each("off")[which] * own_draws[12] * np.exp(2j * math.pi * own_draws[13])
    place = route[:, 0] + off
    traffic = _traffic(which, (place, heading, speed), route, points, each, own_draws)
    own = VehicleState(place.real.copy(), place.imag.copy(), _wrap(heading), speed)
    request = Request(own, traffic, route.real.copy(), route.imag.copy(), points)
    return Drawn(request, number, which, variant)


def _each(name: str) -> Any:
    """Return one property of all families as an array."""
    return np.array([getattr(family, name) for family in FAMILIES])


def _routes(which: Any, origin: Any, course: Any, own: Any, points: Any) -> tuple[Any, Any]:
    """Return routes ``[N, MOST_POINTS]`` as complex positions, m, and how many points each has."""
    bend = np.radians(_each("bend")[which])[:, None]
    sides = np.where(np.arange(MOST_POINTS) % 2 == 0, 1.0, -1.0)
    turn = (
        np.where(
            _each("zigzag")[which][:, None], sides * (0.5 + 0.5 * points[0]), 2.0 * points[0] - 1.0
        )
        * bend
    )
    turn[:, 0] = 0.0
    low, high = (_each("spacing")[which][:, side, None] for side in (0, 1))
    spacing = low * (high / low) ** points[1]
    spacing = np.where(
        points[2] < _each("coincident")[which][:, None], 1.0 + 29.0 * points[3], spacing
    )
    # The first leg of straight routes is as long as an encounter's.
    plain = (low == high)[:, 0]
    spacing[:, 0] = np.where(plain, 6_000.0 + 14_000.0 * own[4], spacing[:, 0])
    count = np.where(plain, 11 + (own[5] * 9.0), 2 + own[5] * 19.0).astype(int)
    # Half of the routes that are too short for the horizon get a long last leg.
    number = np.arange(MOST_POINTS)
    short = 45_000.0 - np.sum(np.where(number < count[:, None] - 2, spacing, 0.0), axis=1)
    final = number == count[:, None] - 2
    stretch = final & (own[14] < 0.5)[:, None]
    spacing = np.where(stretch, np.maximum(spacing, short[:, None]), spacing)
    steps = spacing * np.exp(1j * (course[:, None] + np.cumsum(turn, axis=1)))
    places = origin[:, None] + np.cumsum(steps, axis=1) - steps
    return places, count


def _traffic(
    which: Any, own: tuple[Any, Any, Any], route: Any, points: Any, u: Any, extra: Any
) -> Traffic:
    """Return the intruders ``[N, MOST_INTRUDERS]``, draws ``u`` ``[_EACH_INTRUDER, N,
    MOST_INTRUDERS]``.
    """
    _, _, own_speed = own
    kind = _kinds(which, u)
    speed = _speeds(kind, own_speed[:, None], u)
    turns = u[4] < _each("turning")[which][:, None]
    rate = np.where(turns, np.radians(5.0) * (2.0 * u[5] - 1.0), 0.0)
    lasts = np.where(turns, 400.0 * u[6] ** 2, 0.0)

    there = _meetings(kind, own, route, points, u)
    begin = there.course - rate * np.minimum(there.time, lasts)
    start = there.place - displacement(begin, speed, rate, lasts, there.time)

    noisy = u[14] < _each("unsure")[which][:, None]
    position = np.where(noisy & (u[15] < 0.8), np.where(u[16] < 0.1, 400.0, 60.0) * u[17], 0.0)
    velocity = np.where(noisy & (u[18] < 0.7), 3.0 * u[19], 0.0)
    fewest, most = (_each("intruders")[which][:, side] for side in (0, 1))
    wanted = fewest + np.floor(extra[15] * (most - fewest + 1))
    mask = np.argsort(np.argsort(u[3], axis=1), axis=1) < wanted[:, None]
    state = VehicleState(start.real.copy(), start.imag.copy(), _wrap(begin), speed)
    return Traffic(state, mask, rate, lasts, position, velocity, 0.0 * speed)


def _kinds(which: Any, u: Any) -> Any:
    """Return the name of the kind of each intruder, one of its family's."""
    lists = [[_KINDS.index(name) for name in family.kinds] for family in FAMILIES]
    lengths = np.array([len(kinds) for kinds in lists])
    table = np.array([kinds + [0] * (len(_KINDS) - len(kinds)) for kinds in lists])
    kind = table[which[:, None], (u[0] * lengths[which][:, None]).astype(int)]
    return np.array(_KINDS)[kind]


def _speeds(kind: Any, own_speed: Any, u: Any) -> Any:
    """Return the speeds: none, the greatest, any or the usual; on the ownship's route also one near
    its own.
    """
    fast = np.where(u[1] < 0.2, 150.0, np.where(u[1] < 0.5, 150.0 * u[2], 50.0 + 50.0 * u[2]))
    any_speed = np.where(u[1] < 0.1, 0.0, fast)
    similar = (kind == "trail") | ((kind == "ahead") & (u[3] < 0.6))
    return np.where(similar, own_speed + 40.0 * (u[2] - 0.5), any_speed)


class _Meeting(NamedTuple):
    """Where each intruder shall be, when, and its course there."""

    place: Any  # complex, m
    time: Any  # s
    course: Any  # rad


def _meetings(kind: Any, own: tuple[Any, Any, Any], route: Any, points: Any, u: Any) -> _Meeting:
    place, heading, speed = (field[:, None] for field in own)
    zero = np.zeros(u[0].shape)
    any_course = 2.0 * math.pi * u[10]
    miss = np.where(u[7] < 0.3, 0.0, 3_000.0 * u[8] ** 2) * np.exp(2j * math.pi * u[9])

    # Straight ahead of the ownship.
    meet_time = 15.0 + 235.0 * u[11]
    meeting = _Meeting(
        place + speed * meet_time * np.exp(1j * heading) + miss, meet_time, any_course
    )

    # On the route when the ownship is there, with, against or across it.
    ahead_time = 60.0 + 440.0 * u[11]
    on_route, along = _on_route(route, points, place, speed * ahead_time)
    angle = np.array([0.0, 0.0, math.pi, 0.5 * math.pi])[(u[12] * 4.0).astype(int)]
    ahead = _Meeting(on_route + miss, ahead_time, along + (angle + 0.2 * (u[13] - 0.5)))

    # Somewhere on the route now.
    now_route, now_along = _on_route(route, points, place, 30_000.0 * u[11])
    back = np.where(u[12] < 0.8, 0.0, math.pi)
    trail = _Meeting(now_route + 0.3 * miss, zero, now_along + back)

    # At one of the next points, about when the ownship could be.
    number = 1 + (u[12] * np.minimum(points[:, None] - 1, 2)).astype(int)
    point = np.take_along_axis(route, number, 1)
    point_time = np.abs(point - place) / speed + 30.0 * (u[13] - 0.5)
    goal = _Meeting(point + np.where(u[7] < 0.5, 0.0, miss), point_time, any_course)

    located = _Meeting(route[:, :1] + zero, zero, any_course)

    # Around the ownship now, some of them towards it.
    near = np.where(kind == "inside", 1_000.0 * u[11], 1_000.0 + 100.0 * u[11] ** 2)
    inwards = any_course + math.pi + 1.5 * (u[13] - 0.5)
    towards = np.where(u[12] < 0.5, inwards, 2.0 * math.pi * u[13])
    around = _Meeting(place + near * np.exp(1j * any_course), zero, towards)

    named = {
        "meeting": meeting,
        "ahead": ahead,
        "trail": trail,
        "goal": goal,
        "co-located": located,
    }
    holds = [kind == name for name in named]
    fields = zip(*named.values(), strict=True)
    return _Meeting(
        *(np.select(holds, choices, other) for choices, other in zip(fields, around, strict=True))
    )


def _on_route(route: Any, points: Any, place: Any, length: Any) -> tuple[Any, Any]:
    """Return the positions and courses at lengths ``[N, K]`` along routes, beyond their ends
    straight on.

    The ownship's way to the first point is the first leg.
    """
    path = np.concatenate([place, route], axis=1)
    number = np.arange(path.shape[1])
    steps = np.diff(path, axis=1)
    begin = np.concatenate([np.zeros((len(path), 1)), np.cumsum(np.abs(steps), axis=1)], axis=1)
    begin = np.where(number <= points[:, None], begin, np.inf)
    leg = np.clip(np.sum(length[..., None] >= begin[:, None], axis=-1) - 1, 0, points[:, None] - 1)
    # The way to the first point may have no length; the leg after it has the route's course.
    leg = np.maximum(leg, np.where(np.abs(steps[:, :1]) < 1.0, 1, 0))
    leg = np.minimum(leg, points[:, None] - 1)
    course = np.angle(np.take_along_axis(steps, leg, 1))
    left = length - np.take_along_axis(begin, leg, 1)
    return np.take_along_axis(path, leg, 1) + left * np.exp(1j * course), course


def _wrap(angle: Any) -> Any:
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
    return Options.for_aircraft(
        aircraft,
        requirement=Requirement(
            aircraft.separation, margin, float(rng.choice([0.0, 1.0, 2.0, 3.0]))
        ),
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
    length, pace = (
        aircraft.separation / PAPER.separation,
        aircraft.limits.speed_max / PAPER.limits.speed_max,
    )
    own, traffic = request.own, request.traffic

    def state(one: VehicleState) -> VehicleState:
        return VehicleState(length * one.x, length * one.y, one.heading, pace * one.speed)

    moving: Any = state(own)
    moving = moving._replace(
        speed=np.clip(moving.speed, aircraft.limits.speed_min, aircraft.limits.speed_max)
    )
    time = length / pace
    seen = traffic._replace(
        state=state(traffic.state),
        turn_rate=traffic.turn_rate / time,
        turn_time=traffic.turn_time * time,
        position_std=traffic.position_std * length,
        velocity_std=traffic.velocity_std * pace,
    )
    return request._replace(
        own=moving, traffic=seen, route_x=length * request.route_x, route_y=length * request.route_y
    )
