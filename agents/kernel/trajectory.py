"""What is flown, as pieces of constant controls: a plan, a manoeuvre, a backup, a mission.

It may be in either frame, over the ground or through the air, in which distances are the same
(:mod:`envs.wind`), as long as intruders and areas are in it too.
"""

from typing import NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import arc_end
from envs.arrays import Array
from envs.frames import F
from envs.kinematics import VehicleState
from envs.trees import column, map_leaves, take
from envs.waypoints import ARCS, Legs, PlanStates, displacement, legs

FINE = 32
"""Parts into which an arc of a leg is cut where it matters: 0.06 s of a leg of 20 s, 4 mm of
uncertainty.
"""

HOLDS = 3
"""Legs of what is held after a manoeuvre has reached its target."""

# Gauss-Legendre's rule of four points over [0, 1], [4, 1, 1]: the nodes lead.
_NODES, _FACTORS = (part[:, None, None] for part in np.polynomial.legendre.leggauss(4))
_SHARES, _WEIGHTS = 0.5 * (1.0 + _NODES), 0.5 * _FACTORS


class Trajectory(NamedTuple):
    """What is flown; fields ``[N, L]``, those of arcs ``[N, L, ARCS]``."""

    states: PlanStates  # where legs begin and end, [N, L + 1]
    legs: Legs
    bend: Array  # a bound of the acceleration in each arc, along and across, m/s^2
    error: Array  # by which positions may be off: what a leg misses its end by, and rounding, m

    @property
    def end(self) -> Array:
        """When the last leg ends, s, ``[N]``."""
        return self.states.time[:, -1]

    def since(self, time: Array) -> "Trajectory":
        """Return the same with times from another moment on, s, ``[N]``."""
        shift = np.asarray(time)[:, None]
        return self._replace(
            states=self.states._replace(time=self.states.time - shift),
            legs=self.legs._replace(time=self.legs.time - shift),
        )

    def sagitta(self) -> Array:
        """Return the largest distance of each leg from uniform motion along its chord, m,
        ``[N, L]``; an upper bound.
        """
        share = np.arange(ARCS) / ARCS
        x, y = (
            place - (ends[:, :-1, None] * (1.0 - share) + ends[:, 1:, None] * share)
            for place, ends in ((self.legs.x, self.states.x), (self.legs.y, self.states.y))
        )
        step = self.legs.duration / ARCS
        within_arcs = 0.125 * self.bend.max(axis=-1) * step * step
        return np.sqrt((x * x + y * y).max(axis=-1)) + within_arcs + self.error


class Steering(NamedTuple):
    """Manoeuvres: a turn at constant speed, or a straight change of speed, until a target is
    reached, which is then held; fields ``[...]``.
    """

    yaw_rate: Array  # rad/s
    acceleration: Array  # m/s^2
    reached: Array  # when, s


class Pieces(NamedTuple):
    """Pieces of trajectories as their chords, each row's one after the other; fields ``[M, P]``."""

    row: Array  # number of the trajectory, [M]
    leg: Array  # number of its leg, [M]
    begin: Array  # s
    end: Array  # s
    x0: Array  # where they begin, m
    y0: Array
    x1: Array  # where they end, m
    y1: Array
    heading: Array  # at the beginning, rad
    speed: Array  # there, m/s
    yaw_rate: Array  # rad/s
    acceleration: Array  # m/s^2
    bend: Array  # a bound of the acceleration, m/s^2
    error: Array  # by which positions may be off, m, [M, 1]

    @property
    def sagitta(self) -> Array:
        """By how much a piece may leave its chord, m."""
        length = self.end - self.begin
        return 0.125 * self.bend * length * length


def trajectory(states: PlanStates, curves: Legs | None = None) -> Trajectory:
    """Return what is flown between states ``[N, W]``, finite and in order of time; ``curves`` are
    the legs between them, if they are known already.
    """
    curves = legs(states) if curves is None else curves
    step = curves.duration[..., None] / ARCS
    quickest = np.maximum(curves.speed, curves.speed + curves.acceleration * step)
    bend = np.hypot(curves.acceleration, quickest * curves.yaw_rate)
    return Trajectory(states, curves, bend, curves.miss + position_error_bound(curves))


def straight(x: Array, y: Array, time: Array) -> Trajectory:
    """Return uniform motion from place to place, m, at times, s, in ascending order, ``[N, W]``
    each; at a place the velocity may change at once, as where a mission has its corners.
    """
    dx, dy, duration = np.diff(x), np.diff(y), np.diff(time)
    heading, speed = np.arctan2(dy, dx), np.hypot(dx, dy) / duration
    share = np.arange(ARCS) / ARCS

    def of_arcs(field: Array) -> Array:
        return np.repeat(field[..., None], ARCS, axis=-1)

    still = np.zeros((*duration.shape, ARCS))
    curves = Legs(
        time[:, :-1],
        duration,
        np.zeros(duration.shape),
        x[:, :-1, None] + dx[..., None] * share,
        y[:, :-1, None] + dy[..., None] * share,
        of_arcs(heading),
        of_arcs(speed),
        still,
        still,
    )
    last = (np.concatenate([field, field[:, -1:]], axis=1) for field in (heading, speed))
    return trajectory(PlanStates(x, y, *last, time), curves)


def straight_on(own: VehicleState[F], until: float) -> Trajectory:
    """Return aircraft ``[N]`` that fly straight on until a time, s."""
    time = np.broadcast_to(np.linspace(0.0, until, HOLDS + 2), (own.x.size, HOLDS + 2))
    far = own.speed[:, None] * time
    x, y = (
        start[:, None] + far * part(own.heading)[:, None]
        for start, part in ((own.x, np.cos), (own.y, np.sin))
    )
    return straight(x, y, time)


def steered(own: VehicleState[F], steering: Steering, time: Array) -> VehicleState[F]:
    """Return aircraft on their manoeuvres at times, s, the headings not wrapped; all arguments
    broadcast.
    """
    steers = np.minimum(time, steering.reached)
    turn, speed = steering.yaw_rate * steers, own.speed + steering.acceleration * steers
    x, y = arc_end(own, turn, 0.5 * (own.speed + speed) * steers)
    heading, far = own.heading + turn, speed * (time - steers)
    return VehicleState(x + far * np.cos(heading), y + far * np.sin(heading), heading, speed)


def manoeuvres(own: VehicleState[F], steering: Steering, until: float) -> Trajectory:
    """Return manoeuvres ``[B]`` of one aircraft until a time, s, as ``HOLDS + 1`` legs each, of
    which the first leads to the target.
    """
    share = np.linspace(0.0, 1.0, HOLDS + 1)
    held = steering.reached[:, None] * (1.0 - share) + until * share
    time = np.concatenate([np.zeros((len(held), 1)), held], axis=1)
    duration = np.diff(time, axis=1)
    arcs = time[:, :-1, None] + duration[..., None] * (np.arange(ARCS) / ARCS)
    x, y, heading, speed = steered(
        own, map_leaves(lambda field: field[:, None, None], steering), arcs
    )
    yaw_rate, acceleration = (
        np.concatenate(
            [np.broadcast_to(rate[:, None, None], arcs[:, :1].shape), 0.0 * arcs[:, 1:]], axis=1
        )
        for rate in (steering.yaw_rate, steering.acceleration)
    )
    none = np.zeros(duration.shape)
    curves = Legs(time[:, :-1], duration, none, x, y, heading, speed, yaw_rate, acceleration)
    return trajectory(PlanStates(*steered(own, column(steering), time), time), curves)


def pieces(flown: Trajectory, row: Array, leg: Array) -> Pieces:
    """Return the arcs of legs, by numbers of trajectories and of their legs ``[M]``, with P =
    ``ARCS``.
    """
    curves = take(flown.legs, (row, leg))
    step = curves.duration[:, None] / ARCS
    begin = curves.time[:, None] + np.arange(ARCS) * step
    # The curve ends where the next one begins, but for less than CLOSED.
    x1, y1 = (
        np.concatenate([place[:, 1:], ends[row, leg + 1, None]], axis=1)
        for place, ends in ((curves.x, flown.states.x), (curves.y, flown.states.y))
    )
    return Pieces(
        row=row,
        leg=leg,
        begin=begin,
        end=begin + step,
        x0=curves.x,
        y0=curves.y,
        x1=x1,
        y1=y1,
        heading=curves.heading,
        speed=curves.speed,
        yaw_rate=curves.yaw_rate,
        acceleration=curves.acceleration,
        bend=flown.bend[row, leg],
        error=flown.error[row, leg, None],
    )


def rest_of(arcs: Pieces) -> Pieces:
    """Return arcs of which those that began before time 0 begin where they are then."""
    m, p = np.nonzero((arcs.begin < 0.0) & (arcs.end > 0.0))
    if m.size == 0:
        return arcs
    heading, speed, yaw_rate, acceleration, past = (
        field[m, p]
        for field in (arcs.heading, arcs.speed, arcs.yaw_rate, arcs.acceleration, -arcs.begin)
    )
    east, north = displacement(heading, speed, yaw_rate, acceleration, past)
    now = {
        "begin": np.zeros(m.size),
        "x0": arcs.x0[m, p] + east,
        "y0": arcs.y0[m, p] + north,
        "heading": heading + yaw_rate * past,
        "speed": speed + acceleration * past,
    }
    copies = {name: np.array(getattr(arcs, name)) for name in now}
    for name, values in now.items():
        copies[name][m, p] = values
    return arcs._replace(**copies)


def cut(arcs: Pieces, m: Array, p: Array) -> Pieces:
    """Return the parts, P = ``FINE``, of some arcs, by their numbers ``[Q]``: their row and their
    place in it.
    """
    of_arc = {name: getattr(arcs, name)[m, p, None] for name in Pieces._fields[2:-1]}
    arc = arcs._replace(row=arcs.row[m], leg=arcs.leg[m], error=arcs.error[m], **of_arc)
    part = (arc.end - arc.begin) / FINE
    time = arc.begin + np.arange(FINE + 1) * part
    x, y = along(arc, part)
    return arc._replace(
        begin=time[:, :-1],
        end=time[:, 1:],
        x0=x[:, :-1],
        y0=y[:, :-1],
        x1=x[:, 1:],
        y1=y[:, 1:],
    )


def along(arcs: Pieces, part: Array) -> tuple[Array, Array]:
    """Return positions on arcs ``[M, 1]`` after 0 to :data:`FINE` parts of some seconds, m,
    ``[M, FINE + 1]`` each: Gauss-Legendre's rule.
    """
    time = np.arange(FINE + 1) * part
    # Velocities as complex numbers: the course at a node of the rule turns by the same from part to
    # part, and turning it takes less than half the time of another sine and cosine. The error grows
    # to some 1e-14.
    start = np.cos(arcs.heading) + 1j * np.sin(arcs.heading)
    turn = arcs.yaw_rate * (_SHARES * part)
    turns = np.broadcast_to(np.cos(turn) + 1j * np.sin(turn), (len(_SHARES), len(time), FINE))
    starts = np.broadcast_to(start, (len(_SHARES), len(time), 1))
    courses = np.multiply.accumulate(np.concatenate([starts, turns], axis=2), axis=2)
    speeds = arcs.speed + arcs.acceleration * (_SHARES * time)
    moved = np.add.reduce(speeds * _WEIGHTS * courses, axis=0)
    return arcs.x0 + moved.real * time, arcs.y0 + moved.imag * time


def position_error_bound(curves: Legs) -> Array:
    """Return the error of positions on each leg by Gauss-Legendre's rule, m, ``[..., L]``.

    Proven in proofs/Quadrature.v (``position_error_bound_sound``): below 1 nm on legs of 20 s,
    1 micrometre on those of a minute.
    """
    half = 0.5 * curves.duration[..., None] / ARCS
    turn, gain = np.abs(curves.yaw_rate * half), np.abs(curves.acceleration) * half
    quickest = np.maximum(curves.speed, curves.speed + 2.0 * half * curves.acceleration)
    square = turn * turn
    error = (
        2.0
        / 9.0
        * half
        * (quickest * turn / 40320.0 + gain / 5040.0)
        * (square * square * square * turn)
    )
    return np.sum(error, axis=-1)
