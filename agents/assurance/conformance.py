"""How a flight conforms to its plan, and its intruders to what the plan expected of them."""

from typing import Any

import numpy as np

from agents.assurance.areas import rest
from agents.assurance.inputs import Memory
from agents.assurance.lookahead import Course, outlook
from agents.assurance.state import Monitor, State
from agents.assurance.thresholds import BLIND, WANTING, Cause, Thresholds
from agents.planner.traffic import Traffic, predict, requirement_of, separations, uncertainty
from envs.follower import deviation
from envs.kinematics import VehicleState, velocity
from envs.relative import distance

# sigmas of what the plan expected and of what is believed now by which an intruder may also be off
_NOISE = 3.0
_REPORTS = (
    Cause.INTRUDER_MISSING | Cause.INTRUDER_OUT_OF_ORDER
)  # causes that do not lie in the plan


def has(causes: Any, any_of: Cause) -> Any:
    """Return where any of some causes holds, bool ``[N]``."""
    return (causes & int(any_of)) != 0


def required_separations(plan: Course, traffic: Traffic, thresholds: Thresholds) -> Any:
    """Return the separations that plans made against some intruders were required to keep, m, ``[N,
    K]``.
    """
    return requirement_of(
        traffic,
        VehicleState(*(field[:, 0] for field in plan.plan_states[:4])),
        thresholds.requirement,
    )


def floor(required_separation: Any, traffic: Traffic, thresholds: Thresholds) -> Any:
    """Return the predicted separation from intruders below which a plan with this required
    separation is no longer good, m, ``[N, K]``.
    """
    return np.maximum(
        separations(traffic, thresholds.requirement),
        required_separation - thresholds.separation_band,
    )


def follows_plan(monitor: Monitor) -> Any:
    """Return which rows fly a plan, bool ``[N]``."""
    return (monitor.state != State.IDLE) & ~monitor.on_backup


def judge(
    monitor: Monitor,
    memory: Memory,
    own: VehicleState,
    traffic: Traffic,
    causes: Any,
    thresholds: Thresholds,
) -> tuple[Any, Any, dict[str, Any]]:
    """Measure the present second against the plan; a cause begins beyond its threshold and ends
    below a share of it.

    Monitors are of the second before, all else of the present one, ``[N]`` and of the intruders
    ``[N, K]``.

    Returns:
        The leaky sums ``[N, 3]``, all causes ``[N]``, and what was measured, by the names of a
        decision's fields.
    """
    on = follows_plan(monitor)
    since = memory.time - monitor.started
    off = deviation(monitor.plan.legs, own, since)
    errors = np.abs(np.stack([off.cross_track, off.along_track, off.time], axis=-1))
    limits = np.array([thresholds.cross_track, thresholds.along_track, thresholds.time_error])
    seen = ~has(causes, BLIND)
    elapsed = memory.time - monitor.memory.time
    sums = _leaky_sums(monitor.sums, errors, elapsed, seen, thresholds)
    sums = np.where(on[:, None], sums, 0.0)

    def latch(value: Any, limit: Any, cause: Cause) -> Any:
        beyond = value > np.where(has(monitor.causes, cause), thresholds.leave * limit, limit)
        return np.where(on & beyond, int(cause), 0)

    for column, cause in enumerate((Cause.CROSS_TRACK, Cause.ALONG_TRACK, Cause.TIME_ERROR)):
        causes = causes | latch(errors[:, column], limits[column], cause)
    lasting = np.max(sums / (thresholds.sustained * thresholds.memory * limits), axis=-1)
    causes = causes | latch(lasting, 1.0, Cause.ACCUMULATED)
    causes = causes | latch(
        thresholds.plan_ending - (monitor.plan.plan_states.time[:, -1] - since),
        0.0,
        Cause.PLAN_ENDING,
    )

    offset = np.hypot(off.cross_track, off.along_track)
    separation, loss, close = _outlook(monitor, own, traffic, since, offset, thresholds)
    causes = causes | np.where(on & close, int(Cause.SEPARATION), 0)
    amid = rest(monitor.plan, since, memory.areas, offset, thresholds)
    causes = causes | np.where(on & amid.lost, int(Cause.AREA), 0)
    position, speed, noise = _deviations(monitor, traffic, since)
    share = np.maximum(
        position / (thresholds.intruder_position + _NOISE * noise[0]),
        speed / (thresholds.intruder_velocity + _NOISE * noise[1]),
    )
    share = np.where(_of_concern(separation, traffic, thresholds), share, 0.0)
    causes = causes | latch(np.max(share, axis=-1, initial=0.0), 1.0, Cause.INTRUDER_DEVIATION)
    causes = np.where(on, causes, causes & ~int(WANTING & ~_REPORTS)).astype(np.int32)
    measured = {
        "cross_track": off.cross_track,
        "along_track": off.along_track,
        "time_error": off.time,
        "intruder_position": np.max(position, axis=-1, initial=0.0),
        "intruder_velocity": np.max(speed, axis=-1, initial=0.0),
        "separation": np.min(separation, axis=-1, initial=np.inf) - offset,
        "loss": np.minimum(loss, amid.loss),
        "area_deficit": amid.deficit,
        "area": amid.area,
    }
    return sums, causes, measured


def _leaky_sums(before: Any, errors: Any, elapsed: Any, seen: Any, thresholds: Thresholds) -> Any:
    """Return the sums ``[N, 3]`` after some seconds ``[N]``, not finite at first; errors count
    where the ownship was seen.
    """
    finite = np.isfinite(elapsed)
    seconds = np.where(finite, elapsed, 0.0)[:, None]
    added = np.where((seen & finite)[:, None], errors * seconds, 0.0)
    return before * np.exp(-seconds / thresholds.memory) + added


def _of_concern(separation: Any, traffic: Traffic, thresholds: Thresholds) -> Any:
    """Return which intruders come so near that they must fly as expected, bool ``[N, K]``."""
    usual = thresholds.requirement.separation
    more = separations(traffic, thresholds.requirement) - usual
    return separation < thresholds.concern + more


def _outlook(
    monitor: Monitor,
    own: VehicleState,
    traffic: Traffic,
    since: Any,
    offset: Any,
    thresholds: Thresholds,
) -> tuple[Any, Any, Any]:
    """Return the rest's separations ``[N, K]``, when they are lost and whether they are too small,
    ``[N]``.
    """
    requirement = thresholds.requirement
    planned = np.where(
        monitor.expected.mask,
        required_separations(monitor.plan, monitor.expected, thresholds),
        np.inf,
    )
    least = floor(
        np.minimum(planned, requirement_of(traffic, own, requirement)), traffic, thresholds
    )
    # The present distance of the ownship from its plan may last: it is taken off.
    off = offset[:, None]
    had = has(monitor.causes, Cause.SEPARATION)[:, None]
    edge = np.where(had, least + thresholds.separation_band, least - thresholds.resolution)
    edge = np.maximum(edge, separations(traffic, requirement) - thresholds.resolution + off)
    # A plan that is not flown needs no closer look.
    level = np.where(follows_plan(monitor)[:, None], edge, -np.inf)
    ahead = outlook(monitor.plan, since, traffic, level, requirement.sigmas)
    close = ((ahead.separation < edge) & traffic.mask).any(axis=-1)
    return ahead.separation, np.min(ahead.loss, axis=-1, initial=np.inf), close


def _deviations(monitor: Monitor, traffic: Traffic, since: Any) -> tuple[Any, Any, tuple[Any, Any]]:
    """Return how far intruders are from what the plan expected, m and m/s, inf for new ones, and
    one sigma of both.
    """
    expected = monitor.expected
    there = predict(expected, since[:, None])
    there = there._replace(speed=expected.state.speed)
    position = distance(traffic.state.x - there.x, traffic.state.y - there.y, np)
    (vx, vy), (to_vx, to_vy) = velocity(traffic.state, np), velocity(there, np)
    speed = distance(vx - to_vx, vy - to_vy, np)

    def where_known(error: Any) -> Any:
        return np.where(traffic.mask, np.where(expected.mask, error, np.inf), 0.0)

    place = np.hypot(uncertainty(expected, since[:, None]), uncertainty(traffic, 0.0))
    return (
        where_known(position),
        where_known(speed),
        (place, np.hypot(expected.velocity_std, traffic.velocity_std)),
    )
