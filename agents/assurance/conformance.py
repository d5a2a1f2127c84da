"""How a flight conforms to its plan, and its intruders to what the plan expected of them."""

from typing import NamedTuple

import numpy as np

from agents.assurance.areas import judge_remaining_plans
from agents.assurance.climbs import Met, OnProfile
from agents.assurance.inputs import Memory
from agents.assurance.state import Monitor, State
from agents.assurance.thresholds import BLIND, WANTING, Cause, Thresholds
from agents.kernel.clearance import clearance
from agents.kernel.separation import Separation
from agents.kernel.traffic import Traffic, predict, requirement_of, separations, uncertainty
from agents.kernel.trajectory import Trajectory
from agents.planner.request.options import Narrowed
from envs.arrays import Array, Bool, Float, Int
from envs.follower import Deviation, deviation
from envs.frames import Air
from envs.kinematics import VehicleState, velocity
from envs.relative import distance

# sigmas of what the plan expected and of what is believed now by which an intruder may also be off
_NOISE = 3.0
_REPORTS = (
    Cause.INTRUDER_MISSING | Cause.INTRUDER_OUT_OF_ORDER
)  # causes that do not lie in the plan


def has(causes: Int[Array, " N"], any_of: Cause) -> Bool[Array, " N"]:
    """Return where any of some causes holds."""
    return (causes & int(any_of)) != 0


def required_separations(
    plan: Trajectory[Air], traffic: Traffic, thresholds: Thresholds[Narrowed]
) -> Float[Array, "N K"]:
    """Return the separations that plans made against some intruders were required to keep, m."""
    return requirement_of(
        traffic,
        VehicleState(*(field[:, 0] for field in plan.states[:4])),
        thresholds.requirement,
    )


def floor(
    required_separation: Float[Array, "N K"], traffic: Traffic, thresholds: Thresholds[Narrowed]
) -> Float[Array, "N K"]:
    """Return the predicted separation from intruders below which a plan with this required
    separation is no longer good, m.
    """
    return np.maximum(
        separations(traffic, thresholds.requirement),
        required_separation - thresholds.separation_band,
    )


def follows_plan(monitor: Monitor) -> Bool[Array, " N"]:
    """Return which rows fly a plan."""
    return (monitor.state != State.IDLE) & ~monitor.on_backup


class Measured(NamedTuple):
    """What a second measures against the plan; the fields of a decision of these names, ``[N]``."""

    cross_track: Array
    along_track: Array
    time_error: Array
    altitude_error: Array
    intruder_position: Array
    intruder_velocity: Array
    separation: Array
    loss: Array
    area_deficit: Array
    area: Array
    intruder_causes: Array


class _Latch(NamedTuple):
    """Causes that begin beyond a limit and end below a share of it; fields ``[N]``."""

    before: Array  # causes of the second before
    leave: float  # the share

    def bits(self, value: Array, limit: Array, cause: Cause) -> Array:
        """Return the bit of a cause where a value is beyond, else 0, ``[..., N]``."""
        beyond = value > np.where(has(self.before, cause), self.leave * limit, limit)
        return np.where(beyond, int(cause), 0)


def measure(
    monitor: Monitor,
    memory: Memory,
    own: VehicleState[Air],
    traffic: Traffic,
    causes: Int[Array, " N"],
    of_each: Int[Array, "N K"],
    thresholds: Thresholds[Narrowed],
    on_profile: OnProfile | None = None,
) -> tuple[Array, Array, Measured]:
    """Measure the present second against the plan; a cause begins beyond its threshold and ends
    below a share of it.

    Monitors are of the second before, all else of the present one, ``[N]`` and of the intruders
    ``[N, K]``; ``causes`` do not lie in intruders, ``of_each`` do. Plans that climb are flown
    ``on_profile``, ``[N]``.

    Returns:
        The leaky sums ``[N, 3]``, all causes ``[N]``, and what was measured.
    """
    since = memory.time - monitor.started
    latch = _Latch(monitor.causes, thresholds.leave)
    off = deviation(monitor.plan.legs, own, since)
    sums, of_errors = _judge_errors(monitor, memory, off, ~has(causes, BLIND), latch, thresholds)
    remaining = monitor.plan.end - since
    of_end = latch.bits(thresholds.plan_ending - remaining, 0.0, Cause.PLAN_ENDING)

    offset = np.hypot(off.cross_track, off.along_track)
    of_altitude, altitude_error = _judge_altitude(on_profile, latch, since.size)
    met = None if on_profile is None else on_profile.met
    areas = memory.areas if met is None else met.areas
    separation, loss, close = _look_ahead(monitor, own, traffic, since, offset, thresholds, met)
    of_separation = np.where(close, int(Cause.SEPARATION), 0)
    from_areas = judge_remaining_plans(monitor.plan, since, areas, offset, thresholds)
    of_areas = np.where(from_areas.lost, int(Cause.AREA), 0)

    deviations = _deviations(monitor, traffic, since)
    concern = _of_concern(separation, traffic, thresholds)
    share = np.where(concern, deviations.share_of(thresholds), 0.0)
    of_deviation = latch.bits(share.T, 1.0, Cause.INTRUDER_DEVIATION).T  # a row is a monitor's
    # Of a plan that is not flown only reports are wanted.
    counts = np.where(follows_plan(monitor), -1, ~int(WANTING & ~_REPORTS))
    of_each = ((of_each | of_separation | of_deviation) & counts[:, None]).astype(np.int32)
    causes = (causes | of_errors | of_altitude | of_end | of_areas) & counts
    return (
        sums,
        (causes | np.bitwise_or.reduce(of_each, axis=-1)).astype(np.int32),
        Measured(
            cross_track=off.cross_track,
            along_track=off.along_track,
            time_error=off.time,
            altitude_error=altitude_error,
            intruder_position=np.max(deviations.position, axis=-1, initial=0.0),
            intruder_velocity=np.max(deviations.velocity, axis=-1, initial=0.0),
            separation=np.min(separation, axis=-1, initial=np.inf) - offset,
            loss=np.minimum(loss, from_areas.loss),
            area_deficit=from_areas.deficit,
            area=from_areas.area,
            intruder_causes=of_each,
        ),
    )


def _judge_errors(
    monitor: Monitor,
    memory: Memory,
    off: Deviation,
    sighted: Array,
    latch: _Latch,
    thresholds: Thresholds[Narrowed],
) -> tuple[Array, Array]:
    """Return the leaky sums of the errors against the plan ``[N, 3]``, and the causes that lie in
    errors and sums, ``[N]``; ``sighted`` says where the ownship was seen, bool.
    """
    errors = np.abs(np.stack([off.cross_track, off.along_track, off.time], axis=-1))
    limits = np.array([thresholds.cross_track, thresholds.along_track, thresholds.time_error])
    elapsed = memory.time - monitor.memory.time
    sums = _leaky_sums(monitor.sums, errors, elapsed, sighted, thresholds)
    lasting = np.max(sums / (thresholds.sustained * thresholds.memory * limits), axis=-1)
    causes = latch.bits(lasting, 1.0, Cause.ACCUMULATED)
    for column, cause in enumerate((Cause.CROSS_TRACK, Cause.ALONG_TRACK, Cause.TIME_ERROR)):
        causes |= latch.bits(errors[:, column], limits[column], cause)
    return sums, causes


def _judge_altitude(on_profile: OnProfile | None, latch: _Latch, count: int) -> tuple[Array, Array]:
    """Return the cause that lies in the altitude of so many ownships, and its error, m, ``[N]``."""
    if on_profile is None:
        return np.zeros(count, dtype=int), np.full(count, np.nan)
    error, allowed = on_profile.error, on_profile.allowed
    return latch.bits(np.abs(error), allowed, Cause.ALTITUDE_ERROR), error


def _leaky_sums(
    before: Array, errors: Array, elapsed: Array, sighted: Array, thresholds: Thresholds[Narrowed]
) -> Array:
    """Return the sums ``[N, 3]`` after some seconds ``[N]``, not finite at first; errors count
    where the ownship was seen.
    """
    finite = np.isfinite(elapsed)
    seconds = np.where(finite, elapsed, 0.0)[:, None]
    added = np.where((sighted & finite)[:, None], errors * seconds, 0.0)
    return before * np.exp(-seconds / thresholds.memory) + added


def _of_concern(separation: Array, traffic: Traffic, thresholds: Thresholds[Narrowed]) -> Array:
    """Return which intruders come so near that they must fly as expected, bool ``[N, K]``."""
    usual = thresholds.requirement.separation
    more = separations(traffic, thresholds.requirement) - usual
    return separation < thresholds.concern + more


def _look_ahead(
    monitor: Monitor,
    own: VehicleState[Air],
    traffic: Traffic,
    since: Array,
    offset: Array,
    thresholds: Thresholds[Narrowed],
    met: Met | None,
) -> tuple[Array, Array, Array]:
    """Return the rest's separations ``[N, K]``, when the first is lost ``[N]``, and which are too
    small, bool ``[N, K]``; an intruder that is met several times keeps the least of them.
    """
    requirement, (count, others) = thresholds.requirement, traffic.mask.shape
    planned = np.where(
        monitor.expected.mask,
        required_separations(monitor.plan, monitor.expected, thresholds),
        np.inf,
    )
    if met is not None:
        traffic, planned = met.columns(traffic), met.repeat(planned)
    least = floor(
        np.minimum(planned, requirement_of(traffic, own, requirement)), traffic, thresholds
    )
    # The present distance of the ownship from its plan may last: it is taken off.
    off = offset[:, None]
    active = has(monitor.causes, Cause.SEPARATION)[:, None]
    edge = np.where(active, least + thresholds.separation_band, least - thresholds.resolution)
    edge = np.maximum(edge, separations(traffic, requirement) - thresholds.resolution + off)
    # A plan that is not flown needs no closer look.
    level = np.where(follows_plan(monitor)[:, None], 0.0, -np.inf)
    clearances = clearance(
        monitor.plan.since(since), Separation(traffic, edge, None, requirement.sigmas), level
    )
    by_time = count, others, 1 if met is None else met.times
    close = (clearances.margin < 0.0).reshape(by_time).any(axis=-1)
    loss = np.min(np.where(np.isfinite(level), clearances.loss, np.inf), axis=-1, initial=np.inf)
    return (edge + clearances.margin).reshape(by_time).min(axis=-1), loss, close


class _Deviations(NamedTuple):
    """How far intruders are from what the plan expected, inf for new ones; fields ``[N, K]``."""

    position: Array  # m
    velocity: Array  # m/s
    position_std: Array  # one sigma of what was expected and is believed now, m
    velocity_std: Array  # m/s

    def share_of(self, thresholds: Thresholds[Narrowed]) -> Array:
        """Return which share of what is allowed the greater of the two is."""
        place = thresholds.intruder_position + _NOISE * self.position_std
        motion = thresholds.intruder_velocity + _NOISE * self.velocity_std
        return np.maximum(self.position / place, self.velocity / motion)


def _deviations(monitor: Monitor, traffic: Traffic, since: Array) -> _Deviations:
    """Return how far intruders ``[N, K]`` are from what the plan expected, ``since`` seconds after
    it was requested, ``[N]``.
    """
    expected = monitor.expected
    predicted = predict(expected, since[:, None])
    position = distance(traffic.state.x - predicted.x, traffic.state.y - predicted.y, np)
    (vx, vy), (to_vx, to_vy) = velocity(traffic.state, np), velocity(predicted, np)
    change = distance(vx - to_vx, vy - to_vy, np)
    new = ~expected.mask
    position, change = (
        np.where(traffic.mask, np.where(new, np.inf, error), 0.0) for error in (position, change)
    )
    return _Deviations(
        position,
        change,
        np.hypot(uncertainty(expected, since[:, None]), uncertainty(traffic, 0.0)),
        np.hypot(expected.velocity_std, traffic.velocity_std),
    )
