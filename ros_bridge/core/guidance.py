"""What a display shows beside the plan: bands by true directions, and the alerts of intruders.

Pure: the monitor's verdict, and the alerts of the second before, as input; numbers as the message
``GuidanceBands`` has them as output.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting, Alerts, no_alerts, rearrange, regions, update
from agents.assurance.area_bands import area_losses
from agents.assurance.bands import (
    HEADINGS,
    Bands,
    heading_bands,
    losses_on_course,
    recovery,
    speed_bands,
)
from agents.assurance.single import Verdict
from agents.assurance.state import Decision
from agents.assurance.thresholds import BLIND, Thresholds
from agents.planner.areas import Counted, label
from envs.angles import wrap
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.fields import SECOND

TRACKS = np.arange(HEADINGS) * (360.0 / HEADINGS)
"""Directions that are looked at, degrees clockwise from true north."""


class Shown(NamedTuple):
    """The alerts of the intruders that the monitor knows, by place, and of the areas after them."""

    names: tuple[tuple[str, str], ...]  # "intruder" or "area", and what it is called
    alerts: Alerts  # [1, K]
    time: int | None = None  # ns, when they were looked at; None: never


class Row(NamedTuple):
    """Bands of one kind; -1 stands for a loss that there is not."""

    target: list[float]
    region: list[int]
    loss: list[float]
    area: list[int]  # place in the areas of the one that closes it; -1: traffic does, or it is free


class Guidance(NamedTuple):
    """What is published."""

    look_ahead: float  # s
    tracks: Row  # targets in degrees clockwise from true north
    speeds: Row
    recovery: int  # number of the track; -1: some is free
    recovery_time: float  # s; -1: not within the look-ahead
    recovery_shortfall: float  # m
    intruders: tuple[str, ...]
    levels: list[int]
    losses: list[float]  # s; -1: none
    areas: tuple[str, ...]  # that close a band, or lie on the present course, by their labels
    area_levels: list[int]
    area_losses: list[float]  # s, on the present course; -1: none


def blank(thresholds: Thresholds) -> Shown:
    """Return that no intruder has been looked at."""
    return Shown((), no_alerts(1, 0, Alerting.for_aircraft(thresholds.options.aircraft)))


def guidance(
    shown: Shown,
    names: tuple[str, ...],
    verdict: Verdict,
    now: int,
    frame: LocalFrame,
    thresholds: Thresholds,
) -> tuple[Shown, Guidance | None]:
    """Return what is shown at a time, ns; None where the ownship's state is unknown, and within a
    time step of the last time. A clock that steps back begins anew.

    ``names`` are those of the monitor's intruders, by place.
    """
    measured, step = verdict.measured, thresholds.options.aircraft.dt * SECOND
    if shown.time is not None and 0 <= now - shown.time < step:
        return shown, None
    if int(measured.causes[0]) & BLIND:
        return shown, None
    own, traffic, requirement = measured.own, measured.traffic, thresholds.requirement
    aircraft = thresholds.options.aircraft
    alerting = Alerting.for_aircraft(aircraft)
    look_ahead, limits = alerting.look_ahead, thresholds.manoeuvre
    turn = float(frame.geodetic(own.x, own.y).convergence[0])
    headings = heading_bands(
        own,
        traffic,
        requirement,
        limits,
        look_ahead,
        wrap(0.5 * math.pi - np.radians(TRACKS) + turn, np),
        measured.areas,
    )
    speeds = speed_bands(own, traffic, requirement, limits, look_ahead, areas=measured.areas)
    met = _areas_met(shown, measured, (headings, speeds), requirement.margin, look_ahead)
    losses = losses_on_course(own, traffic, requirement, look_ahead)
    alerts, every = _alerts(shown, (names, losses, traffic.mask), met, now, alerting)
    way_out = recovery(headings, aircraft.separation)
    number = int(way_out.index[0])
    known = [k for k in range(len(names)) if traffic.mask[0, k]]
    places = {area.number: place for place, (area, _) in enumerate(met)}
    found = Guidance(
        look_ahead,
        _row(TRACKS, headings, alerting, aircraft.separation, places),
        _row(speeds.target[0], speeds, alerting, aircraft.separation, places),
        number,
        _or_never(float(way_out.opens[0])) if number >= 0 else 0.0,
        -float(way_out.clearance[0]) if number >= 0 else 0.0,
        tuple(names[k] for k in known),
        alerts.level[0, known].tolist(),
        [_or_never(loss) for loss in losses[0, known].tolist()],
        tuple(label(area) for area, _ in met),
        alerts.level[0, len(names) :].tolist(),
        [_or_never(loss) for _, loss in met],
    )
    return Shown(every, alerts, now), found


def _areas_met(
    shown: Shown, measured: Decision, bands: tuple[Bands, Bands], margin: float, look_ahead: float
) -> list[tuple[Counted, float]]:
    """Return the areas that close a band or lie on the present course, or whose alert is shown, and
    when their clearance is lost on that course, s; inf: not within the look-ahead.
    """
    areas = measured.areas[0]
    losses = area_losses(measured.own, areas, margin, look_ahead)
    closing = {int(number) for one in bands for number in np.unique(one.area)}
    level = zip(shown.names, shown.alerts.level[0], strict=True)
    raised = {name for (_, name), code in level if code}
    return [
        (area, loss)
        for area, loss in zip(areas, losses, strict=True)
        if math.isfinite(loss) or area.number in closing or label(area) in raised
    ]


def _alerts(
    shown: Shown,
    intruders: tuple[tuple[str, ...], np.ndarray, np.ndarray],
    met: list[tuple[Counted, float]],
    now: int,
    alerting: Alerting,
) -> tuple[Alerts, tuple[tuple[str, str], ...]]:
    """Return the alerts of intruders (names, losses in s and which exist, ``[1, K]``) and of areas
    after them, and whose they are.
    """
    names, losses, mask = intruders
    called = (*(("intruder", name) for name in names), *(("area", label(one)) for one, _ in met))
    places = [shown.names.index(one) if one in shown.names else -1 for one in called]
    before = rearrange(shown.alerts, places, alerting)
    every = np.concatenate([losses, [[loss for _, loss in met]]], axis=1)
    there = np.concatenate([mask, np.ones((1, len(met)), dtype=bool)], axis=1)
    return update(before, np.array([now / SECOND]), every, there, alerting), called


def _row(
    targets: np.ndarray,
    bands: Bands,
    alerting: Alerting,
    separation: float,
    places: dict[int, int],
) -> Row:
    return Row(
        targets.tolist(),
        regions(bands, alerting, separation)[0].tolist(),
        [_or_never(loss) for loss in bands.loss[0].tolist()],
        [places.get(number, -1) for number in bands.area[0].tolist()],
    )


def _or_never(time: float) -> float:
    return time if math.isfinite(time) else -1.0
