"""The table of flights: a row a flight; docs/reference/evaluation-files.md says what each column
means.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.trajectory import straight
from agents.planner.search.climbs import climbed
from agents.policy.inference import Policy
from agents.resolvability.classify import Verdict, classify
from envs.follower import PERIOD
from envs.outcome import Rules
from eval.flights.among_areas import nearest
from eval.flights.conditions import conditions
from eval.flights.plan_flight import SUBSTEPS
from eval.flights.plan_mode import SOURCES, STATUSES
from eval.hifi.config import HifiConfig
from eval.hifi.flight import Flight, straight_separation
from eval.hifi.flights import Campaign, FlightRecord, fly_one, report_at_start
from eval.hifi.pilots import Assured
from eval.runner.outputs import RunFolder

HIFI_OUTCOMES = ("reached", "violation", "timeout", "failed", "refused")
"""How a flight can end, among areas also by a ``breach``: ``failed`` is an aircraft lost,
``refused`` one that never began, both with a reason.
"""

_NAN = math.nan


class PlanErrors(NamedTuple):
    """Errors of a flight against its plan, by the names of their columns."""

    cross_track_rms_m: float = _NAN
    cross_track_max_m: float = _NAN
    along_track_max_m: float = _NAN
    late_max_s: float = _NAN
    position_error_max_m: float = _NAN
    position_error_to_goal_m: float = _NAN
    accumulated_m_s: float = _NAN  # integral of the position error over the flight, m s
    path_definition_max_m: float = _NAN
    total_error_max_m: float = _NAN
    altitude_error_max_m: float = _NAN


class UpAndDown(NamedTuple):
    """What plans that may climb are up and down, by the names of columns."""

    plan_climbed_m: float  # metres climbed and descended
    altitude_deviation_m: float  # largest distance of the flight from the altitude of its start


class UnderMonitor(NamedTuple):
    """What a flight in mode assured, where plans may climb, was up and down, by the names of
    columns.
    """

    climbing_backup_s: int  # on backups that climb or descend
    # largest distance from the lines of what was flown, plans and backups, m
    altitude_error_max_m: float
    backup_altitude_error_max_m: float  # the same of backups alone; nan: none was flown


class PlanLoss(NamedTuple):
    """Whether a SAFE plan that lost the separation had promised it, by the names of columns."""

    plan_loss: str
    promised_min_separation_m: float


_NO_LOSS = PlanLoss("", _NAN)

ERRORS = PlanErrors._fields
"""Columns of the errors against the plan."""


def columns(prepared: tuple[Campaign, Policy], first: int, count: int) -> dict[str, np.ndarray]:
    """Return the table of the flights ``first .. first + count - 1`` of
    :func:`eval.hifi.flights.prepare`.
    """
    campaign, policy = prepared
    numbers = range(first, first + count)
    rows = [row_of(campaign, number, fly_one(campaign, policy, number)) for number in numbers]
    kinds = {name: object if isinstance(value, str) else None for name, value in rows[0].items()}
    return {name: np.array([row[name] for row in rows], kind) for name, kind in kinds.items()}


def row_of(campaign: Campaign, number: int, record: FlightRecord) -> dict[str, Any]:
    """Return the row of one flight."""
    row: dict[str, Any] = {"flight": number}
    row |= _outcome(record, campaign.aircraft.rules())
    if campaign.areas:
        row |= _among_areas(record, row, campaign.aircraft.rules())
    row |= _plan(campaign, record)
    row |= _errors(record)._asdict()
    if campaign.options.climbs:
        row |= _up_and_down(record)._asdict()
    if campaign.mode == "plan":
        lost = row["outcome"] == "violation" and row["plan_status"] == "safe"
        row |= (_loss(campaign, record) if lost else _NO_LOSS)._asdict()
    if campaign.mode == "assured":
        pilot = record.pilot if isinstance(record.pilot, Assured) else None
        row["replans"] = pilot.replans if pilot else 0
        row["taken_up"] = pilot.taken_up if pilot else 0
        row["backup_s"] = pilot.backup_seconds if pilot else 0
        if campaign.options.climbs:
            row |= _under_monitor(record, pilot)._asdict()
    return row | _scene(campaign, record)


class _End(NamedTuple):
    """How a flight ended."""

    outcome: str  # of HIFI_OUTCOMES
    duration: float  # s
    reason: str = ""


def _outcome(record: FlightRecord, rules: Rules) -> dict[str, Any]:
    """Judge a flight as the surrogate's are: until the time limit, and a lost separation outweighs
    the goal.
    """
    flight = record.flight
    if flight is None:
        missing = dict.fromkeys(
            ("duration_s", "min_separation_m", "time_of_min_separation_s", "goal_distance_m"), _NAN
        )
        return {"outcome": "refused", "reason": record.problem or ""} | missing
    seconds = min(round(rules.t_max), flight.separation.size)
    apart, near = flight.separation[:seconds], flight.goal_distance[: seconds * SUBSTEPS + 1]
    end = _end(record, flight, apart, near, rules)
    return {
        "outcome": end.outcome,
        "reason": end.reason,
        "duration_s": float(end.duration),
        "min_separation_m": float(apart.min(initial=np.inf)) if apart.size else _NAN,
        "time_of_min_separation_s": float(np.argmin(apart) + 1) if apart.size else _NAN,
        "goal_distance_m": float(near.min()),
    }


def _end(
    record: FlightRecord, flight: Flight, apart: np.ndarray, near: np.ndarray, rules: Rules
) -> _End:
    """Return how a flight ended, by its separation in each second until the time limit, ``[S]``,
    and its distance from the goal at the start and after every period, ``[P + 1]``, m.
    """
    lost = np.flatnonzero(apart < rules.separation)
    if lost.size:
        second = lost[0] + 1
        return _End("violation", float(second), f"{apart[lost[0]]:.0f} m in second {second}")
    if flight.failure is not None and flight.separation.size < rules.t_max:
        return _End("failed", flight.separation.size, flight.failure)
    at_goal = np.flatnonzero(near[1:] <= rules.goal_radius)
    if not at_goal.size:
        return _End("timeout", rules.t_max, f"{near.min():.0f} m from the goal at best")
    unsafe = record.initial is not None and not record.initial.plans.candidates.safe[0]
    if unsafe and not isinstance(record.pilot, Assured):
        # Refusing is no success, even where the advisory trajectory arrives.
        return _End("timeout", rules.t_max, "the plan is not safe")
    return _End("reached", (at_goal[0] + 1) * PERIOD)


def _among_areas(record: FlightRecord, row: dict[str, Any], rules: Rules) -> dict[str, Any]:
    """Return what of a row areas change, and what they add: a breach ends a flight as a lost
    separation does, where it comes first.
    """
    flight, closest = record.flight, (np.inf, _NAN)
    if flight is not None:
        periods = slice(0, round(rules.t_max) * SUBSTEPS + 1)
        x, y = flight.own.x[None, periods], flight.own.y[None, periods]
        if x.size > 1:  # straight on within a period
            flown = straight(x, y, PERIOD * np.arange(x.size)[None])
            closest = nearest(record.scene.areas, flown)
    distance, breach = closest
    columns: dict[str, Any] = {
        "areas": len(record.scene.areas),
        "min_area_clearance_m": distance if math.isfinite(distance) else _NAN,
        "area_breach_s": breach,
    }
    if math.isfinite(breach) and not (
        row["outcome"] == "violation" and row["duration_s"] <= breach
    ):
        reason = f"{-distance:.0f} m into the clearance of an area"
        columns |= {"outcome": "breach", "reason": reason, "duration_s": breach}
    return columns


def _plan(campaign: Campaign, record: FlightRecord) -> dict[str, Any]:
    """Say what was planned, whether such a plan is possible, and what of its separation was lost
    over its whole.
    """
    initial = (
        record.initial
        if record.initial is not None and record.initial.request is not None
        else None
    )
    planned = (
        _NAN if record.initial is None else float(record.initial.plans.candidates.min_separation[0])
    )
    whole, distance = _NAN, _NAN
    if record.flight is not None and record.errors is not None:
        whole = float(record.flight.separation.min(initial=np.inf))
        if record.scene.levels is None:  # else the planned one is of those that may be level
            distance = float(record.flight.distance.min(initial=np.inf))
    return {
        "plan_status": "none"
        if initial is None
        else STATUSES[int(initial.plans.candidates.safe[0])],
        "plan_source": "none" if initial is None else SOURCES[int(initial.plans.source[0])],
        "plan_min_separation_m": _NAN if initial is None else planned,
        "plan_rejoin_s": _NAN
        if initial is None
        else float(initial.plans.candidates.rejoin_time[0]),
        "verdict": _separability(campaign, record),
        "whole_min_separation_m": whole,
        "separation_loss_m": planned - distance,
    }


def _loss(campaign: Campaign, record: FlightRecord) -> PlanLoss:
    """Say whether a SAFE plan that lost the separation had promised it.

    SAFE promises a separation from intruders that go on straight from the report that the plan was
    made with. Where the flight as it was flown keeps it from those, an intruder left its reported
    motion (or its report was wrong), which no plan promises to survive.
    """
    rules, flight = campaign.aircraft.rules(), record.flight
    assert flight is not None
    reported = report_at_start(campaign, record.scene)
    seconds = round(rules.t_max)
    mask, distance_scale = record.scene.encounter.mask, record.scene.distance_scale
    levels = record.scene.levels
    apart = straight_separation(flight, reported, mask, seconds, distance_scale, levels)
    promised = float(apart.min(initial=np.inf))
    kind = "not_promised" if promised >= rules.separation else "broken"
    return PlanLoss(kind, promised)


def _separability(campaign: Campaign, record: FlightRecord) -> str:
    """Say whether the separation that the plan must keep can be kept at all, within the limits of
    its legs; where plans climb nothing is proven unresolvable.
    """
    options = campaign.options
    required = options.requirement.separation + options.requirement.margin
    rules = campaign.aircraft.rules()._replace(separation=required)
    solved = record.initial is not None and bool(record.initial.plans.candidates.safe[0])
    limits = campaign.options.limits
    begins = limits.speed_min <= float(record.scene.encounter.own.speed[0]) <= limits.speed_max
    if not begins and not solved:
        return "outside"
    if options.climbs:
        return (Verdict.RESOLVABLE if solved else Verdict.UNDECIDED).name.lower()
    encounter = record.scene.encounter
    if encounter.separation is not None:
        least = encounter.separation + options.requirement.margin
        encounter = encounter._replace(separation=least)
    judged = classify(encounter, rules, limits, solved=np.array([solved]))
    return Verdict(int(judged.verdict[0])).name.lower()


def _errors(record: FlightRecord) -> PlanErrors:
    """Return the errors against the plan; nan where there is none or it was not flown to
    its end.
    """
    errors, flight = record.errors, record.flight
    if errors is None or flight is None or record.legs is None or flight.failure is not None:
        return PlanErrors()
    # The last second of a flight may lie beyond the plan's end.
    end = record.legs.time[-1] + record.legs.duration[-1]
    planned = PERIOD * np.arange(errors.late.size) <= end + 1e-9
    position = errors.position[planned]
    cross, along = np.abs(errors.cross_track[planned]), np.abs(errors.along_track[planned])
    late = np.abs(errors.late[planned])
    altitude = np.abs(flight.altitude - held_altitude(record, flight.altitude.size).altitude)
    assert record.initial is not None
    rejoin = float(record.initial.plans.candidates.rejoin_time[0])
    to_goal = position[: int(rejoin / PERIOD) + 1] if math.isfinite(rejoin) else np.empty(0)
    return PlanErrors(
        cross_track_rms_m=math.sqrt(float(np.mean(cross**2))),
        cross_track_max_m=float(cross.max()),
        along_track_max_m=float(along.max()),
        late_max_s=float(late.max()),
        position_error_max_m=float(position.max()),
        position_error_to_goal_m=_largest(to_goal),
        accumulated_m_s=float(PERIOD * position.sum()),
        path_definition_max_m=_largest(errors.definition),
        total_error_max_m=_largest(errors.total),
        altitude_error_max_m=float(altitude.max()),
    )


class HeldAltitude(NamedTuple):
    """Altitudes of what was flown, plans and backups, at the start and after every period; fields
    ``[T + 1]``.
    """

    altitude: np.ndarray  # m; that of the start where there is no profile
    backup: np.ndarray  # whether it is that of a backup, bool


def held_altitude(record: FlightRecord, count: int) -> HeldAltitude:
    """Return the altitudes of what was flown, ``[count]``."""
    time = PERIOD * np.arange(count)
    altitude, backup = np.full(count, record.scene.drawn.altitude), np.zeros(count, dtype=bool)
    for held in () if record.pilot is None else record.pilot.held:
        later = time > held.since  # at that time the aircraft was still flying the one before
        altitude[later], backup[later] = held.profile.at(time[later]), held.backup
    return HeldAltitude(altitude, backup)


def _under_monitor(record: FlightRecord, pilot: Assured | None) -> UnderMonitor:
    """Return what a flight under the monitor was up and down; nan where there was none."""
    flight = record.flight
    climbing = 0 if pilot is None else pilot.climbing_seconds
    if flight is None or flight.failure is not None:
        return UnderMonitor(climbing, _NAN, _NAN)
    held = held_altitude(record, flight.altitude.size)
    error = np.abs(flight.altitude - held.altitude)
    return UnderMonitor(climbing, float(error.max()), _largest(error[held.backup]))


def _up_and_down(record: FlightRecord) -> UpAndDown:
    """Return what a plan and its flight are up and down; nan where there is none."""
    profile, flight = None if record.initial is None else record.initial.profile, record.flight
    off = None if flight is None else flight.altitude - record.scene.drawn.altitude
    return UpAndDown(
        plan_climbed_m=_NAN if profile is None else climbed(profile),
        altitude_deviation_m=_NAN if off is None else float(np.abs(off).max()),
    )


def _largest(values: np.ndarray) -> float:
    """Return the largest of some values, nan where there are none."""
    return float(values.max()) if values.size else _NAN


def _scene(campaign: Campaign, record: FlightRecord) -> dict[str, Any]:
    scene = record.scene
    met, begun = scene.drawn, conditions(scene.encounter, campaign.aircraft)
    del begun["route_length_m"]
    loading, wind, believed = met.air.loading, scene.wind, scene.frame
    return {
        "weight_lb": loading.weight,
        "centre_of_gravity": loading.centre_of_gravity,
        "inertia_factor": loading.inertia_factor,
        "drag_factor": loading.drag_factor,
        "lift_slope_factor": loading.lift_slope_factor,
        "altitude_m": met.altitude,
        "wind_east_m_s": wind.east,
        "wind_north_m_s": wind.north,
        "wind_m_s": math.hypot(wind.east, wind.north),
        "wind_error_m_s": math.hypot(believed.east - wind.east, believed.north - wind.north),
        "turbulence": met.air.turbulence,
        "latency_s": met.latency,
        **{name: column[0].item() for name, column in begun.items()},
    }


class HifiFolder(RunFolder):
    """The files of one run of flights."""

    model = HifiConfig
    table = "flights.parquet"
    schema = b"hifi 2"
