"""Whether reported positions and velocities can both be true, and how large their errors are.

Positions are compared with the integral of the reported velocities, so that manoeuvres play no
part. What grows between the two is a bias of the velocity: a heading sent for a track, an airspeed
for a ground speed, knots for metres a second. A Kalman filter of two states, offset and bias,
alike on both axes, finds it. What scatters around that is the random error of the positions; the
second differences of the velocities show that of the velocities.
"""

import math
from typing import NamedTuple

from envs.arrays import Array, ArrayModule
from envs.compiled import scalar

# Of the comparison of positions with velocities.
_ACCELERATION = 3.0  # m/s^2, of a turn with a bank of 17 degrees: what may lie between two reports
_BIAS_PRIOR = 30.0  # m/s, one sigma: a track off by 25 degrees, half of what knots for m/s make
_BIAS_NOISE = 0.1  # m^2/s^3, white: a wind that changes by 2.4 m/s within a minute
# Chi-square of 2 degrees of freedom: a bias begins where chance makes one in 270 000 reports, and
# ends where chance makes one in 20, so that it neither comes nor goes by a single report.
_BEGINS, _ENDS = 25.0, 6.0
_TURN_SHARE = 0.3  # of a new change of velocity in their running mean: three reports see a turn
_BIAS_LEAST = 0.5  # m/s, 1 kt: what speeds in whole knots differ by
_FEW, _SHORTEST = 3.0, 2.0  # reports, and seconds, of which nothing is said: a line has two of each
# What few reports show of their errors may be too little: the first ones are compared as if their
# positions were this inexact, m, and their scatter is enlarged by this share over their number.
_UNKNOWN, _DOUBT = 30.0, 3.0
# A bias is another one from now on where chance makes one in 3 million reports; not within the
# first reports, which leave open what it is, and how large random errors are.
_ANEW, _SETTLED = 30.0, 8.0
_LONG = 20.0  # s of reports, after which a bias that is not significant is no larger than noise

# Of the random errors.
ROUNDING = (1.0, 0.3)
"""The least errors that are assumed, m and m/s, one sigma: digits of positions, speeds, tracks."""
_SHARE = 0.1  # of a new deviation in the running mean: of ten reports or so
_MEAN = math.sqrt(0.5 * math.pi)  # mean length of a plane normal deviate, in sigmas
_LONGEST = 5.0  # s between two reports, beyond which manoeuvres hide the errors
# A velocity's error in the scatter that it brings to positions, times seconds: at most 3.5, and a
# margin. What is more was a manoeuvre.
_IN_PLACES = 5.0
# Random errors count where they are this many declared ones, and m and m/s besides: a mean of ten
# deviates is never so far off.
_SHOWN, _SHOWN_LEAST = 1.75, (3.0, 1.0)
_GROWN = 1.4  # of an error from one report to the next: its variance has doubled


class Agreement(NamedTuple):
    """What reports have shown so far; fields ``[...]``, SI units."""

    count: Array  # of reports
    length: Array  # between the first and the newest, s
    vx: Array  # velocity of the newest
    vy: Array
    seconds: Array  # between the two newest; 0: there is one
    change_x: Array  # of the velocity per second, between the two newest, m/s^2
    change_y: Array
    turn_x: Array  # running mean of that
    turn_y: Array
    lack_x: Array  # what the velocities lacked of the way between the two newest, per second, m/s
    lack_y: Array
    offset_x: Array  # of the newest position from what the velocities and the bias make, m
    offset_y: Array
    bias_x: Array  # that the velocities lack, m/s
    bias_y: Array
    oo: Array  # variance of the offset, per axis
    ob: Array
    bb: Array
    position_scatter: Array  # running mean of deviations, as one sigma per axis, m
    velocity_scatter: Array  # m/s
    # The random errors, one sigma per axis: as the newest declares, or as the reports show where
    # that is clearly more.
    position_std: Array  # m
    velocity_std: Array  # m/s
    biased: Array  # whether the bias is significant, bool


def begin(
    velocity: tuple[Array, Array], declared: tuple[Array, Array], xp: ArrayModule
) -> Agreement:
    """Return what one report shows, ``[...]``: its velocity, m/s, and one sigma per axis of its
    position and velocity as declared, m and m/s.
    """
    vx, vy = velocity
    zero = 0.0 * (vx + declared[0] + declared[1])
    position_std = xp.maximum(zero + declared[0], _UNKNOWN)
    return Agreement(
        zero + 1.0,
        zero,
        vx,
        vy,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        position_std * position_std,
        zero,
        zero + _BIAS_PRIOR**2,
        zero,
        zero,
        zero + declared[0],
        zero + declared[1],
        zero > 1.0,
    )


@scalar
def _errors(
    count: Array,
    seconds: Array,
    scatter: tuple[Array, Array],
    declared: tuple[Array, Array],
    xp: ArrayModule,
) -> tuple[Array, Array]:
    """Return the random errors of positions and velocities, per axis, m and m/s, ``[...]``.

    Args:
        count: of reports.
        seconds: between the two newest.
        scatter: running means of deviations of positions and velocities, m and m/s.
        declared: one sigma per axis of the newest report, m and m/s.
        xp: the array module.
    """
    position = scatter[0]
    # A velocity's error is in the way between two places too; without it there it was a manoeuvre.
    most = _IN_PLACES * position / xp.maximum(seconds, 1e-3)
    velocity = xp.minimum(scatter[1], most)
    further = position > _SHOWN * declared[0] + _SHOWN_LEAST[0]
    faster = velocity > _SHOWN * declared[1] + _least_shown(seconds, xp)
    # Who understates the error of one field is not believed about the other either.
    shown = xp.logical_and(count > _SETTLED, xp.logical_or(further, faster))
    far = xp.logical_and(shown, position > xp.maximum(declared[0], ROUNDING[0]))
    fast = xp.logical_and(shown, velocity > xp.maximum(declared[1], ROUNDING[1]))
    return xp.where(far, position, declared[0]), xp.where(fast, velocity, declared[1])


@scalar
def _least_shown(seconds: Array, xp: ArrayModule) -> Array:
    """Return by how much random errors of velocities must exceed declared ones to count, m/s: a
    manoeuvre between two reports changes a velocity the more the longer it lasts.
    """
    return _SHOWN_LEAST[1] * xp.maximum(seconds, 1.0)


@scalar
def hidden(agreement: Agreement, xp: ArrayModule) -> tuple[Array, Array]:
    """Return what the random errors of positions and velocities may be, per axis, m and m/s,
    ``[...]``, where reports declare none: their scatter, and of few reports more than that.
    """
    least = _least_shown(agreement.seconds, xp)
    doubt = 1.0 + _DOUBT / agreement.count
    position = xp.maximum(_UNKNOWN / agreement.count, doubt * agreement.position_scatter)
    speed = xp.maximum(least * _FEW / agreement.count, doubt * agreement.velocity_scatter)
    # Long gaps show no scatter.
    short = agreement.seconds <= _LONGEST
    return (
        xp.maximum(xp.where(short, position, _SHOWN_LEAST[0]), ROUNDING[0]),
        xp.maximum(xp.where(short, speed, least), ROUNDING[1]),
    )


@scalar
def suspicion(agreement: Agreement, xp: ArrayModule) -> Array:
    """Return the variance of the velocity, per axis, m^2/s^2, that a bias makes which is not
    significant, ``[...]``: such a one may be true, or chance. Few reports leave open any.
    """
    squared = agreement.bias_x * agreement.bias_x + agreement.bias_y * agreement.bias_y
    long = xp.logical_and(agreement.count > _SETTLED, agreement.length >= _LONG)
    counts = xp.logical_and(long, xp.logical_not(agreement.biased))
    return xp.where(counts, 0.5 * squared, 0.0)


@scalar
def bias(agreement: Agreement, xp: ArrayModule) -> tuple[Array, Array, Array]:
    """Return what reported velocities lack, m/s, and its variance, per axis, ``[...]``;
    0 where nothing significant is.
    """
    biased = agreement.biased
    return (
        xp.where(biased, agreement.bias_x, 0.0),
        xp.where(biased, agreement.bias_y, 0.0),
        xp.where(biased, agreement.bb, 0.0),
    )


@scalar
def worse(
    before: Agreement, after: Agreement, declared: tuple[Array, Array], xp: ArrayModule
) -> Array:
    """Return of which aircraft the newest report shows that all reports are clearly less exact than
    those before it did, bool ``[...]``.

    Args:
        before: without the newest report.
        after: with it.
        declared: one sigma per axis of position and velocity, m and m/s.
        xp: the array module.
    """
    declared_std = (
        xp.maximum(before.position_std, declared[0]),
        xp.maximum(before.velocity_std, declared[1]),
    )
    further = after.position_std > _GROWN * xp.maximum(declared_std[0], ROUNDING[0])
    faster = after.velocity_std > _GROWN * xp.maximum(declared_std[1], ROUNDING[1])
    biased = xp.logical_and(after.biased, xp.logical_not(before.biased))
    return xp.logical_or(xp.logical_or(further, faster), biased)


@scalar
def extend(
    agreement: Agreement,
    moved: tuple[Array, Array],
    velocity: tuple[Array, Array],
    declared: tuple[Array, Array],
    dt: Array,
    xp: ArrayModule,
) -> Agreement:
    """Return what reports show with one more, ``[...]``.

    Args:
        moved: how far its position is from that of the report before, m.
        velocity: as it says, m/s.
        declared: one sigma per axis of position and velocity, m and m/s; 0: none is declared.
        dt: since the report before, s, greater than 0.
    """
    old, (vx, vy) = agreement, velocity
    # What few reports show of their errors may be too little.
    doubt = 1.0 + _DOUBT / old.count
    position_std = xp.maximum(xp.maximum(declared[0], ROUNDING[0]), _UNKNOWN / old.count)
    position_std = xp.maximum(position_std, doubt * old.position_scatter)
    velocity_std = xp.maximum(xp.maximum(declared[1], ROUNDING[1]), doubt * old.velocity_scatter)
    # Half-way between two velocities of a turn the chord is a little longer than their mean.
    lengths = xp.sqrt((old.vx * old.vx + old.vy * old.vy) * (vx * vx + vy * vy))
    cosine = (old.vx * vx + old.vy * vy) / xp.maximum(lengths, 1e-6)
    arc = 1.0 + (1.0 - xp.clip(cosine, 0.0, 1.0)) * (1.0 / 6.0)
    flown_x, flown_y = 0.5 * dt * arc * (old.vx + vx), 0.5 * dt * arc * (old.vy + vy)
    # The manoeuvres between two reports are unknown, and so are the velocities' random errors.
    bow = _ACCELERATION * dt * dt * (1.0 / 12.0)
    drift = 0.5 * (velocity_std * dt) ** 2 + bow * bow
    noise = position_std * position_std
    oo = old.oo + dt * (2.0 * old.ob + dt * old.bb) + drift + _BIAS_NOISE * dt**3 * (1.0 / 3.0)
    ob = old.ob + dt * old.bb + _BIAS_NOISE * dt * dt * 0.5
    # A wrong heading or unit turns with its aircraft, and so does the bias that it makes.
    change_x, change_y = (vx - old.vx) / dt, (vy - old.vy) / dt
    turn_x = old.turn_x + _TURN_SHARE * (change_x - old.turn_x)
    turn_y = old.turn_y + _TURN_SHARE * (change_y - old.turn_y)
    turned = (turn_x * turn_x + turn_y * turn_y) * dt * dt / xp.maximum(lengths, 1.0)
    follows = (old.bias_x * old.bias_x + old.bias_y * old.bias_y) * xp.minimum(turned, 1.0)
    bb = old.bb + _BIAS_NOISE * dt + follows
    lack_x, lack_y = moved[0] - flown_x, moved[1] - flown_y
    off_x = lack_x - old.offset_x - old.bias_x * dt
    off_y = lack_y - old.offset_y - old.bias_y * dt
    other = xp.logical_and(
        off_x * off_x + off_y * off_y > _ANEW * (oo + noise), old.count > _SETTLED
    )
    oo = xp.where(other, noise + (_BIAS_PRIOR * dt) ** 2, oo)
    ob, bb = xp.where(other, _BIAS_PRIOR**2 * dt, ob), xp.where(other, _BIAS_PRIOR**2, bb)
    total = oo + noise
    near, fast = oo / total, ob / total
    bias_x, bias_y = old.bias_x + fast * off_x, old.bias_y + fast * off_y
    bb = bb - fast * ob
    limit = xp.maximum(xp.where(old.biased, _ENDS, _BEGINS) * bb, _BIAS_LEAST**2)
    length = old.length + dt
    late = xp.logical_and(old.count >= _FEW, length >= _SHORTEST)
    biased = xp.logical_and(bias_x * bias_x + bias_y * bias_y > limit, late)

    # Second differences hold neither a bias nor a manoeuvre, but errors alone.
    lack_x, lack_y = lack_x / dt, lack_y / dt
    ratio = dt / xp.maximum(old.seconds, 1e-3)
    scale = dt / (xp.sqrt(1.0 + (1.0 + ratio) ** 2 + ratio * ratio) * _MEAN)
    faster = scale * _length(change_x - old.change_x, change_y - old.change_y, xp)
    further = scale * _length(lack_x - old.lack_x, lack_y - old.lack_y, xp)
    short = xp.logical_and(dt <= _LONGEST, old.seconds <= _LONGEST)
    share = xp.where(
        xp.logical_and(short, old.seconds > 0.0),
        xp.maximum(_SHARE, 1.0 / xp.maximum(old.count - 1.0, 1.0)),
        0.0,
    )
    position_scatter = old.position_scatter + share * (further - old.position_scatter)
    velocity_scatter = old.velocity_scatter + share * (faster - old.velocity_scatter)
    count, seconds = old.count + 1.0, dt + 0.0 * old.seconds
    scatter = position_scatter, velocity_scatter
    shown = _errors(count, seconds, scatter, declared, xp)
    return Agreement(
        count,
        length,
        vx,
        vy,
        seconds,
        change_x,
        change_y,
        turn_x,
        turn_y,
        lack_x,
        lack_y,
        # The newest position is the origin of the next comparison.
        (near - 1.0) * off_x,
        (near - 1.0) * off_y,
        bias_x,
        bias_y,
        oo - near * oo,
        ob - near * ob,
        bb,
        position_scatter,
        velocity_scatter,
        shown[0],
        shown[1],
        biased,
    )


@scalar
def _length(x: Array, y: Array, xp: ArrayModule) -> Array:
    return xp.sqrt(x * x + y * y)
