"""What is flown, as pieces of constant controls: a plan, a manoeuvre, a backup, a mission.

It may be in either frame, over the ground or through the air, in which distances are the same
(:mod:`envs.wind`), as long as intruders and areas are in it too.
"""

from typing import Any, Generic, NamedTuple

import numpy as np

from agents.kernel.arcs import FILL_BOUNDS, greatest_acceleration, quadrature_error
from agents.manoeuvres.direct_to_goal import arc_end
from envs.arrays import Array, Float, Int
from envs.frames import F
from envs.kinematics import VehicleState
from envs.trees import column, contiguous, take
from envs.waypoints import ARCS, Legs, PlanStates, displacement, legs

STRAIGHT = 1e-4
"""A leg that leaves uniform motion by no more than this, m, is judged as a whole."""

FINE = 32
"""Parts into which an arc of a leg is cut where it matters: 0.06 s of a leg of 20 s, 4 mm of
uncertainty.
"""

HOLDS = 3
"""Legs of what is held after a manoeuvre has reached its target."""

# Gauss-Legendre's rule of four points over [0, 1], [4, 1, 1]: the nodes lead.
_NODES, _FACTORS = (part[:, None, None] for part in np.polynomial.legendre.leggauss(4))
SHARES, WEIGHTS = 0.5 * (1.0 + _NODES), 0.5 * _FACTORS


class Trajectory(NamedTuple, Generic[F]):
    """What is flown, in a frame; fields ``[N, L]``, those of arcs ``[N, L, ARCS]``."""

    states: PlanStates[F]  # where legs begin and end, [N, L + 1]
    legs: Legs[F]
    bend: Array  # a bound of the acceleration in each arc, along and across, m/s^2
    sagitta: Array  # a bound of the distance of each leg from uniform motion along its chord, m
    # By which positions may be off, m: what a leg misses its end by, and rounding; it grows evenly
    # from where a leg begins, and is greatest where it ends.
    error_begin: Array
    error: Array

    @property
    def end(self) -> Float[Array, " N"]:
        """When the last leg ends, s."""
        return self.states.time[:, -1]

    def since(self, time: Float[Array, " N"]) -> "Trajectory[F]":
        """Return the same with times from another moment on, s, ``[N]``."""
        shift = np.asarray(time)[:, None]
        return self._replace(
            states=self.states._replace(time=self.states.time - shift),
            legs=self.legs._replace(time=self.legs.time - shift),
        )

    def widened(self, rate: Float[Array, " N"], since: Float[Array, " N"]) -> "Trajectory[F]":
        """Return the same for all that leaves it by so much more in a second, m/s, from a moment
        on, s, ``[N]`` each.
        """
        more = rate[:, None] * np.maximum(self.states.time - since[:, None], 0.0)
        return self._replace(
            error_begin=self.error_begin + more[:, :-1], error=self.error + more[:, 1:]
        )


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
    error_begin: Array  # by which positions may be off at the beginning of the leg, m, [M, 1]
    error: Array  # by which they may be off at most, m, [M, 1]
    part: Array  # how long a part of the leg's arcs lasts, s, [M, 1]


def trajectory(states: PlanStates[F], curves: Legs[F] | None = None) -> Trajectory[F]:
    """Return what is flown between states ``[N, W]``, finite and in order of time; ``curves`` are
    the legs between them, if they are known already.
    """
    curves = legs(states) if curves is None else curves
    if FILL_BOUNDS.ready:
        states, curves = contiguous((states, curves))
        bend = np.empty(curves.x.shape)
        sagitta, error = np.empty((2, *curves.duration.shape))
        FILL_BOUNDS(states, curves, bend, sagitta, error)
        return Trajectory(states, curves, bend, sagitta, error, error)
    step = curves.duration[..., None] / ARCS
    bend = greatest_acceleration(curves.speed, curves.yaw_rate, curves.acceleration, step, np)
    share = np.arange(ARCS) / ARCS
    x, y = (
        place - (ends[:, :-1, None] * (1.0 - share) + ends[:, 1:, None] * share)
        for place, ends in ((curves.x, states.x), (curves.y, states.y))
    )
    within_arcs = 0.125 * bend.max(axis=-1) * step[..., 0] ** 2
    sagitta = np.sqrt((x * x + y * y).max(axis=-1)) + within_arcs
    error = curves.miss + position_error_bound(curves)
    return Trajectory(states, curves, bend, sagitta, error, error)


def straight(
    x: Float[Array, "N W"], y: Float[Array, "N W"], time: Float[Array, "N W"]
) -> Trajectory[F]:
    """Return uniform motion from place to place, m, at times, s, in ascending order, ``[N, W]``
    each; at a place the velocity may change at once, as where a mission has its corners.
    """
    dx, dy, duration = np.diff(x), np.diff(y), np.diff(time)
    heading, speed = np.arctan2(dy, dx), np.hypot(dx, dy) / duration
    share = np.arange(ARCS) / ARCS

    def of_arcs(field: Array) -> Array:
        return np.repeat(field[..., None], ARCS, axis=-1)

    still = np.zeros((*duration.shape, ARCS))
    curves: Legs[F] = Legs(
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
    heading, speed = (np.concatenate([field, field[:, -1:]], axis=1) for field in (heading, speed))
    return trajectory(PlanStates(x, y, heading, speed, time), curves)


def straight_on(own: VehicleState[F], until: float) -> Trajectory[F]:
    """Return aircraft ``[N]`` that fly straight on until a time, s."""
    time = np.broadcast_to(np.linspace(0.0, until, HOLDS + 2), (own.x.size, HOLDS + 2))
    far = own.speed[:, None] * time
    x, y = (
        start[:, None] + far * part(own.heading)[:, None]
        for start, part in ((own.x, np.cos), (own.y, np.sin))
    )
    return straight(x, y, time)


def steered(own: VehicleState[F], steering: Steering, time: Float[Array, "..."]) -> VehicleState[F]:
    """Return aircraft on their manoeuvres at times, s, the headings not wrapped; all arguments
    broadcast.
    """
    steers = np.minimum(time, steering.reached)
    turn, speed = steering.yaw_rate * steers, own.speed + steering.acceleration * steers
    x, y = arc_end(own, turn, 0.5 * (own.speed + speed) * steers)
    heading, far = own.heading + turn, speed * (time - steers)
    return VehicleState(x + far * np.cos(heading), y + far * np.sin(heading), heading, speed)


def manoeuvres(own: VehicleState[F], steering: Steering, until: float) -> Trajectory[F]:
    """Return manoeuvres of aircraft ``[N]`` until a time, s: a leg that leads to the target, and
    :data:`HOLDS` in which it is held.
    """
    share = np.linspace(0.0, 1.0, HOLDS + 1)
    held = steering.reached[:, None] * (1.0 - share) + until * share
    time = np.concatenate([np.zeros((len(held), 1)), held], axis=1)
    duration, share = np.diff(time, axis=1), np.arange(ARCS) / ARCS
    states = steered(*column((own, steering)), time)
    # The way to the target, and what is held.
    ramp = steered(*column((own, steering)), duration[:, :1] * share)
    x, y, heading, speed = (
        np.concatenate([part[:, None], field[:, 1:-1, None] + change * share], axis=1)
        for part, field, change in zip(
            ramp,
            states,
            (np.diff(states.x)[:, 1:, None], np.diff(states.y)[:, 1:, None], 0.0, 0.0),
            strict=True,
        )
    )
    controls = np.zeros((2, *x.shape))
    controls[:, :, 0] = np.stack([steering.yaw_rate, steering.acceleration])[..., None]
    none = np.zeros(duration.shape)
    curves: Legs[F] = Legs(time[:, :-1], duration, none, x, y, heading, speed, *controls)
    return trajectory(PlanStates(*states, time), curves)


def pieces(flown: Trajectory[Any], row: Int[Array, " M"], leg: Int[Array, " M"]) -> Pieces:
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
        error_begin=flown.error[row, leg, None],
        error=flown.error[row, leg, None],
        part=step / FINE,
    )


def whole_legs(flown: Trajectory[Any], row: Int[Array, " M"], leg: Int[Array, " M"]) -> Pieces:
    """Return legs of uniform motion as a piece each, by numbers of trajectories and of their legs
    ``[M]``, with P = 1.
    """
    x, y, time = flown.states.x, flown.states.y, flown.states.time
    length = np.maximum(time[row, leg + 1] - time[row, leg], 1e-9)
    first = (row, leg, slice(0, 1))
    legs = flown.legs
    return Pieces(
        row=row,
        leg=leg,
        begin=time[row, leg, None],
        end=time[row, leg + 1, None],
        x0=x[row, leg, None],
        y0=y[row, leg, None],
        x1=x[row, leg + 1, None],
        y1=y[row, leg + 1, None],
        heading=legs.heading[first],
        speed=legs.speed[first],
        yaw_rate=legs.yaw_rate[first],
        acceleration=legs.acceleration[first],
        bend=(8.0 * flown.sagitta[row, leg] / length**2)[:, None],
        error_begin=flown.error_begin[row, leg, None],
        error=flown.error[row, leg, None],
        part=length[:, None] / (ARCS * FINE),
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
    current = {
        "begin": np.zeros(m.size),
        "x0": arcs.x0[m, p] + east,
        "y0": arcs.y0[m, p] + north,
        "heading": heading + yaw_rate * past,
        "speed": speed + acceleration * past,
    }
    copies = {name: np.array(getattr(arcs, name)) for name in current}
    for name, values in current.items():
        copies[name][m, p] = values
    error_begin = np.array(arcs.error_begin)
    error_begin[m] = arcs.error[m]
    return arcs._replace(**copies, error_begin=error_begin)


def cut(arcs: Pieces, m: Int[Array, " Q"], p: Int[Array, " Q"]) -> Pieces:
    """Return the parts, P = ``FINE``, of some arcs, by their numbers ``[Q]``: their row and their
    place in it.
    """
    of_arc = {name: getattr(arcs, name)[m, p, None] for name in Pieces._fields[2:-3]}
    row, leg, error, lasts = take((arcs.row, arcs.leg, arcs.error, arcs.part), m)
    arc = Pieces(row=row, leg=leg, error_begin=error, error=error, part=lasts, **of_arc)
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


def along(
    arcs: Pieces, part: Float[Array, "M 1"]
) -> tuple[Float[Array, "M FINE+1"], Float[Array, "M FINE+1"]]:
    """Return positions on arcs ``[M, 1]`` after 0 to :data:`FINE` parts of some seconds, m,
    ``[M, FINE + 1]`` each: Gauss-Legendre's rule.
    """
    time = np.arange(FINE + 1) * part
    # Velocities as complex numbers: the course at a node of the rule turns by the same from part to
    # part, and turning it takes less than half the time of another sine and cosine. The error grows
    # to some 1e-14.
    start = np.cos(arcs.heading) + 1j * np.sin(arcs.heading)
    turn = arcs.yaw_rate * (SHARES * part)
    turns = np.broadcast_to(np.cos(turn) + 1j * np.sin(turn), (len(SHARES), len(time), FINE))
    starts = np.broadcast_to(start, (len(SHARES), len(time), 1))
    courses = np.multiply.accumulate(np.concatenate([starts, turns], axis=2), axis=2)
    speeds = arcs.speed + arcs.acceleration * (SHARES * time)
    moved = np.add.reduce(speeds * WEIGHTS * courses, axis=0)
    return arcs.x0 + moved.real * time, arcs.y0 + moved.imag * time


def position_error_bound(curves: Legs[Any]) -> Float[Array, "... L"]:
    """Return the error of positions on each leg by Gauss-Legendre's rule, m.

    Proven in proofs/Quadrature.v (``position_error_bound_sound``): below 1 nm on legs of 20 s,
    1 micrometre on those of a minute.
    """
    bound = np.zeros(curves.duration.shape)
    turns = np.nonzero((curves.yaw_rate != 0.0).any(axis=-1))
    legs = take(curves, turns)
    lasts = legs.duration[..., None] / ARCS
    error = quadrature_error(legs.speed, legs.yaw_rate, legs.acceleration, lasts, np)
    bound[turns] = np.sum(error, axis=-1)
    return bound
