"""A Kalman filter of position, velocity and acceleration of an aircraft that turns at a rate.

Both axes are alike: transition, process noise and the reports' noise are the same east and north,
so that one covariance of three quantities holds for either axis and everything is computed
elementwise, without matrices. The turn is the planar constant turn of Li and Jilkov (2003, "Survey
of maneuvering target tracking, part I", section V): the derivative of the acceleration is
``-rate^2 velocity`` and white noise. With a rate of 0 and no acceleration it is straight flight.
"""

from typing import Generic, NamedTuple

from envs.angles import sincos, wrap
from envs.arrays import Array, ArrayModule
from envs.compiled import scalar
from envs.frames import F

_STRAIGHT = 1e-4  # rad turned in a step, below which series replace quotients
_LEAST = 1e-12  # of a variance that is divided by


class Covariance(NamedTuple):
    """Covariance of position p, velocity v and acceleration a along either axis; fields ``[...]``,
    SI units.
    """

    pp: Array
    pv: Array
    pa: Array
    vv: Array
    va: Array
    aa: Array


class Estimate(NamedTuple, Generic[F]):
    """Mean and covariance; fields ``[...]``, SI units."""

    x: Array
    y: Array
    vx: Array
    vy: Array
    ax: Array
    ay: Array
    covariance: Covariance


class Measurement(NamedTuple, Generic[F]):
    """A report: position and velocity, and their variances per axis; fields ``[...]``, SI units."""

    x: Array
    y: Array
    vx: Array
    vy: Array
    position_variance: Array
    velocity_variance: Array


class _Transition(NamedTuple):
    """What a state becomes in some seconds: ``[[1, pv, pa], [0, vv, va], [0, av, vv]]``."""

    pv: Array
    pa: Array
    vv: Array
    va: Array
    av: Array


@scalar
def _transition(rate: Array, dt: Array, xp: ArrayModule) -> _Transition:
    """Return the transition of a turn at a rate, rad/s, over ``dt`` seconds."""
    angle = rate * dt
    sine, cosine = sincos(wrap(angle, xp), xp)
    small = xp.abs(angle) < _STRAIGHT
    turned = xp.where(small, 1.0, angle)
    chord = xp.where(small, 1.0 - angle * angle * (1.0 / 6.0), sine / turned)
    bow = xp.where(small, 0.5, (1.0 - cosine) / (turned * turned))
    return _Transition(chord * dt, bow * dt * dt, cosine, chord * dt, -rate * sine)


@scalar
def white_acceleration(density: Array, dt: Array) -> Covariance:
    """Return what white acceleration of a density, m^2/s^3, adds to a covariance in ``dt`` seconds
    of straight flight, ``[...]``.
    """
    q, zero = density * dt, 0.0 * dt
    return Covariance(q * dt * dt / 3.0, q * dt / 2.0, zero, q, zero, zero)


@scalar
def white_jerk(density: Array, dt: Array) -> Covariance:
    """Return what a white derivative of the acceleration, of a density, m^2/s^5, adds to a
    covariance in ``dt`` seconds, ``[...]``.
    """
    q, square = density * dt, dt * dt
    return Covariance(
        q * square * square / 20.0,
        q * square * dt / 8.0,
        q * square / 6.0,
        q * square / 3.0,
        q * dt / 2.0,
        q,
    )


@scalar
def predict(
    estimate: Estimate[F], rate: Array, noise: Covariance, dt: Array, xp: ArrayModule
) -> Estimate[F]:
    """Return the estimate ``dt`` seconds later, in a turn at a rate, rad/s, with the covariance
    that the process noise of that time has, ``[...]``.
    """
    f, c = _transition(rate, dt, xp), estimate.covariance
    # The rows of transition times covariance.
    p_p, p_v, p_a = (
        c.pp + f.pv * c.pv + f.pa * c.pa,
        c.pv + f.pv * c.vv + f.pa * c.va,
        c.pa + f.pv * c.va + f.pa * c.aa,
    )
    v_v, v_a = f.vv * c.vv + f.va * c.va, f.vv * c.va + f.va * c.aa
    a_v, a_a = f.av * c.vv + f.vv * c.va, f.av * c.va + f.vv * c.aa
    covariance = Covariance(
        pp=p_p + f.pv * p_v + f.pa * p_a + noise.pp,
        pv=f.vv * p_v + f.va * p_a + noise.pv,
        pa=f.av * p_v + f.vv * p_a + noise.pa,
        vv=f.vv * v_v + f.va * v_a + noise.vv,
        va=f.av * v_v + f.vv * v_a + noise.va,
        aa=f.av * a_v + f.vv * a_a + noise.aa,
    )
    return Estimate(
        x=estimate.x + f.pv * estimate.vx + f.pa * estimate.ax,
        y=estimate.y + f.pv * estimate.vy + f.pa * estimate.ay,
        vx=f.vv * estimate.vx + f.va * estimate.ax,
        vy=f.vv * estimate.vy + f.va * estimate.ay,
        ax=f.av * estimate.vx + f.vv * estimate.ax,
        ay=f.av * estimate.vy + f.vv * estimate.ay,
        covariance=covariance,
    )


@scalar
def correct(
    estimate: Estimate[F], report: Measurement[F], xp: ArrayModule
) -> tuple[Estimate[F], Array, Array]:
    """Return the estimate that takes a report in, minus twice the logarithm of the report's density
    but for a constant, and its normalised innovation squared (of four degrees of freedom),
    ``[...]``.

    Position and velocity of a report have independent errors, so that one is taken in after the
    other.
    """
    c = estimate.covariance
    total = xp.maximum(c.pp + report.position_variance, _LEAST)
    kp, kv, ka = c.pp / total, c.pv / total, c.pa / total
    dx, dy = report.x - estimate.x, report.y - estimate.y
    squared = (dx * dx + dy * dy) / total
    vx, vy = estimate.vx + kv * dx, estimate.vy + kv * dy
    ax, ay = estimate.ax + ka * dx, estimate.ay + ka * dy
    x, y = estimate.x + kp * dx, estimate.y + kp * dy
    density = squared + 2.0 * xp.log(total)
    c = Covariance(
        pp=c.pp - kp * c.pp,
        pv=c.pv - kp * c.pv,
        pa=c.pa - kp * c.pa,
        vv=c.vv - kv * c.pv,
        va=c.va - kv * c.pa,
        aa=c.aa - ka * c.pa,
    )
    total = xp.maximum(c.vv + report.velocity_variance, _LEAST)
    kp, kv, ka = c.pv / total, c.vv / total, c.va / total
    dx, dy = report.vx - vx, report.vy - vy
    off = (dx * dx + dy * dy) / total
    corrected: Estimate[F] = Estimate(
        x=x + kp * dx,
        y=y + kp * dy,
        vx=vx + kv * dx,
        vy=vy + kv * dy,
        ax=ax + ka * dx,
        ay=ay + ka * dy,
        covariance=Covariance(
            pp=c.pp - kp * c.pv,
            pv=c.pv - kp * c.vv,
            pa=c.pa - kp * c.va,
            vv=c.vv - kv * c.vv,
            va=c.va - kv * c.va,
            aa=c.aa - ka * c.va,
        ),
    )
    return corrected, density + off + 2.0 * xp.log(total), squared + off


@scalar
def choose(
    condition: Array, first: Estimate[F], second: Estimate[F], xp: ArrayModule
) -> Estimate[F]:
    """Return the first estimate where a condition holds, else the second, ``[...]``."""
    a, b = first.covariance, second.covariance
    covariance = Covariance(
        xp.where(condition, a.pp, b.pp),
        xp.where(condition, a.pv, b.pv),
        xp.where(condition, a.pa, b.pa),
        xp.where(condition, a.vv, b.vv),
        xp.where(condition, a.va, b.va),
        xp.where(condition, a.aa, b.aa),
    )
    return Estimate(
        xp.where(condition, first.x, second.x),
        xp.where(condition, first.y, second.y),
        xp.where(condition, first.vx, second.vx),
        xp.where(condition, first.vy, second.vy),
        xp.where(condition, first.ax, second.ax),
        xp.where(condition, first.ay, second.ay),
        covariance,
    )


@scalar
def mix(first: Estimate[F], second: Estimate[F], share: Array) -> Estimate[F]:
    """Return mean and covariance of a mixture, of which the second estimate has a share,
    ``[...]``.

    What the means differ by adds to the covariance of both axes alike, half of the squared distance
    to each: the trace is that of the mixture.
    """
    other_share = 1.0 - share
    px, py = second.x - first.x, second.y - first.y
    vx, vy = second.vx - first.vx, second.vy - first.vy
    ax, ay = second.ax - first.ax, second.ay - first.ay
    apart, a, b = 0.5 * other_share * share, first.covariance, second.covariance
    covariance = Covariance(
        other_share * a.pp + share * b.pp + apart * (px * px + py * py),
        other_share * a.pv + share * b.pv + apart * (px * vx + py * vy),
        other_share * a.pa + share * b.pa + apart * (px * ax + py * ay),
        other_share * a.vv + share * b.vv + apart * (vx * vx + vy * vy),
        other_share * a.va + share * b.va + apart * (vx * ax + vy * ay),
        other_share * a.aa + share * b.aa + apart * (ax * ax + ay * ay),
    )
    return Estimate(
        first.x + share * px,
        first.y + share * py,
        first.vx + share * vx,
        first.vy + share * vy,
        first.ax + share * ax,
        first.ay + share * ay,
        covariance,
    )
