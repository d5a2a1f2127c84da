"""What an aircraft does not report counts as the worst that is plausible, in every reader.

Each scene is an aircraft whose truth is known, reported with some of the optional fields: it is read,
made a task of, and put to the planner's own check of the request. The worst that the fields left open
is worked out here, from the scene.
"""

import itertools
import json
import math
import os
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.kernel.levels import vertical_gap
from agents.planner.answer import AdvisoryCode
from agents.planner.request.advisories import assumed_climbs
from agents.planner.request.request import Altitude, Intruder, check_request
from envs.kinematics import VehicleState
from envs.traffic.track_units import FOOT, KNOT
from ros_bridge.core import conversions, message_fields
from ros_bridge.core.adapters import adsb_vehicle
from ros_bridge.core.feeds.aircraft_json import AircraftJson
from ros_bridge.core.feeds.base_station import BaseStation
from ros_bridge.core.feeds.traffic import Traffic
from ros_bridge.core.fields import FieldError, Refusal
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import PlanTask, task
from ros_bridge.core.tracks import UNKNOWN, note_refused, take_in
from tests.ros_bridge.scenes import (
    FRAME,
    NOW,
    OPTIONS,
    RULES,
    SECOND,
    SETTINGS,
    aircraft,
    situation_after,
    stamp,
)

READERS = ("AircraftState", "mavros", "aircraft.json", "BaseStation")
FIELDS = ("altitude", "climb", "position_std", "velocity_std", "age")
CHOICES = [
    frozenset(left_out)
    for count in range(len(FIELDS) + 1)
    for left_out in itertools.combinations(FIELDS, count)
]
DRAWN = int(os.environ.get("FUZZ_SCENES", "2500"))  # scenes in all
SCENES = DRAWN // (len(READERS) * len(CHOICES)) + 1
OWN_HEIGHT = 1_500.0  # m, pressure
NACP, NACV = 9, 2  # 95 % within 30 m and 3 m/s
_SIGMA = math.sqrt(-2.0 * math.log(0.05))


class Scene(NamedTuple):
    """One aircraft as it is, at the time of its position."""

    x: float  # m in the local frame
    y: float
    track: float  # rad clockwise from north
    speed: float  # m/s
    height: float  # m, pressure
    climb: float  # m/s
    age: float  # s


def draw_scene(rng: np.random.Generator) -> Scene:
    """Return an aircraft near the edges of what is left out, vertically."""
    return Scene(
        rng.uniform(-20_000.0, 20_000.0),
        rng.uniform(3_000.0, 20_000.0),
        rng.uniform(0.0, 2.0 * math.pi),
        float(rng.uniform(50.0, 120.0)),
        OWN_HEIGHT + float(rng.uniform(-1_400.0, 12_000.0)),
        float(rng.choice([0.0, rng.uniform(-9.0, 9.0)])),
        float(rng.uniform(0.0, 2.0)),
    )


def read(reader: str, scene: Scene, unsaid: frozenset[str]) -> Report | FieldError:
    """Return what a reader makes of a scene of which some fields are not said."""
    at = FRAME.geodetic(scene.x, scene.y)
    latitude, longitude = float(at.latitude), float(at.longitude)
    if reader == "AircraftState":
        return _of_message(scene, unsaid)
    if reader == "mavros":
        flags = 1 | 4 | 8 | 2 * ("altitude" not in unsaid) | 128 * ("climb" not in unsaid)
        message = SimpleNamespace(
            header=SimpleNamespace(stamp=stamp(NOW)),
            icao_address=0x4B1A2C,
            callsign="",
            emitter_type=1,
            flags=flags,
            tslc=SimpleNamespace(sec=int(scene.age), nanosec=0),
            latitude=latitude,
            longitude=longitude,
            heading=math.degrees(scene.track),
            hor_velocity=scene.speed,
            ver_velocity=scene.climb,
            altitude=scene.height,
            altitude_type=0,
        )
        outcome = adsb_vehicle(message, {0: "pressure"})
        assert outcome is not None
        return outcome
    row: dict[str, Any] = {"hex": "4b1a2c", "lat": latitude, "lon": longitude}
    row |= {"gs": scene.speed / KNOT, "track": math.degrees(scene.track)}
    optional = {
        "altitude": ("alt_baro", scene.height / FOOT),
        "climb": ("baro_rate", scene.climb / FOOT * 60.0),
        "position_std": ("nac_p", NACP),
        "velocity_std": ("nac_v", NACV),
        "age": ("seen_pos", scene.age),
    }
    row |= dict(pair for name, pair in optional.items() if name not in unsaid)
    if reader == "aircraft.json":
        live = AircraftJson(Traffic("0wn"))
        first = json.dumps({"now": 0.0, "aircraft": []})
        assert list(live.reports_of(first, NOW - SECOND)) == []
        [outcome] = live.reports_of(json.dumps({"now": 1.0, "aircraft": [row]}), NOW)
        return outcome
    live = BaseStation(Traffic("0wn"))
    day = "" if "age" in unsaid else "2026/01/01"
    values = [str(row.get(name, "")) for name in ("alt_baro", "gs", "track")]
    rate = str(row.get("baro_rate", ""))
    numbers = f"{values[0]},{values[1]},{values[2]},{latitude},{longitude},{rate},,,,,0"
    clock = "" if "age" in unsaid else "12:00:00.000"
    [outcome] = live.reports_of(f"MSG,3,1,1,4B1A2C,1,{day},{clock},{day},{clock},,{numbers}", NOW)
    return outcome


def _of_message(scene: Scene, unsaid: frozenset[str]) -> Report | FieldError:
    bits = {
        "altitude": conversions.ALTITUDE,
        "climb": conversions.VERTICAL_SPEED,
        "position_std": conversions.POSITION_STD,
        "velocity_std": conversions.VELOCITY_STD,
    }
    valid = conversions.POSITION | conversions.VELOCITY
    valid |= sum(bit for name, bit in bits.items() if name not in unsaid)
    message = aircraft(scene.x, scene.y, 0.5 * math.pi - scene.track, scene.speed, valid=valid)
    message.header.stamp = stamp(NOW - round(scene.age * SECOND))
    message.altitude, message.altitude_reference = scene.height, 3
    message.velocity.z = scene.climb
    message.position_std, message.velocity_std = 30.0 / _SIGMA, 3.0 / _SIGMA
    return conversions.aircraft(message, "intruder 4b1a2c")


def situation_of(outcome: Report | FieldError) -> Situation:
    """Return a situation with what was read, and an ownship whose altitude and climb are known."""
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", valid=0xC5 | 0x0A)
    own.altitude, own.altitude_reference = OWN_HEIGHT, 3
    situation = situation_after(own=own)
    if isinstance(outcome, FieldError):
        track = note_refused(UNKNOWN, outcome, NOW, RULES)
    else:
        track = take_in(UNKNOWN, outcome, "intruder 4b1a2c", NOW, RULES)
    return replace(situation, traffic={"4b1a2c": track})


def out(requested: PlanTask) -> bool:
    """Return whether the planner leaves the intruder out."""
    _, excluded, _ = check_request(
        requested.own,
        requested.intruders,
        requested.points,
        requested.options,
        requested.own_altitude,
    )
    return bool(excluded)


def end(requested: PlanTask) -> float:
    """Return until when the planner looks, s."""
    high = Altitude(20_000.0, "pressure", 0.0)
    far = Intruder(VehicleState(0.0, 9e5, 0.0, 75.0), altitude=high)
    _, [excluded], _ = check_request(
        requested.own, [far], requested.points, requested.options, requested.own_altitude
    )
    return excluded.until


def nearest(scene: Scene, climbs: tuple[float, ...], horizon: float) -> float:
    """Return the smallest vertical distance over the horizon at any of some climbs, m."""
    least = math.inf
    for climb in climbs:
        # From the oldest to the youngest that the report may be, on to the plan's end.
        first, last = (scene.height + climb * t - OWN_HEIGHT for t in (0.0, scene.age + horizon))
        least = min(least, 0.0 if first * last <= 0.0 else min(abs(first), abs(last)))
    return least


@pytest.mark.parametrize("reader", READERS)
def test_no_aircraft_is_left_out_that_the_worst_case_brings_near(reader: str) -> None:
    rng = np.random.default_rng(51)
    worst, horizon = (
        OPTIONS.unknown_climb,
        end(task(situation_of(read(reader, draw_scene(rng), CHOICES[0])), NOW, SETTINGS)),
    )
    judged = dict.fromkeys(("in", "out", "refused"), 0)
    for unsaid in CHOICES:
        for _ in range(SCENES):
            scene = draw_scene(rng)
            try:
                requested = task(situation_of(read(reader, scene, unsaid)), NOW, SETTINGS)
            except Refusal as refusal:
                assert "age" in unsaid and reader in ("aircraft.json", "BaseStation"), refusal
                judged["refused"] += 1
                continue
            if not requested.identifiers:  # sighted at some time of the last minute, and far away
                assert "age" in unsaid and "altitude" not in unsaid
                climbs = (-worst, scene.climb, worst) if "climb" in unsaid else (scene.climb,)
                assert nearest(scene, climbs, horizon) > OPTIONS.vertical_filter
                judged["out"] += 1
                continue
            assert requested.identifiers == ("4b1a2c",)
            left_out = out(requested)
            judged["out" if left_out else "in"] += 1
            climbs = (-worst, scene.climb, worst) if "climb" in unsaid else (scene.climb,)
            if left_out:
                assert "altitude" not in unsaid
                assert nearest(scene, climbs, horizon) > OPTIONS.vertical_filter - 0.1
            elif not unsaid & {"altitude", "climb"}:
                # All that matters is known: nobody is kept in for fear. Receivers that round the
                # age leave a second of climb open.
                assert nearest(scene, climbs, horizon) < OPTIONS.vertical_filter + 10.0
            _spread(reader, scene, unsaid, requested)
            _says(reader, unsaid, requested)
    assert judged["out"] > SCENES and judged["in"] > SCENES
    assert (judged["refused"] > SCENES) == (reader in ("aircraft.json", "BaseStation"))


def _spread(reader: str, scene: Scene, unsaid: frozenset[str], requested: PlanTask) -> None:
    """Check the standard deviations that are planned with: those said, or else those assumed."""
    [intruder] = requested.intruders
    never = {
        "mavros": {"position_std", "velocity_std"},
        "BaseStation": {"position_std", "velocity_std"},
    }
    unsaid = unsaid | never.get(reader, set())
    position, velocity = SETTINGS.unknown.position_std, SETTINGS.unknown.velocity_std
    position = position if "position_std" in unsaid else 30.0 / _SIGMA
    velocity = velocity if "velocity_std" in unsaid else 3.0 / _SIGMA
    if reader == "mavros":
        position = math.hypot(position, scene.speed / math.sqrt(3.0))
    assert intruder.position_std == pytest.approx(position, rel=1e-3)
    assert intruder.velocity_std == pytest.approx(velocity, rel=1e-3)


def _says(reader: str, unsaid: frozenset[str], requested: PlanTask) -> None:
    """Check that every assumption is said, and no other."""
    advisories = [
        *requested.notes,
        *assumed_climbs(requested.own_altitude, requested.intruders, requested.options),
    ]
    fields = {
        str(advisory.field) for advisory in advisories if advisory.code is AdvisoryCode.ASSUMED
    }
    expected = {
        f"intruders[0].{name}"
        for name in ("position_std", "velocity_std")
        if name in unsaid or reader in ("mavros", "BaseStation")
    }
    if "climb" in unsaid and "altitude" not in unsaid:
        expected.add("intruders[0].altitude.vertical_speed")
    assert fields == expected


@pytest.mark.parametrize("reader", READERS)
def test_a_recording_of_the_display_leaves_open_what_was_not_said(reader: str) -> None:
    rng = np.random.default_rng(54)
    for unsaid in CHOICES:
        outcome = read(reader, draw_scene(rng), unsaid)
        report = outcome.sighting if isinstance(outcome, FieldError) else outcome
        assert report is not None
        fields = message_fields.aircraft(report)
        velocity = SimpleNamespace(**({"x": 0.0, "y": 0.0} | fields.pop("velocity")))
        header = SimpleNamespace(stamp=SimpleNamespace(**fields.pop("header")["stamp"]))
        message = aircraft(0.0, 0.0, 0.0, 0.0, header=header, velocity=velocity, **fields)
        if isinstance(report, Report):
            assert conversions.aircraft(message, "recorded") == report
            continue
        with pytest.raises(FieldError) as refused:
            conversions.aircraft(message, "recorded")
        assert refused.value.sighting == report


def test_an_own_climb_that_is_unknown_counts_either_way() -> None:
    rng = np.random.default_rng(52)
    for _ in range(DRAWN // 5):
        scene = draw_scene(rng)
        situation = situation_of(read("AircraftState", scene, frozenset()))
        own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", valid=0xC5 | 0x02)
        own.altitude, own.altitude_reference = OWN_HEIGHT, 3
        own.header.stamp = stamp(NOW - SECOND)
        situation = replace(situation, own=situation_after(own=own).own)
        requested = task(situation, NOW, SETTINGS)
        if out(requested):
            later = scene.height + scene.climb * (scene.age + end(requested)) - OWN_HEIGHT
            reach = OPTIONS.unknown_climb * (1.0 + end(requested))
            assert abs(later) - reach > OPTIONS.vertical_filter - 0.1


def test_the_vertical_gap_is_the_least_over_all_that_is_possible() -> None:
    rng = np.random.default_rng(53)
    for _ in range(2_000):
        own, intruder = (
            Altitude(
                float(rng.uniform(0.0, 3_000.0)),
                "msl",
                None if rng.random() < 0.5 else float(rng.uniform(-9.0, 9.0)),
                float(rng.choice([0.0, 50.0])),
            )
            for _ in range(2)
        )
        age, horizon = float(rng.uniform(0.0, 5.0)), 60.0
        gap = vertical_gap(own, intruder, age, horizon, 10.0)
        for _ in range(20):
            rates = [
                rng.uniform(-10.0, 10.0)
                if altitude.vertical_speed is None
                else altitude.vertical_speed
                for altitude in (own, intruder)
            ]
            off = [rng.uniform(-altitude.error, altitude.error) for altitude in (own, intruder)]
            for t in np.linspace(0.0, horizon, 4):
                mine = own.value + off[0] + rates[0] * t
                theirs = intruder.value + off[1] + rates[1] * (age + t)
                assert abs(theirs - mine) >= abs(gap) - 1e-6
