"""Guidance bands: which headings and which speeds are free, and where none is, which opens first.

Vertical speeds and altitudes have a module of their own (:mod:`agents.assurance.vertical_bands`).

A band's manoeuvre begins now: the aircraft turns onto the heading at its greatest rate, by the
shorter way, with the speed that it has, or changes its speed at its greatest acceleration on the
heading that it has, and holds what it has reached until the end of the look-ahead. A band is
*closed* if this manoeuvre comes closer to an intruder than is required of plans
(:func:`agents.kernel.traffic.requirement_of`, its growth with uncertainty, and the tolerance of
:mod:`agents.planner.judge.validator`), the intruders flying as the planner predicts them, or closer
to an area. So a band says what becomes of one manoeuvre that is held. A plan may begin towards a
closed band and turn away in time; it never holds one until its loss
(docs/explanation/assurance.md).

Clearances are good to 2 cm below a fifth of the separation. Times of loss are exact where both fly
straight, and early by a 320th of the way to the target, or of a leg that is held, at most where one
turns. All motion is relative to one mass of air: with wind, intruders' velocities are given less
the wind, and so are those of areas.
"""

from typing import NamedTuple

import numpy as np

from agents.assurance.between import free_runs, prove_between
from agents.assurance.inputs import no_areas
from agents.kernel.areas import ActiveArea, area_clearance
from agents.kernel.clearance import Clearance, clearance
from agents.kernel.separation import separation
from agents.kernel.traffic import Requirement, Traffic
from agents.kernel.trajectory import Steering, Trajectory, manoeuvres, straight_on
from envs.angles import wrap
from envs.arrays import Array, Bool, Float, Shaped
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.trees import map_leaves, take

HEADINGS = 72
"""Headings that are looked at where none are asked for: one every 5 degrees."""

SPEEDS = 21
"""Speeds likewise, from the lowest to the highest."""

_INTEREST = 0.2  # separations of clearance beyond which a lower bound of it will do
_NO_RATE = 1e-9  # rad/s or m/s^2, of what cannot turn or change its speed
_ALIKE = 0.1  # separations by which a way may come closer than the best and open sooner
_BLOCK = 1_000_000  # distances at once


class Bands(NamedTuple):
    """Manoeuvres of one kind and what becomes of each; fields ``[N, B]``."""

    # heading, rad in [-pi, pi), speed or vertical speed, m/s, or altitude, m, in ascending order
    target: Array
    reached: Array  # when the target is, s from now; the look-ahead where it is not within that
    # when less than the required distance is left first, s from now; inf where that is kept
    loss: Array
    # number of the intruder with which it is lost first; -1 where it is kept, or an area is earlier
    intruder: Array
    # number of the area (agents.kernel.areas.ActiveArea) of which it is lost first; -1 likewise
    area: Array
    # Smallest distance less the required one, m; a lower bound where it is more than a fifth of the
    # separation; inf without any of them. Of vertical speeds and altitudes it is vertical
    # (agents.assurance.vertical_bands).
    clearance: Array
    # from when on the required distance is kept until the look-ahead's end, s; 0 where always, inf
    # where never
    opens: Array
    # About the target, as far as the neighbouring ones at most: from where to where all manoeuvres
    # are proven to keep the required distance, good to a 64th of the way between targets; the
    # target alone where it is closed. The heading opposite to the own one is reached from both
    # sides, and lies between two targets.
    low: Array
    high: Array
    # when a manoeuvre half-way to the neighbouring targets at most may lose the required distance
    # first, s from now; inf: none does
    nearby: Array

    @property
    def closed(self) -> Bool[Array, "N B"]:
        """Whether the manoeuvre loses the required distance within the look-ahead."""
        return np.isfinite(self.loss)


class Recovery(NamedTuple):
    """The way out where no band is free; fields ``[N]``."""

    index: Array  # of the band; -1 where some band is free, or where none is any way out
    opens: Array  # from when on it keeps the required distance, s; inf: not within the look-ahead
    clearance: Array  # by how much it falls short of the required distance until then, m, negative


class Stretch(NamedTuple):
    """A stretch of neighbouring bands that are all free or all closed."""

    low: float  # where it begins, as of Bands.target: a heading may be beyond the circle's end
    high: float
    closed: bool


def heading_bands(
    own: VehicleState[Air],
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    look_ahead: float,
    targets: Float[Array, "... B"] = None,
    areas: Shaped[Array, " N"] = None,
) -> Bands:
    """Return the bands of headings, ``[N, B]``, of ownships ``[N]`` among intruders ``[N, K]``.

    Args:
        limits: of the ownship; its turn rate counts.
        look_ahead: for how long each manoeuvre is looked at, s.
        targets: headings, rad, ``[B]`` or ``[N, B]``, ascending where :func:`stretches` is asked
            for; None: :data:`HEADINGS` of them.
        areas: that each ownship may meet, as they are now, object ``[N]`` of tuples of
            :class:`agents.kernel.areas.ActiveArea`; None: none.
    """
    if targets is None:
        targets = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS) - np.pi
    targets = np.broadcast_to(targets, (own.x.size, np.shape(targets)[-1]))
    rate = max(limits.yaw_rate_max, _NO_RATE)
    kind = _Kind(
        own,
        target=wrap(targets, np),
        change=wrap(targets - own.heading[:, None], np),
        yaw_rate=rate,
        acceleration=(0.0, 0.0),
        velocity=own.speed,
        circle=True,
    )
    return _bands(kind, _Sky(traffic, requirement, areas), look_ahead)


def speed_bands(
    own: VehicleState[Air],
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    look_ahead: float,
    targets: Float[Array, "... B"] = None,
    areas: Shaped[Array, " N"] = None,
) -> Bands:
    """Return the bands of speeds, ``[N, B]``; the arguments are those of :func:`heading_bands`.

    Targets are speeds, m/s, ascending; None: :data:`SPEEDS` of them within the limits.
    """
    if targets is None:
        targets = np.linspace(limits.speed_min, limits.speed_max, SPEEDS)
    targets = np.broadcast_to(targets, (own.x.size, np.shape(targets)[-1]))
    kind = _Kind(
        own,
        target=targets,
        change=targets - own.speed[:, None],
        yaw_rate=0.0,
        acceleration=(
            max(limits.acceleration_max, _NO_RATE),
            min(limits.acceleration_min, -_NO_RATE),
        ),
        velocity=np.ones(own.x.shape),
        circle=False,
    )
    return _bands(kind, _Sky(traffic, requirement, areas), look_ahead)


def losses_on_course(
    own: VehicleState[Air], traffic: Traffic, requirement: Requirement, look_ahead: float
) -> Float[Array, "N K"]:
    """Return when each intruder comes closer than required if the ownship flies straight on, s from
    now; inf: not within the look-ahead.
    """
    flown = straight_on(own, look_ahead)
    return clearance(flown, separation(traffic, own, requirement)).loss


def area_losses(
    own: VehicleState[Air], areas: tuple[ActiveArea, ...], margin: float, look_ahead: float
) -> list[float]:
    """Return when an ownship ``[1]`` that flies straight on loses what it must keep of each area, s
    from now; inf: not within the look-ahead.
    """
    flown = straight_on(own, look_ahead)
    return clearance(flown, area_clearance(areas, own.x, own.y, margin)).loss[0].tolist()


def recovery(bands: Bands, separation: float) -> Recovery:
    """Return the way out of rows in which no band is free, ``[N]``.

    Of the bands that come no closer than the best one, but for a tenth of the separation (m), it is
    the one that opens soonest. Where none has a clearance, as where all altitudes are shut, none is
    better than another.
    """
    alike = bands.clearance >= bands.clearance.max(axis=1, keepdims=True) - _ALIKE * separation
    opens = np.where(alike, bands.opens, np.inf)
    order = np.lexsort((-bands.clearance, opens, ~alike), axis=1)
    rows, index = np.arange(order.shape[0]), order[:, 0]
    nothing_free = bands.closed.all(axis=1) & np.isfinite(bands.clearance[rows, index])
    return Recovery(
        np.where(nothing_free, index, -1), bands.opens[rows, index], bands.clearance[rows, index]
    )


def stretches(bands: Bands, row: int = 0, *, circle: bool = True) -> list[Stretch]:
    """Return the free and the closed stretches of one row, in ascending order.

    All manoeuvres of a free stretch are proven to keep the required distance (``Bands.low``). On a
    ``circle`` (headings) the last stretch ends where the first one begins.
    """
    begin, end = float(bands.target[row, 0]), float(bands.target[row, -1])
    whole = 2.0 * np.pi if circle else None
    runs = free_runs(bands.low[row], bands.high[row], whole)
    if whole is not None:
        # In ascending order from the first target on.
        begins = sorted(begin + (low - begin) % whole for low, _ in runs)
        lengths = {begin + (low - begin) % whole: high - low for low, high in runs}
        runs = [(low, low + lengths[low]) for low in begins]
        begin = runs[0][0] if runs else begin
        end = begin + whole
    parts, last = list[Stretch](), begin
    for low, high in runs:
        parts += [Stretch(last, low, closed=True), Stretch(low, high, closed=False)]
        last = high
    parts.append(Stretch(last, end, closed=True))
    return [stretch for stretch in parts if stretch.high > stretch.low]


class _Kind(NamedTuple):
    """Manoeuvres of one kind of ownships ``[N]``."""

    own: VehicleState[Air]
    target: Array  # [N, B]
    # of the heading, rad, or of the speed, m/s, by which a target is reached, [N, B]
    change: Array
    yaw_rate: float  # to the left, the opposite to the right, rad/s
    acceleration: tuple[float, float]  # upwards and downwards, m/s^2
    velocity: Array  # by how much the velocity differs where the change does by one, m/s, [N]
    circle: bool

    def steering(self, change: Array, look_ahead: float) -> Steering:
        """Return the manoeuvres that make some changes, ``[...]``."""
        rises = change >= 0.0
        yaw_rate = np.where(rises, self.yaw_rate, -self.yaw_rate)
        acceleration = np.where(rises, *self.acceleration)
        reached = np.minimum(change / (yaw_rate + acceleration), look_ahead)
        return Steering(yaw_rate, acceleration, reached)


class _Sky(NamedTuple):
    """What is kept clear of: intruders ``[N, K]``, and areas, object ``[N]``; None: none."""

    traffic: Traffic
    requirement: Requirement
    areas: Array


def _bands(kind: _Kind, sky: _Sky, look_ahead: float) -> Bands:
    """Return the bands of one kind, of so many rows at once as memory allows."""
    count, size = kind.own.x.size, sky.traffic.mask.shape[-1] * kind.change.shape[-1]
    rows = max(_BLOCK // max(size, 1), 1)
    sky = sky if sky.areas is not None else sky._replace(areas=no_areas(count))
    parts = []
    for first in range(0, max(count, 1), rows):
        part = slice(first, first + rows)
        own, target, change, velocity = take(
            (kind.own, kind.target, kind.change, kind.velocity), part
        )
        kind_of_part = kind._replace(own=own, target=target, change=change, velocity=velocity)
        around = sky._replace(traffic=take(sky.traffic, part), areas=sky.areas[part])
        parts.append(_block(kind_of_part, around, look_ahead))
    return parts[0] if len(parts) == 1 else Bands(*map(np.concatenate, zip(*parts, strict=True)))


def _block(kind: _Kind, sky: _Sky, look_ahead: float) -> Bands:
    everyone = np.arange(kind.own.x.size)
    steering = kind.steering(kind.change, look_ahead)
    flown = _fly(kind.own, everyone, steering, look_ahead)
    shape = kind.change.shape
    level = _INTEREST * sky.requirement.separation
    losses = _Losses(
        *(field.reshape(shape) for field in _keep(flown, kind.own, everyone, sky, level))
    )

    def judge(rows: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Judge intervals by the manoeuvre in their middle, which the others leave by their
        differences of velocity at most, from when the first of them has reached its target.
        """
        reached = [kind.steering(end, look_ahead).reached for end in (low, high)]
        since = np.where(low * high <= 0.0, 0.0, np.minimum(*reached))
        rate = 0.5 * (high - low) * kind.velocity[rows, None]
        middle = kind.steering(0.5 * (low + high), look_ahead)
        flown = _fly(kind.own, rows, middle, look_ahead)
        kept_between = _keep(flown.widened(rate.ravel(), since.ravel()), kind.own, rows, sky, 0.0)
        proven, loss = kept_between.clearance >= 0.0, np.minimum(kept_between.loss, look_ahead)
        return proven.reshape(low.shape), loss.reshape(low.shape)

    between = prove_between(kind.change, np.isfinite(losses.loss), judge, circle=kind.circle)
    return Bands(
        kind.target,
        steering.reached,
        losses.loss,
        losses.intruder,
        losses.area,
        losses.clearance,
        np.where(losses.until >= look_ahead, np.inf, np.maximum(losses.until, 0.0)),
        kind.target + (between.low - kind.change),
        kind.target + (between.high - kind.change),
        between.nearby,
    )


def _fly(
    own: VehicleState[Air], rows: Array, steering: Steering, look_ahead: float
) -> Trajectory[Air]:
    """Return manoeuvres ``[R, B]`` of ownships numbered ``rows`` as trajectories ``[R * B]``."""
    owners = np.repeat(rows, steering.reached.shape[1])
    return manoeuvres(take(own, owners), map_leaves(np.ravel, steering), look_ahead)


class _Losses(NamedTuple):
    """What manoeuvres keep; fields ``[M]``, as those of bands."""

    loss: Array
    until: Array
    clearance: Array
    intruder: Array
    area: Array


def _keep(
    flown: Trajectory[Air], own: VehicleState[Air], rows: Array, sky: _Sky, level: float
) -> _Losses:
    """Return what manoeuvres ``[R * B]`` of ownships numbered ``rows`` keep of all that they may
    meet; clearances above a level, m, are lower bounds.
    """
    size = flown.end.size // max(rows.size, 1)
    keeping = separation(sky.traffic, own, sky.requirement).rows(np.repeat(rows, size))
    loss, until, clear, intruder = _of_all(clearance(flown, keeping, level))
    losses = _Losses(loss, until, clear, intruder, np.full(loss.shape, -1))
    for r, n in enumerate(rows):
        if not sky.areas[n]:
            continue
        part, begin = slice(r * size, (r + 1) * size), (own.x[[n]], own.y[[n]])
        keeping = area_clearance(sky.areas[n], *begin, sky.requirement.margin)
        keeping = keeping._replace(required=np.repeat(keeping.required, size, axis=0))
        loss, until, clear, lost = _of_all(clearance(take(flown, part), keeping, level))
        earlier = loss < losses.loss[part]
        numbers = np.array([active.number for active in sky.areas[n]])
        losses.intruder[part] = np.where(earlier, -1, losses.intruder[part])
        losses.area[part] = np.where(earlier, numbers[lost], -1)
        np.minimum(losses.loss[part], loss, out=losses.loss[part])
        np.maximum(losses.until[part], until, out=losses.until[part])
        np.minimum(losses.clearance[part], clear, out=losses.clearance[part])
    return losses


def _of_all(clearances: Clearance) -> tuple[Array, Array, Array, Array]:
    """Return when manoeuvres ``[M]`` lose what is required of some intruder or area first and until
    when, the smallest clearance, m, and with which it is lost first, -1: with none.
    """
    if clearances.loss.shape[1] == 0:
        none = np.full(len(clearances.loss), np.inf)
        return none, -none, none.copy(), np.full(len(clearances.loss), -1)
    first = np.argmin(clearances.loss, axis=1)
    loss = np.take_along_axis(clearances.loss, first[:, None], 1)[:, 0]
    lost = np.where(np.isfinite(loss), first, -1)
    return loss, clearances.until.max(axis=1), clearances.margin.min(axis=1), lost
