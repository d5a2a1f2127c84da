"""What a display shows beside the plan: bands by true directions, and the alerts of intruders.

Pure: the monitor's verdict, and the alerts of the second before, as input; numbers as the message
``GuidanceBands`` has them as output.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting, Alerts, no_alerts, rearrange, regions, update
from agents.assurance.bands import (
    HEADINGS,
    Bands,
    heading_bands,
    losses_on_course,
    recovery,
    speed_bands,
)
from agents.assurance.single import Verdict
from agents.assurance.thresholds import BLIND, Thresholds
from envs.angles import wrap
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.fields import SECOND

TRACKS = np.arange(HEADINGS) * (360.0 / HEADINGS)
"""Directions that are looked at, degrees clockwise from true north."""


class Shown(NamedTuple):
    """The alerts of the intruders that the monitor knows, by place."""

    names: tuple[str, ...]
    alerts: Alerts  # [1, K]
    time: int | None = None  # ns, when they were looked at; None: never


class Row(NamedTuple):
    """Bands of one kind; -1 stands for a loss that there is not."""

    target: list[float]
    region: list[int]
    loss: list[float]


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
    )
    speeds = speed_bands(own, traffic, requirement, limits, look_ahead)
    losses = losses_on_course(own, traffic, requirement, look_ahead)
    places = [shown.names.index(name) if name in shown.names else -1 for name in names]
    before = rearrange(shown.alerts, places, alerting)
    alerts = update(before, np.array([now / SECOND]), losses, traffic.mask, alerting)
    way_out = recovery(headings, aircraft.separation)
    number = int(way_out.index[0])
    known = [k for k in range(len(names)) if traffic.mask[0, k]]
    found = Guidance(
        look_ahead,
        _row(TRACKS, headings, alerting, aircraft.separation),
        _row(speeds.target[0], speeds, alerting, aircraft.separation),
        number,
        _or_never(float(way_out.opens[0])) if number >= 0 else 0.0,
        -float(way_out.clearance[0]) if number >= 0 else 0.0,
        tuple(names[k] for k in known),
        alerts.level[0, known].tolist(),
        [_or_never(loss) for loss in losses[0, known].tolist()],
    )
    return Shown(names, alerts, now), found


def _row(targets: np.ndarray, bands: Bands, alerting: Alerting, separation: float) -> Row:
    return Row(
        targets.tolist(),
        regions(bands, alerting, separation)[0].tolist(),
        [_or_never(loss) for loss in bands.loss[0].tolist()],
    )


def _or_never(time: float) -> float:
    return time if math.isfinite(time) else -1.0
