"""What a display shows beside the plan: bands by true directions, and the alerts of intruders.

Pure: the monitor with its assessment, and the alerts of the second before, as input; numbers as the
message ``GuidanceBands`` has them as output.
"""

import math
from collections.abc import Mapping
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.alerts import (
    Alerting,
    Alerts,
    no_alerts,
    rearrange,
    regions,
    shown_losses,
    update,
)
from agents.assurance.bands import (
    HEADINGS,
    Bands,
    area_losses,
    heading_bands,
    losses_on_course,
    recovery,
    speed_bands,
)
from agents.assurance.single import Assessment
from agents.assurance.thresholds import BLIND, Thresholds
from agents.assurance.vertical_bands import (
    altitude_bands,
    altitudes_of,
    layers,
    vertical_speed_bands,
)
from agents.kernel.areas import ActiveArea, label
from agents.kernel.traffic import Traffic
from agents.planner.request.options import L, Narrowed
from envs.angles import wrap
from envs.arrays import Array, Bool, Float, Shaped
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.assurance import Supervision
from ros_bridge.core.conversions import ALTITUDE_NUMBERS
from ros_bridge.core.fields import SECOND

TRACKS = np.arange(HEADINGS) * (360.0 / HEADINGS)
"""Directions that are looked at, degrees clockwise from true north."""


class Kind(Enum):
    """What an alert is about."""

    INTRUDER = "intruder"
    AREA = "area"


class Subject(NamedTuple):
    """An intruder or an area, and what it is called."""

    kind: Kind
    name: str


class Shown(NamedTuple):
    """The alerts of the intruders that the monitor knows, by place, and of the areas after them."""

    subjects: tuple[Subject, ...]
    alerts: Alerts  # [1, K]
    time: int | None = None  # ns, when they were looked at; None: never


class Row(NamedTuple):
    """Bands of one kind, by their targets."""

    target: tuple[float, ...]
    region: tuple[int, ...]  # codes of Region
    # when the separation is lost by its manoeuvre or one half-way to the next, s; -1: it is kept
    loss: tuple[float, ...]
    # place in the areas of the one that closes it; -1: traffic does, or it is free
    area: tuple[int, ...]

    def fields(self, kind: str, target: str = "") -> dict[str, Any]:
        """Return the fields of a kind of bands; ``target`` is the name of theirs where it is
        another.
        """
        parts = {f"{kind}_{name}": getattr(self, name) for name in ("region", "loss", "area")}
        return {target or kind: self.target, **parts}


class VerticalRows(NamedTuple):
    """Bands up and down, heading and speed held."""

    speeds: Row  # vertical speeds, m/s, positive upwards
    altitudes: Row  # m
    reference: str  # what altitudes are above, as of agents.kernel.levels.Altitude


class Guidance(NamedTuple):
    """What is published."""

    time: int  # from which the manoeuvres begin, ns
    look_ahead: float  # s
    tracks: Row  # targets in degrees clockwise from true north
    speeds: Row
    recovery: int  # number of the track; -1: some is free
    recovery_time: float  # s; -1: not within the look-ahead
    recovery_shortfall: float  # m
    # alert level and time to loss on the present course, s or -1 for none, by intruder
    levels: Mapping[str, tuple[int, float]]
    # the same of those that close a band or lie on that course, by label, in order of their places
    areas: Mapping[str, tuple[int, float]]
    # None: plans may not climb and descend, or the own altitude or vertical speed is unknown
    vertical: VerticalRows | None = None

    def fields(self) -> dict[str, Any]:
        """Return the fields of a ``GuidanceBands`` that hold this, without its header."""
        fields = {name: getattr(self, name) for name in _PLAIN}
        fields |= self.tracks.fields("track", "track_deg") | self.speeds.fields("speed")
        fields |= _level_fields("intruder", self.levels) | _level_fields("area", self.areas)
        if self.vertical is not None:
            speeds, altitudes, reference = self.vertical
            fields |= speeds.fields("vertical_speed") | altitudes.fields("altitude")
            fields["altitude_reference"] = ALTITUDE_NUMBERS[reference]
        return fields


_PLAIN = ("look_ahead", "recovery", "recovery_time", "recovery_shortfall")


def _level_fields(kind: str, levels: Mapping[str, tuple[int, float]]) -> dict[str, Any]:
    return {
        f"{kind}_ids": list(levels),
        f"{kind}_level": [level for level, _ in levels.values()],
        f"{kind}_loss": [loss for _, loss in levels.values()],
    }


def blank(thresholds: Thresholds[L]) -> Shown:
    """Return that no intruder has been looked at."""
    return Shown((), no_alerts(1, 0, Alerting.for_aircraft(thresholds.options.aircraft)))


class _OnCourse(NamedTuple):
    """What an ownship meets that goes on as now, but for its course or its speed."""

    traffic: Traffic  # [1, K T]: each intruder once for each time in which it counts
    times: int  # for how many of these there is room, T
    areas: Shaped[Array, "1"]  # objects


class _Vertical(NamedTuple):
    """What one ownship would meet by each vertical speed and altitude."""

    speeds: Bands  # [1, B]
    altitudes: Bands
    separation: float  # m
    reference: str
    areas: Shaped[Array, "1"]  # objects


class _Look(NamedTuple):
    """What one ownship would meet by each band's manoeuvre and on its present course."""

    headings: Bands  # [1, B]
    speeds: Bands
    # of the separation from each intruder on that course, s; inf: none
    losses: Float[Array, "1 K"]
    present: Bool[Array, "1 K"]  # which intruders exist
    areas: Shaped[Array, "1"]  # objects: those that count on it
    vertical: _Vertical | None  # None: no such bands

    @property
    def closing(self) -> set[int]:
        """Numbers of the areas that close a band; -1 among them says nothing."""
        bands = [self.headings, self.speeds]
        if self.vertical is not None:
            bands += [self.vertical.speeds, self.vertical.altitudes]
        return {int(number) for kind in bands for number in np.unique(kind.area)}


class _MetArea(NamedTuple):
    """An area that is shown."""

    area: ActiveArea
    loss: (
        float  # when its clearance is lost on the present course, s; inf: not within the look-ahead
    )


def guidance(before: Shown, supervision: Supervision, moment: int) -> tuple[Shown, Guidance | None]:
    """Return what is shown at a time, ns; None where the ownship's state is unknown, and within a
    time step of the last time. A clock that steps back begins anew.

    ``supervision`` is the monitor as it was when it came to its assessment.
    """
    assessment, frame, names = supervision.assessment, supervision.frame, supervision.names
    if assessment is None or frame is None:
        return before, None
    thresholds = supervision.thresholds_in_air
    measured, aircraft = assessment.measured, thresholds.options.aircraft
    if before.time is not None and 0 <= moment - before.time < aircraft.dt * SECOND:
        return before, None
    if int(measured.causes[0]) & BLIND:
        return before, None
    alerting = Alerting.for_aircraft(aircraft)
    look = _look(assessment, frame, thresholds, alerting.look_ahead)
    met_areas = _areas_met(
        before, assessment, look, thresholds.requirement.margin, alerting.look_ahead
    )
    after = _alerts(before, names, look, met_areas, moment, alerting)
    return after, _guidance(
        names, look, met_areas, after.alerts, alerting, aircraft.separation, moment
    )


def _look(
    assessment: Assessment, frame: LocalFrame, thresholds: Thresholds[Narrowed], look_ahead: float
) -> _Look:
    own, on_course = assessment.measured.own, _on_course(assessment)
    requirement, limits = thresholds.requirement, thresholds.manoeuvre
    convergence = float(frame.geodetic(own.x, own.y).convergence[0])
    targets = wrap(0.5 * math.pi - np.radians(TRACKS) + convergence, np)
    traffic, areas = on_course.traffic, on_course.areas
    losses = losses_on_course(own, traffic, requirement, look_ahead)
    return _Look(
        heading_bands(own, traffic, requirement, limits, look_ahead, targets, areas),
        speed_bands(own, traffic, requirement, limits, look_ahead, areas=areas),
        losses.reshape(1, -1, on_course.times).min(axis=-1),
        assessment.measured.traffic.mask,
        areas,
        _vertical(assessment, thresholds, look_ahead),
    )


def _on_course(assessment: Assessment) -> _OnCourse:
    """Return what counts where the ownship goes on up or down as it flies."""
    measured, in_height = assessment.measured, assessment.in_height
    if in_height is None:
        return _OnCourse(measured.traffic, 1, measured.areas)
    met = in_height.space.find_met(in_height.flight)
    return _OnCourse(met.columns(measured.traffic), met.times, met.areas)


def _vertical(
    assessment: Assessment, thresholds: Thresholds[Narrowed], look_ahead: float
) -> _Vertical | None:
    """Return the bands up and down; None where an altitude or a climb is unknown."""
    in_height = assessment.in_height
    if in_height is None or in_height.own is None or in_height.own.vertical_speed is None:
        return None
    options, measured, space = thresholds.options, assessment.measured, in_height.space
    altitudes = altitudes_of(in_height.own, space.reports, options)
    areas = space.areas_met(())
    shut = layers(
        measured.own,
        measured.traffic,
        thresholds.requirement,
        altitudes,
        look_ahead,
        areas,
        options.floor,
        options.ceiling,
    )
    return _Vertical(
        vertical_speed_bands(shut, altitudes, options.vertical, look_ahead),
        altitude_bands(shut, altitudes, options.vertical, look_ahead),
        options.vertical_separation,
        altitudes.reference,
        areas,
    )


def _areas_met(
    previous: Shown, assessment: Assessment, look: _Look, margin: float, look_ahead: float
) -> list[_MetArea]:
    """Return the areas that close a band or lie on the present course, or whose alert is shown."""
    active = look.areas[0] if look.vertical is None else (*look.areas[0], *look.vertical.areas[0])
    # An area counts once for each of its times, or for bands up and down alone.
    losses = {area.number: _MetArea(area, math.inf) for area in active}
    on_course = area_losses(assessment.measured.own, look.areas[0], margin, look_ahead)
    for area, loss in zip(look.areas[0], on_course, strict=True):
        losses[area.number] = min(
            losses[area.number], _MetArea(area, loss), key=lambda area_loss: area_loss.loss
        )
    levels = zip(previous.subjects, previous.alerts.level[0], strict=True)
    raised = {subject for subject, level in levels if level}
    return [
        area_loss
        for number, area_loss in sorted(losses.items())
        if math.isfinite(area_loss.loss)
        or number in look.closing
        or _subject(area_loss.area) in raised
    ]


def _subject(area: ActiveArea) -> Subject:
    return Subject(Kind.AREA, label(area))


def _alerts(
    before: Shown,
    names: tuple[str, ...],
    look: _Look,
    met_areas: list[_MetArea],
    moment: int,
    alerting: Alerting,
) -> Shown:
    """Return the alerts of the intruders and of the areas after them, at a time, ns."""
    subjects = (
        *(Subject(Kind.INTRUDER, name) for name in names),
        *(_subject(met.area) for met in met_areas),
    )
    places = [
        before.subjects.index(subject) if subject in before.subjects else -1 for subject in subjects
    ]
    previous = rearrange(before.alerts, places, alerting)
    losses = np.concatenate([look.losses, [[met.loss for met in met_areas]]], axis=1)
    present = np.concatenate([look.present, np.ones((1, len(met_areas)), dtype=bool)], axis=1)
    alerts = update(previous, np.array([moment / SECOND]), losses, present, alerting)
    return Shown(subjects, alerts, moment)


def _guidance(
    names: tuple[str, ...],
    look: _Look,
    met_areas: list[_MetArea],
    alerts: Alerts,
    alerting: Alerting,
    separation: float,
    moment: int,
) -> Guidance:
    """Return what a look found at a time, ns, as it is published."""
    losses = [*look.losses[0].tolist(), *(met.loss for met in met_areas)]
    levels = [*zip(alerts.level[0].tolist(), map(_or_never, losses), strict=True)]
    places = {met.area.number: place for place, met in enumerate(met_areas)}
    way_out = recovery(look.headings, separation)
    number = int(way_out.index[0])
    has_free_course = number < 0
    return Guidance(
        time=moment,
        look_ahead=alerting.look_ahead,
        tracks=_row(TRACKS, look.headings, alerting, separation, places),
        speeds=_row(look.speeds.target[0], look.speeds, alerting, separation, places),
        recovery=number,
        recovery_time=0.0 if has_free_course else _or_never(float(way_out.opens[0])),
        recovery_shortfall=0.0 if has_free_course else -float(way_out.clearance[0]),
        levels={
            name: level
            for name, level, exists in zip(names, levels, look.present[0], strict=False)
            if exists
        },
        areas={label(met.area): levels[len(names) + n] for n, met in enumerate(met_areas)},
        vertical=None if look.vertical is None else _vertical_rows(look.vertical, alerting, places),
    )


def _vertical_rows(vertical: _Vertical, alerting: Alerting, places: dict[int, int]) -> VerticalRows:
    speeds, altitudes = (
        _row(bands.target[0], bands, alerting, vertical.separation, places)
        for bands in (vertical.speeds, vertical.altitudes)
    )
    return VerticalRows(speeds, altitudes, vertical.reference)


def _row(
    targets: Float[Array, " B"],
    bands: Bands,
    alerting: Alerting,
    separation: float,
    places: dict[int, int],
) -> Row:
    """Return bands ``[1, B]`` as they are published; ``places`` are those of areas by number."""
    return Row(
        tuple(targets.tolist()),
        tuple(regions(bands, alerting, separation)[0].tolist()),
        tuple(_or_never(loss) for loss in shown_losses(bands)[0].tolist()),
        tuple(places.get(number, -1) for number in bands.area[0].tolist()),
    )


def _or_never(time: float) -> float:
    return time if math.isfinite(time) else -1.0
