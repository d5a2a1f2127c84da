"""Derived inputs of the network over a box of the intruder's state: a linear form of the box with a
remainder, each.

A form says c + A e +- R for every e in [-1, 1]^4, where e are the intruder's x, y, vx and vy about
the middle of the box in half widths. Forms go through the policy's own functions; a curve becomes a
chord and its greatest distance.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.policy import candidate_manoeuvres
from agents.policy.scene import Scene
from agents.policy.set_features import ALIKE, SEPARATION_UNIT, intruder_part, own_part
from envs.aircraft import Ratios
from envs.arrays import Array
from envs.relative import distance

_PARTS = 6  # of a chord: on each the direction to the intruder is held
_SOFTENED = 5e-5  # D; by how much 1e-8 in the closest point of a chord can shift a separation
_FINE = 1e-12


class Curve(NamedTuple):
    """A curve, and what encloses it along a line."""

    value: Callable[[Array], Array]
    # for a slope k, every x where value(x) - k x has an extreme or a corner
    critical: Callable[[Array], list[Array]]
    # of the line, by both ends; None: the chord's
    slope: Callable[[Array, Array], Array] | None = None


class Form:
    """Linear forms: middle ``[...]``, slopes ``[..., 4]``, remainder ``[...]``; also an array
    namespace of them.
    """

    __array_ufunc__ = None  # so that an array on the left asks the form

    def __init__(self, middle: Array, slopes: Array, remainder: Array) -> None:
        self.middle, self.slopes, self.remainder = middle, slopes, remainder

    @classmethod
    def between(cls, low: np.ndarray, high: np.ndarray) -> "Form":
        """Return intervals as forms without slopes."""
        middle = 0.5 * (low + high)
        return cls(middle, np.zeros((*middle.shape, 4)), high - middle)

    @classmethod
    def concatenate(cls, forms: list["Form"]) -> "Form":
        """Return forms ``[N, ...]`` beside each other."""
        fields = ((form.middle, form.slopes, form.remainder) for form in forms)
        middle, slopes, remainder = (
            np.concatenate(field, axis=1) for field in zip(*fields, strict=True)
        )
        return cls(middle, slopes, remainder)

    @classmethod
    def stack(cls, forms: Sequence["Form"]) -> "Form":
        """Return forms ``[N]`` as one ``[N, ...]``."""
        return cls.concatenate(
            [
                cls(form.middle[:, None], form.slopes[:, None], form.remainder[:, None])
                for form in forms
            ]
        )

    @property
    def width(self) -> Array:
        """Half width of what the form can be."""
        return np.abs(self.slopes).sum(-1) + self.remainder

    @property
    def ends(self) -> tuple[Array, Array]:
        """Least and greatest of what the form can be."""
        return self.middle - self.width, self.middle + self.width

    def line(self, slope: Array, offset: Array, remainder: Array = 0.0) -> "Form":
        """Return slope * form + offset +- remainder."""
        slopes = np.asarray(slope)[..., None] * self.slopes
        return Form(
            slope * self.middle + offset, slopes, np.abs(slope) * self.remainder + remainder
        )

    def __add__(self, other: Any) -> "Form":
        if isinstance(other, Form):
            return Form(
                self.middle + other.middle,
                self.slopes + other.slopes,
                self.remainder + other.remainder,
            )
        return self.line(1.0, other)

    def __mul__(self, other: Any) -> "Form":
        if not isinstance(other, Form):
            return self.line(other, 0.0)
        if other is self:
            return apply_curve(self, _SQUARE)
        cross = self.line(other.middle, 0.0) + other.line(self.middle, -self.middle * other.middle)
        return Form(cross.middle, cross.slopes, cross.remainder + self.width * other.width)

    def __truediv__(self, other: Any) -> "Form":
        if not isinstance(other, Form):
            return self.line(1.0 / other, 0.0)
        low, _ = other.ends
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = apply_curve(other, _INVERSE)
        inverse.remainder = np.where(low > 0.0, inverse.remainder, np.inf)
        return self * inverse

    def __neg__(self) -> "Form":
        return self.line(-1.0, 0.0)

    def __sub__(self, other: Any) -> "Form":
        return self + -other

    def __rsub__(self, other: Any) -> "Form":
        return -self + other

    __radd__, __rmul__ = __add__, __mul__

    @staticmethod
    def sqrt(form: "Form") -> "Form":
        """Return the square root of what is not negative, whatever its bounds."""
        low, high = np.maximum(form.ends[0], 0.0), np.maximum(form.ends[1], _FINE)
        return form.line(*line_along(low, high, _ROOT))

    @staticmethod
    def abs(form: "Form") -> "Form":
        """Return the size."""
        return apply_curve(form, _SIZE)

    @staticmethod
    def clip(form: "Form", low: float, high: float) -> "Form":
        """Return the form limited to a range."""
        ends = Curve(lambda x: np.clip(x, low, high), lambda k: [low + 0.0 * k, high + 0.0 * k])
        return apply_curve(form, ends)

    @staticmethod
    def minimum(form: "Form", high: float) -> "Form":
        """Return the form, at most ``high``."""
        return Form.clip(form, -1e9, high)


_SQUARE = Curve(np.square, lambda k: [0.5 * k], lambda low, high: low + high)
_INVERSE = Curve(
    np.reciprocal, lambda k: [np.sqrt(-1.0 / k)], lambda low, high: -1.0 / (low * high)
)
_ROOT = Curve(np.sqrt, lambda k: [0.25 / (k + _FINE) ** 2])
_SIZE = Curve(np.abs, lambda k: [0.0 * k])


def _where_steep(k: Array) -> list[Array]:
    """Return where the clearance, x / (1 + |x|), has a slope."""
    away = 1.0 / np.sqrt(np.clip(k, _FINE, 1.0)) - 1.0
    return [away, -away]


_CLEARANCE = Curve(lambda x: x / (1.0 + np.abs(x)), _where_steep)


def apply_curve(form: Form, curve: Curve) -> Form:
    """Return a curve of a form."""
    return form.line(*line_along(*form.ends, curve))


def line_along(low: Array, high: Array, curve: Curve) -> tuple[Array, Array, Array]:
    """Return slope and offset of a line along a curve from ``low`` to ``high``, and how far the
    curve is from it.
    """
    if curve.slope is None:
        wide = high - low > 1e-9
        rise = curve.value(high) - curve.value(low)
        k = np.where(wide, rise / np.where(wide, high - low, 1.0), 0.0)
    else:
        k = curve.slope(low, high)
    inside = (np.clip(x, low, high) for x in curve.critical(k))
    off = np.stack([curve.value(x) - k * x for x in (low, high, *inside)])
    least, most = off.min(axis=0), off.max(axis=0)
    return k, 0.5 * (least + most), 0.5 * (most - least)


def derived_inputs(pace: Array, goal: Array, middle: Array, half: Array, ratios: Ratios) -> Form:
    """Return the 53 inputs of the network, ``[N, 53]``, of scenes that are seen as they are, not
    mirrored.

    Own speed ``[N]`` and goal ``[N, 2]``; middle and half widths of the box of the intruder's x, y,
    vx, vy, ``[N, 4]``, nearer than 20 D.
    """
    state: list[Any] = [
        Form(middle[:, i], half[:, i, None] * np.eye(4)[i], 0.0 * pace) for i in range(4)
    ]
    x, y, vx, vy = middle.T[..., None]
    scene = Scene(pace, goal[:, 0], goal[:, 1], x, y, vx, vy, np.ones((len(pace), 1)), ratios)
    separation = _min_separation(scene, middle, half)
    clearance = apply_curve(
        separation.line(1.0 / SEPARATION_UNIT, -1.0 / SEPARATION_UNIT), _CLEARANCE
    )
    to_goal = distance(goal[:, 0], goal[:, 1], np) + 1e-6
    own = np.stack(
        [np.broadcast_to(value, pace.shape) for value in own_part(scene, 0.0 * pace, np)], axis=-1
    )
    intruder = intruder_part(
        state[0],
        state[1],
        state[2],
        state[3],
        None,
        pace,
        (goal[:, 0] / to_goal, goal[:, 1] / to_goal),
        Form,
    )
    advice, about = (Form.stack(forms) for forms in (_advice(clearance, scene), intruder))
    return Form.concatenate([Form.between(own, own), advice, clearance, about])


class _Chords(NamedTuple):
    """The intruder from the ownship that flies each manoeuvre, in the middle of the box: straight
    chords between P + 1 times.
    """

    time: Array  # [N, 22, P + 1]
    place: Array  # [N, 22, P + 1, 2]

    @classmethod
    def of(cls, scene: Scene, middle: Array) -> "_Chords":
        """Return the chords of manoeuvres, each cut in parts; the middle is of the intruder's x, y,
        vx, vy, ``[N, 4]``.
        """
        times, spans, step_x, step_y, own_x, own_y = (
            np.moveaxis(field, -1, 0) for field in candidate_manoeuvres.paths(scene, np)
        )
        time = _cut(times, spans)
        flown = np.stack([_cut(own_x, step_x), _cut(own_y, step_y)], axis=-1)
        place, velocity = middle[:, None, None, :2], middle[:, None, None, 2:]
        return cls(time, place + velocity * time[..., None] - flown)


def _cut(end: Array, step: Array) -> Array:
    """Return times or places at the ends of all parts of chords, from 0 on, ``[N, 22, P + 1]``, of
    which the ends and the steps are given, ``[N, 22, chords]``.
    """
    share = (np.arange(_PARTS) + 1.0) / _PARTS - 1.0
    count = -1 if len(end) else 0
    parts = (end[..., None] + step[..., None] * share).reshape(*end.shape[:2], count)
    return np.concatenate([0.0 * end[..., :1], parts], -1)


class _Nearest(NamedTuple):
    """The closest point of each part of chords, and what is there."""

    away: Array  # distance, [N, 22, P]
    toward: Array  # direction to the intruder, [N, 22, P, 2]
    when: Array  # time, [N, 22, P]

    @classmethod
    def of(cls, chords: _Chords) -> "_Nearest":
        """Return the closest points of chords."""
        start, way = chords.place[:, :, :-1], np.diff(chords.place, axis=2)
        share = np.clip(-(start * way).sum(-1) / ((way * way).sum(-1) + _FINE), 0.0, 1.0)
        near = start + share[..., None] * way
        away = np.sqrt((near * near).sum(-1))
        when = chords.time[..., :-1] + share * np.diff(chords.time, axis=-1)
        return cls(away, near / np.maximum(away, _FINE)[..., None], when)


def _min_separation(scene: Scene, middle: Array, half: Array) -> Form:
    """Return the least separation of each manoeuvre, ``[N, 22]``.

    The separation of a time is convex in the box, so that the direction to the intruder at the
    closest point gives a lower bound for all of a part of a chord, and the squares of the
    displacements an upper one.
    """
    chords = _Chords.of(scene, middle)
    nearest = _Nearest.of(chords)
    best = nearest.away.argmin(axis=-1)[..., None]
    least = np.take_along_axis(nearest.away, best, -1)
    moment = np.take_along_axis(nearest.when, best, -1)
    toward = np.take_along_axis(nearest.toward, best[..., None], -2)
    chosen = _slopes(toward, moment, half)  # [N, 22, 1, 4]
    below = [
        least
        - (nearest.toward * chords.place[:, :, ends]).sum(-1)
        + np.abs(chosen - _slopes(nearest.toward, chords.time[..., ends], half)).sum(-1)
        for ends in (slice(None, -1), slice(1, None))
    ]
    under = np.maximum(np.maximum(*below).max(axis=-1), 0.0)
    moved = half[:, None, :2] + half[:, None, 2:] * moment
    moved, least, chosen = (moved * moved).sum(-1), least[..., 0], chosen[:, :, 0]
    over = np.minimum(0.5 * moved / np.maximum(least, _FINE), 2.0 * np.sqrt(moved)) + _SOFTENED
    return Form(least + 0.5 * (over - under), chosen, 0.5 * (over + under))


def _slopes(direction: Array, moment: Array, half: Array) -> Array:
    """Return by how much the distance in a direction, ``[N, ..., 2]``, at a moment, ``[N, ...]``,
    grows with each half width of the box, ``[N, 4]``: ``[N, ..., 4]``.
    """
    whole = np.concatenate([direction, direction * moment[..., None]], axis=-1)
    return whole * half.reshape(len(half), *(1,) * (whole.ndim - 2), 4)


def _advice(clearance: Form, scene: Scene) -> list[Form]:
    """Return what the best manoeuvre keeps, ``[N]``, and the bounds of how those that keep as much
    do it.
    """
    best = clearance.middle.argmax(axis=-1)[:, None]
    middle = np.take_along_axis(clearance.middle, best, -1)[:, 0]
    remainder = np.take_along_axis(clearance.remainder, best, -1)[:, 0]
    slopes = np.take_along_axis(clearance.slopes, best[..., None], 1)[:, 0]
    lead = _lead(clearance)
    # By how much the greatest may keep more than the chosen one.
    above = np.take_along_axis(lead, best[:, None], 2)[..., 0].max(axis=1)
    most = Form(middle + 0.5 * above, slopes, remainder + 0.5 * above)
    greatest, least = _weight(-lead.min(axis=2)), _weight(lead.max(axis=1))
    throttles = np.broadcast_to(candidate_manoeuvres.THROTTLES, least.shape)
    steering = candidate_manoeuvres.steering(scene, np)
    return [most, _mean(throttles, least, greatest), _mean(steering, least, greatest)]


def _lead(clearance: Form) -> Array:
    """Return by how much each manoeuvre may keep more than each other, ``[N, 22, 22]``."""
    middle, remainder, slopes = clearance.middle, clearance.remainder, clearance.slopes
    lead = middle[:, :, None] - middle[:, None] + remainder[:, :, None] + remainder[:, None]
    lead += np.abs(slopes[:, :, None] - slopes[:, None]).sum(-1)
    itself = np.arange(candidate_manoeuvres.COUNT)
    lead[:, itself, itself] = 0.0
    return lead


def _weight(behind: Array) -> Array:
    """Return the weight in the mean of a manoeuvre that is so far behind the greatest."""
    return 1.0 / (1.0 + (behind / ALIKE) ** 2)


def _mean(values: Array, least: Array, greatest: Array) -> Form:
    """Return the mean of values ``[N, M]`` with weights between bounds: it is greatest with a
    threshold of values.
    """
    return Form.between(
        -_greatest_mean(-values, least, greatest), _greatest_mean(values, least, greatest)
    )


def _greatest_mean(values: Array, least: Array, greatest: Array) -> Array:
    """Return the greatest mean, ``[N]``: values from a threshold on have their greatest weight, the
    others their least.
    """
    beyond = values[:, None] >= values[:, :, None]  # of each threshold
    weight = np.where(beyond, greatest[:, None], least[:, None])
    return ((weight * values[:, None]).sum(-1) / weight.sum(-1)).max(axis=-1)
