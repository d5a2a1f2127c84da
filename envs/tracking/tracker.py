"""The tracker: an interacting-multiple-model filter of straight flight and coordinated turn.

After Blom and Bar-Shalom (1988) and Bar-Shalom, Li and Kirubarajan, *Estimation with Applications
to Tracking and Navigation* (2001), section 11.6: two filters (:mod:`envs.tracking.estimate`) take
in the same reports; before each report their estimates are mixed by the chances that the aircraft
has begun or ended a turn, and what each lets be expected of the report says how likely each is.

What leaves it (:class:`Belief`) has the accuracy that the reports show
(:mod:`envs.tracking.agreement`), never a better one than they declare. Reports that declare no
error and agree with those before pass through as they are, to the bit. So do those whose accuracy
is unknown: it may be a constant error, which no average makes smaller.
"""

import math
from typing import Generic, NamedTuple

import numpy as np

from envs.angles import atan2, wrap
from envs.arrays import Array, ArrayModule
from envs.compiled import scalar
from envs.frames import F
from envs.kinematics import VehicleState, velocity
from envs.tracking import agreement as agreements
from envs.tracking.agreement import ROUNDING, Agreement
from envs.tracking.estimate import (
    Covariance,
    Estimate,
    Measurement,
    choose,
    correct,
    mix,
    predict,
    white_acceleration,
    white_jerk,
)
from envs.trees import map_leaves

# Of the two filters. White noises: what gusts and a pilot's hand do to straight flight (1.7 m/s
# within a minute), and how far a turn is from a steady one (1.2 m/s^2 within 5 s).
WANDER, JERK = 0.05, 0.3  # m^2/s^3 of acceleration, m^2/s^5 of its derivative
ONSET = 3.0  # m/s^2, one sigma per axis of the acceleration that a turn begins with: 17 deg of bank
# Mean times, s: a leg between two turns, and a turn of 60 degrees at the standard rate.
STRAIGHT_LASTS, TURN_LASTS = 60.0, 20.0
TURNING = TURN_LASTS / (STRAIGHT_LASTS + TURN_LASTS)  # share of the time that they make
FIRST = 0.1  # chance of a turn at the first report: less, because most traffic flies straight
FASTEST_TURN = 0.6  # rad/s, 34 deg/s: a bank of 70 degrees at 45 m/s
# The error of a bias is the same in many reports, but the filters take errors for independent: its
# variance counts as this many.
_BIASED = 4.0

# m, m/s: what errors of 10 m and 1 m/s hide of a bias. It widens the errors no further.
_SUSPECTED = 20.0, 3.0

# Of what follows from what.
_JUMP = 50.0  # chi-square of 4 degrees of freedom that chance makes once in 3e9 reports
_SILENCE = 30.0  # s without a report, after which an aircraft is as new: it may have turned back
# Of the speed: a larger bias leaves open which of position and velocity is wrong. A velocity in m/s
# that was sent in knots, or the reverse, makes 0.49 of the greater of the two speeds.
_BOTH = 0.55
# s between two reports that a rate of turn is read from: rounding hides what is shorter, and within
# what is longer a turn may have begun and ended.
_BASELINE = (0.2, 5.0)
_SAME = 1e-6  # s by which the times of one report may differ: rounding of a clock less an age


class Reports(NamedTuple, Generic[F]):
    """Reports of aircraft; fields ``[...]``."""

    state: VehicleState[F]
    position_std: Array  # one sigma per axis, m, as declared; 0: exact, or unknown
    velocity_std: Array  # m/s
    declared: Array = True  # whether both are declared, bool


class Tracks(NamedTuple, Generic[F]):
    """What is known of aircraft after their newest reports; fields ``[...]``."""

    newest: Reports[F]
    straight: Estimate[F]
    turning: Estimate[F]
    turns: Array  # probability of a turn
    course: Array  # of an earlier report, that the rate of turn is read from, rad
    since: Array  # that report, s
    rate: Array  # of turn between two reports, rad/s
    agreement: Agreement


class Belief(NamedTuple, Generic[F]):
    """What leaves the tracker, as of the newest reports; fields ``[...]``.

    Where velocity and positions differ so much that neither can be believed, the standard
    deviations of both are infinite.
    """

    state: VehicleState[F]
    turn_rate: Array  # rad/s, positive to the left; 0: straight flight
    turn_std: Array  # one sigma of it
    position_std: Array  # one sigma, per axis, m
    velocity_std: Array  # m/s
    bias: Array  # by which the velocity differs from the positions, m/s; 0: by nothing significant

    @property
    def doubtful(self) -> Array:
        """Whether neither velocity nor position can be believed, bool ``[...]``."""
        return self.velocity_std == math.inf


def begin(reports: Reports[F], xp: ArrayModule = np) -> Tracks[F]:
    """Return tracks that know one report each, ``[...]``."""
    zero = 0.0 * (reports.state.x + reports.position_std + reports.velocity_std)
    state = reports.state
    reports = Reports(
        VehicleState(state.x + zero, state.y + zero, state.heading + zero, state.speed + zero),
        reports.position_std + zero,
        reports.velocity_std + zero,
        xp.logical_and(reports.declared, zero == 0.0),
    )
    declared = reports.position_std, reports.velocity_std
    agreement = agreements.begin(velocity(reports.state, xp), declared, xp)
    straight, turning = _first_estimates(_measure(reports, agreement, xp))
    heading = reports.state.heading
    return Tracks(reports, straight, turning, zero + FIRST, heading, zero, zero, agreement)


@scalar
def turn_of(estimate: Estimate[F], xp: ArrayModule) -> Array:
    """Return the turn rate of an estimate, rad/s, ``[...]``."""
    squared = estimate.vx * estimate.vx + estimate.vy * estimate.vy
    across = estimate.vx * estimate.ay - estimate.vy * estimate.ax
    return xp.clip(across / xp.maximum(squared, 1.0), -FASTEST_TURN, FASTEST_TURN)


@scalar
def extend(
    tracks: Tracks[F], reports: Reports[F], dt: Array, xp: ArrayModule = np
) -> tuple[Tracks[F], Array]:
    """Return the tracks with later reports, ``[...]``, and of which aircraft the report does not
    follow from those before, bool.

    Args:
        tracks: of the same aircraft.
        reports: as received.
        dt: since the reports before, s, greater than 0.
        xp: the array module.
    """
    state, before = reports.state, tracks.newest.state
    moved = state.x - before.x, state.y - before.y
    declared = reports.position_std, reports.velocity_std
    agreement = agreements.extend(tracks.agreement, moved, velocity(state, xp), declared, dt, xp)
    measured = _measure(reports, agreement, xp)
    straight, turning, turns = _interact(tracks, dt, xp)
    rate = turn_of(turning, xp)
    straight = predict(straight, 0.0 * rate, white_acceleration(WANDER, dt), dt, xp)
    turning = predict(turning, rate, white_jerk(JERK, dt), dt, xp)
    straight, unlike_straight, off_straight = correct(straight, measured, xp)
    turning, unlike_turning, off_turning = correct(turning, measured, xp)
    odds = turns * xp.exp(xp.clip(0.5 * (unlike_straight - unlike_turning), -50.0, 50.0))
    turns = odds / (1.0 - turns + odds)
    # Reports that were taken in as more exact than they are would mislead for long.
    restarts = agreements.worse(tracks.agreement, agreement, declared, xp)
    level, bent = _first_estimates(measured)
    straight, turning = choose(restarts, level, straight, xp), choose(restarts, bent, turning, xp)
    turns = xp.where(restarts, FIRST, turns)
    zero = 0.0 * turns
    since = tracks.since + dt
    due, gap = since >= _BASELINE[0], since > _BASELINE[1]
    rate = wrap(state.heading - tracks.course, xp) / since
    extended = Tracks(
        Reports(
            state,
            reports.position_std + zero,
            reports.velocity_std + zero,
            xp.logical_and(reports.declared, zero == 0.0),
        ),
        straight,
        turning,
        turns,
        xp.where(due, state.heading, tracks.course),
        xp.where(due, 0.0, since),
        xp.where(gap, 0.0, xp.where(due, rate, tracks.rate)),
        agreement,
    )
    return extended, xp.minimum(off_straight, off_turning) > _JUMP


@scalar
def restart(tracks: Tracks[F], xp: ArrayModule = np) -> Tracks[F]:
    """Return the tracks with estimates that begin with the newest reports; what the reports have
    shown of their errors stays.
    """
    newest, agreement = tracks.newest, tracks.agreement
    straight, turning = _first_estimates(_measure(newest, agreement, xp))
    turns = 0.0 * tracks.turns + FIRST
    return Tracks(
        newest, straight, turning, turns, tracks.course, tracks.since, tracks.rate, agreement
    )


@scalar
def _measure(reports: Reports[F], agreement: Agreement, xp: ArrayModule) -> Measurement[F]:
    """Return reports as the filters take them in: with the errors that they show, and less the bias
    of their velocities.
    """
    vx, vy = velocity(reports.state, xp)
    bias_x, bias_y, bias_variance = agreements.bias(agreement, xp)
    variances = _variances(agreement, reports.declared, bias_variance, xp)
    x, y = reports.state.x, reports.state.y
    return Measurement(x, y, vx + bias_x, vy + bias_y, variances[0], variances[1])


@scalar
def _variances(
    agreement: Agreement, declared: Array, bias_variance: Array, xp: ArrayModule
) -> tuple[Array, Array]:
    """Return the variances of the newest reports as the filters take them in, per axis, m^2 and
    m^2/s^2; ``declared``: of which reports the errors are declared.
    """
    hidden = agreements.hidden(agreement, xp)
    near = xp.maximum(agreement.position_std, xp.where(declared, ROUNDING[0], hidden[0]))
    fast = xp.maximum(agreement.velocity_std, xp.where(declared, ROUNDING[1], hidden[1]))
    return near * near, fast * fast + _BIASED * bias_variance


@scalar
def _first_estimates(measured: Measurement[F]) -> tuple[Estimate[F], Estimate[F]]:
    """Return the estimates of straight flight and of a turn that know one report."""
    x, y, vx, vy, near, fast = measured
    zero = 0.0 * near
    level = Covariance(near, zero, zero, fast, zero, zero)
    bent = Covariance(near, zero, zero, fast, zero, zero + ONSET**2)
    return (
        Estimate(x, y, vx, vy, zero, zero, level),
        Estimate(x, y, vx, vy, zero, zero, bent),
    )


@scalar
def _interact(
    tracks: Tracks[F], dt: Array, xp: ArrayModule
) -> tuple[Estimate[F], Estimate[F], Array]:
    """Return the two estimates as they begin the next step, and the probability of a turn then."""
    changes = 1.0 - xp.exp(-dt * (1.0 / STRAIGHT_LASTS + 1.0 / TURN_LASTS))
    begins, ends = changes * TURNING, changes * (1.0 - TURNING)
    from_straight, from_turn = (1.0 - tracks.turns) * begins, tracks.turns * (1.0 - ends)
    turns = from_straight + from_turn
    zero = 0.0 * turns
    # Straight flight that begins to turn does so with an unknown acceleration.
    flown, c = tracks.straight, tracks.straight.covariance
    bent = Covariance(c.pp, c.pv, c.pa, c.vv, c.va, zero + ONSET**2)
    begun: Estimate[F] = Estimate(flown.x, flown.y, flown.vx, flown.vy, zero, zero, bent)
    turning = mix(begun, tracks.turning, from_turn / turns)
    flown = mix(tracks.straight, tracks.turning, tracks.turns * ends / (1.0 - turns))
    c = flown.covariance
    level = Covariance(c.pp, c.pv, zero, c.vv, zero, zero)
    return Estimate(flown.x, flown.y, flown.vx, flown.vy, zero, zero, level), turning, turns


@scalar
def belief(tracks: Tracks[F], xp: ArrayModule = np) -> Belief[F]:
    """Return what is believed as of the newest reports, ``[...]``."""
    newest, agreement = tracks.newest, tracks.agreement
    reported = newest.state
    least = newest.position_std, newest.velocity_std
    near, fast = agreement.position_std, agreement.velocity_std
    bias_x, bias_y, bias_variance = agreements.bias(agreement, xp)
    bias = xp.sqrt(bias_x * bias_x + bias_y * bias_y)
    exact = xp.logical_and(least[0] == 0.0, least[1] == 0.0)
    shown = xp.logical_or(xp.logical_or(near > least[0], fast > least[1]), bias > 0.0)
    averaged = xp.logical_and(newest.declared, xp.logical_not(exact))
    passes = xp.logical_not(xp.logical_or(shown, averaged))

    flown = mix(tracks.straight, tracks.turning, tracks.turns)
    squared = flown.vx * flown.vx + flown.vy * flown.vy
    speed = xp.sqrt(squared)
    # Which of two is wrong that differ by so much, nobody knows.
    doubtful = bias > _BOTH * xp.maximum(speed, reported.speed)
    # The newest report alone is as good as this.
    of_newest = _variances(agreement, newest.declared, bias_variance, xp)
    c = flown.covariance
    place, motion = xp.clip(c.pp, 0.0, of_newest[0]), xp.clip(c.vv, 0.0, of_newest[1])
    # The error of a bias is the same in many reports, so that the filters average none of it.
    # Positions that a wrong velocity draws along lag by the time that the filter averages them for.
    suspicion = agreements.suspicion(agreement, xp)
    lag = agreement.seconds * of_newest[0] / xp.maximum(place, 1e-3 * of_newest[0])
    place = xp.minimum(place + lag * lag * suspicion, xp.maximum(of_newest[0], _SUSPECTED[0] ** 2))
    motion = xp.minimum(motion + suspicion, xp.maximum(of_newest[1], _SUSPECTED[1] ** 2))
    position_std, velocity_std = xp.sqrt(place), xp.sqrt(motion + bias_variance)
    # Errors that nobody declared need not be white: no average makes them smaller.
    position_std = xp.where(near > least[0], xp.maximum(position_std, near), position_std)
    velocity_std = xp.where(fast > least[1], xp.maximum(velocity_std, fast), velocity_std)
    unknown = xp.logical_not(newest.declared)
    position_std = xp.where(unknown, xp.maximum(position_std, least[0]), position_std)
    velocity_std = xp.where(unknown, xp.maximum(velocity_std, least[1]), velocity_std)
    position_std = xp.where(doubtful, math.inf, position_std)
    velocity_std = xp.where(doubtful, math.inf, velocity_std)

    turns, rate = tracks.turns > 0.5, turn_of(tracks.turning, xp)
    c = tracks.turning.covariance
    turn_std = xp.sqrt(xp.maximum(c.aa + rate * rate * c.vv, 0.0) / xp.maximum(squared, 1.0))
    rate = xp.where(turns, rate, 0.0)
    passes_exactly = xp.logical_and(xp.logical_and(passes, exact), newest.declared)
    return Belief(
        VehicleState(
            xp.where(passes, reported.x, flown.x),
            xp.where(passes, reported.y, flown.y),
            xp.where(passes, reported.heading, atan2(flown.vy, flown.vx, xp)),
            xp.where(passes, reported.speed, speed),
        ),
        xp.where(passes_exactly, xp.clip(tracks.rate, -FASTEST_TURN, FASTEST_TURN), rate),
        xp.where(xp.logical_or(passes_exactly, xp.logical_not(turns)), 0.0, turn_std),
        xp.where(passes, least[0], position_std),
        xp.where(passes, least[1], velocity_std),
        bias,
    )


@scalar
def shift(tracks: Tracks[F], x: Array, y: Array) -> Tracks[F]:
    """Return the tracks in a map whose origin lies at x and y, m, of theirs, ``[...]``."""
    newest = tracks.newest
    at = newest.state
    return Tracks(
        Reports(
            VehicleState(at.x - x, at.y - y, at.heading, at.speed),
            newest.position_std,
            newest.velocity_std,
            newest.declared,
        ),
        _shifted(tracks.straight, x, y),
        _shifted(tracks.turning, x, y),
        tracks.turns,
        tracks.course,
        tracks.since,
        tracks.rate,
        tracks.agreement,
    )


@scalar
def _shifted(estimate: Estimate[F], x: Array, y: Array) -> Estimate[F]:
    return Estimate(
        estimate.x - x,
        estimate.y - y,
        estimate.vx,
        estimate.vy,
        estimate.ax,
        estimate.ay,
        estimate.covariance,
    )


class Sightings(NamedTuple, Generic[F]):
    """Tracks of aircraft of which not every step brings a report; fields ``[...]``."""

    tracks: Tracks[F]
    time: Array  # of the newest reports, s; -inf before the first


def repeats(before: VehicleState[F], state: VehicleState[F], dt: Array, xp: ArrayModule) -> Array:
    """Return of which aircraft a report repeats the position of ``dt`` seconds before although it
    flies: what it says is as old as that position, whatever its stamp.
    """
    same = xp.logical_and(before.x == state.x, before.y == state.y)
    return xp.logical_and(same, state.speed * dt > ROUNDING[0])


def observe(
    sightings: Sightings[F] | None, reports: Reports[F], time: float, present: Array
) -> Sightings[F]:
    """Return what is known at a time, s, with reports of the aircraft that are ``present``, bool
    ``[...]``; those of before are dead-reckoned.
    """
    state = map_leaves(lambda field: np.where(present, field, 0.0), reports.state)
    reports = reports._replace(state=state)
    first = begin(reports)
    if sightings is None:
        return Sightings(first, np.where(present, time, -np.inf))
    elapsed = time - sightings.time
    flown = np.clip(elapsed, _SAME, _SILENCE)
    new = present & (elapsed > _SAME)
    new &= ~repeats(sightings.tracks.newest.state, state, flown, np)
    extended, jumps = extend(sightings.tracks, reports, flown)
    if np.any(jumps & new):
        extended = map_leaves(
            lambda restarted, old: np.where(jumps, restarted, old), restart(extended), extended
        )
    recent = elapsed <= _SILENCE
    tracks = map_leaves(
        lambda old, extended, first: np.where(new, np.where(recent, extended, first), old),
        sightings.tracks,
        extended,
        first,
    )
    return Sightings(tracks, np.where(new, time, sightings.time))


def plausible_turn(turn_rate: Array, least: float, most: float, xp: ArrayModule = np) -> Array:
    """Return the turn rates that count, rad/s, ``[...]``.

    What turns by less than the least rate flies straight; what seems to turn a little faster than
    an aircraft can turns as fast as it can.
    """
    return xp.where(xp.abs(turn_rate) >= least, xp.clip(turn_rate, -most, most), 0.0)


TURN_STEPS = 15.0
"""Time steps after its report for which a turn is expected to go on; seconds where nobody knows the
time step of an aircraft."""

# rad, 10 degrees: one sigma of the course at the end of a turn that is expected to go on.
_COURSE = 0.175
_STEADY = 1e-9  # rad/s that divide nothing


def lasting(turn_rate: Array, turn_std: Array, turn_time: Array, xp: ArrayModule = np) -> Array:
    """Return for how long turns are expected to go on, s, ``[...]``: for a time, s, at most, but
    only as long as the course at their end is known within 10 degrees; 0 where they are none.

    Args:
        turn_rate: rad/s; 0: straight flight.
        turn_std: one sigma of it, rad/s.
        turn_time: s.
    """
    known = xp.where(
        turn_std * turn_time <= _COURSE, turn_time, _COURSE / xp.maximum(turn_std, _STEADY)
    )
    return xp.where(turn_rate != 0.0, known, 0.0)
