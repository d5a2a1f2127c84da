"""Estimates of an aircraft after each of its reports: :mod:`agents.assurance.tracker` on the ellipsoid.

The estimate is a report itself, with its own standard deviations, so that planner and monitor use it like any report.
Where reports declare no noise, or begin anew, it is the report, to the bit.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.assurance.tracker import Tracks, begin, follow
from envs.formats.local_frame import carried, displacement
from envs.kinematics import VehicleState
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import Report


class Estimate(NamedTuple):
    """An estimate, and what the tracker remembers; its place is the origin of the tracker's map, east and north."""

    report: Report
    tracks: Tracks


def first(report: Report) -> Estimate:
    """Return the estimate from one report."""
    return Estimate(report, begin(_moving(0.0, 0.0, report), report.position_std, report.velocity_std))


def improved(estimate: Estimate, report: Report) -> Estimate:
    """Return the estimate after one more report, later than those before."""
    if report.position_std == 0.0 and report.velocity_std == 0.0:
        return first(report)
    before = estimate.report
    x, y = displacement(*before.place, *report.place)
    tracks = follow(
        estimate.tracks,
        _moving(x, y, report),
        report.position_std,
        report.velocity_std,
        (report.time - before.time) / SECOND,
    )
    if tracks.count == 1.0:
        return first(report)
    x, y, heading, speed = map(float, tracks.state)
    latitude, longitude = carried(*before.place, x, y, 1.0)
    believed = replace(
        report,
        latitude=latitude,
        longitude=longitude,
        east=speed * math.cos(heading),
        north=speed * math.sin(heading),
        position_std=float(np.sqrt(tracks.position_variance)),
        velocity_std=float(np.sqrt(tracks.velocity_variance)),
    )
    here = tracks.state._replace(x=0.0, y=0.0)
    return Estimate(believed, tracks._replace(state=here))


def _moving(x: float, y: float, report: Report) -> VehicleState:
    heading = math.atan2(report.north, report.east)
    return VehicleState(x, y, heading, math.hypot(report.east, report.north))
