"""Reports in and out of order: what is taken, what is passed over, what is a fault and
until when.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.request.request import Altitude
from envs import kinematics
from envs.formats.local_frame import LocalFrame
from envs.kinematics import SURROGATE, VehicleState
from envs.tracking import single
from envs.tracking.tracker import Belief, Reports, Tracks
from envs.wind import Wind
from ros_bridge.core import courses
from ros_bridge.core.conversions import aircraft as read
from ros_bridge.core.fields import FieldError
from ros_bridge.core.motion import expected_turn, turn_of
from ros_bridge.core.tracks import (
    UNKNOWN,
    ReportCheck,
    Rules,
    Track,
    follow,
    forget_silent,
    note_refused,
    sharing,
    take_in,
)
from tests.ros_bridge.scenes import NOW, SECOND, SETTINGS, aircraft

RULES = Rules()
FAST = SURROGATE._replace(yaw_rate_max=1.0)
START = VehicleState(np.float64(0.0), np.float64(0.0), np.float64(0.3), np.float64(75.0))


def report(seconds: float, x: float | None = None, y: float = 0.0):
    """Return a report of an aircraft that flies eastwards at 80 m/s and was at the origin
    at NOW.
    """
    return read(
        aircraft(
            80.0 * seconds if x is None else x, y, 0.0, 80.0, time=NOW + round(seconds * SECOND)
        ),
        "it",
    )


def feed(*reports, now: float = 0.0) -> tuple[Track, list[ReportCheck]]:
    track, checks = UNKNOWN, []
    for newest in reports:
        track = take_in(track, newest, "it", max(newest.time, NOW + round(now * SECOND)), RULES)
        checks.append(track.check)
    return track, checks


def test_reports_in_order_are_taken():
    track, checks = feed(report(0.0), report(1.0), report(2.0))
    assert checks == [ReportCheck.TAKEN] * 3
    assert track.last == report(2.0)
    assert track.fault is None
    assert track.age(NOW + 3 * SECOND) == pytest.approx(1.0)


def test_repeated_and_late_reports_change_nothing_but_the_counts():
    track, checks = feed(report(0.0), report(1.0), report(1.0), report(0.0))
    assert checks == [
        ReportCheck.TAKEN,
        ReportCheck.TAKEN,
        ReportCheck.DUPLICATE,
        ReportCheck.REORDERED,
    ]
    assert track.last == report(1.0)
    assert track.fault is None
    assert track.counts == {
        ReportCheck.TAKEN: 2,
        ReportCheck.DUPLICATE: 1,
        ReportCheck.REORDERED: 1,
    }


@given(st.lists(st.integers(0, 6), min_size=1, max_size=12))
def test_in_whatever_order_they_come_the_newest_counts(order: list[int]):
    track, _ = feed(*(report(float(second)) for second in order), now=10.0)
    assert track.last == report(float(max(order)))
    assert track.fault is None
    assert sum(track.counts.values()) == len(order)


@given(
    st.lists(st.tuples(st.integers(1, 3), st.floats(-5.0, 5.0)), min_size=1, max_size=8),
    st.sampled_from([0x05, 0xC5]),
)
def test_a_report_that_declares_no_noise_and_agrees_with_its_past_is_believed_as_it_is(
    turns: list[tuple[int, float]], valid: int
):
    track, state_at, seconds = UNKNOWN, START, 0.0
    for step, degrees in turns:
        seconds += step
        state_at = kinematics.advance(state_at, 0.0, math.radians(degrees), float(step), FAST, np)
        state = tuple(float(value) for value in state_at)
        message = aircraft(*state, time=NOW + round(seconds * SECOND), valid=valid)
        newest = read(message, "it")
        track = take_in(track, newest, "it", newest.time, RULES)
        assert track.estimate is not None
        no_turn = {"turn_rate": 0.0, "turn_std": 0.0}
        assert replace(track.estimate, **no_turn) == track.last == newest


@pytest.mark.parametrize("latitude", [0.0, 47.0, -80.0])
def test_errors_of_estimates_are_much_smaller_and_not_above_what_is_said(latitude: float):
    random, frame, errors = np.random.default_rng(4), LocalFrame(latitude, 179.9), []
    for _ in range(60):
        track = UNKNOWN
        for second in range(30):
            x, y, u, v = random.normal(size=4)
            east, north = 60.0 + 3.0 * u, 45.0 + 3.0 * v
            place = 60.0 * second + 30.0 * x, 45.0 * second + 30.0 * y
            spread = {"position_std": 30.0, "velocity_std": 3.0, "valid": 0xC5, "frame": frame}
            message = aircraft(
                *place,
                math.atan2(north, east),
                math.hypot(east, north),
                time=NOW + second * SECOND,
                **spread,
            )
            newest = read(message, "it")
            track = take_in(track, newest, "it", newest.time, RULES)
        assert track.estimate is not None and track.fault is None
        place_of_estimate = frame.place(track.estimate.latitude, track.estimate.longitude)
        east, north = place_of_estimate.velocity(track.estimate.east, track.estimate.north)
        off = (
            float(place_of_estimate.x) - 60.0 * 29,
            float(place_of_estimate.y) - 45.0 * 29,
            float(east) - 60.0,
            float(north) - 45.0,
        )
        spread = track.estimate.position_std, track.estimate.velocity_std
        assert spread[0] < 30.0 and spread[1] <= 3.0
        errors.append(
            [off[0] / spread[0], off[1] / spread[0], off[2] / spread[1], off[3] / spread[1]]
        )
    # 240 numbers of variance 1 if all is as declared: their mean square is 1 within 0.28, three
    # standard deviations. It is less, because a bias that is not significant is covered.
    assert 0.25 < np.mean(np.square(errors)) < 1.28
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 1.4


def test_two_reports_of_one_time_that_differ_are_a_fault():
    track, checks = feed(report(0.0), report(0.0, x=50.0))
    assert checks[-1] is ReportCheck.CONFLICT
    assert track.last == report(0.0)
    assert track.fault is not None and track.fault.message.startswith(
        "it.header.stamp belongs to two reports"
    )


def test_a_report_from_the_future_is_a_fault_until_a_good_one_comes():
    before, _ = feed(report(0.0))
    after = take_in(before, report(2.0), "it", NOW + SECOND, RULES)
    assert after.check is ReportCheck.FUTURE
    assert after.fault is not None and after.fault.message == (
        "it.header.stamp is 1.000 s ahead of the clock, expected 0.5 s at most"
    )
    good = take_in(after, report(1.2), "it", NOW + round(1.2 * SECOND), RULES)
    assert good.fault is None


def test_jump_is_accepted_when_a_second_report_confirms_it():
    track, checks = feed(report(0.0), report(1.0, y=5_000.0))
    assert checks[-1] is ReportCheck.JUMP
    assert track.last == report(0.0)
    assert track.fault is not None and track.fault.field == "it.position"
    confirmed = take_in(track, report(2.0, y=5_000.0), "it", NOW + 2 * SECOND, RULES)
    assert confirmed.check is ReportCheck.TAKEN
    assert confirmed.last == report(2.0, y=5_000.0)
    assert confirmed.fault is None


def test_single_outlier_is_refused():
    track, checks = feed(report(0.0), report(1.0, y=5_000.0), report(2.0))
    assert checks == [ReportCheck.TAKEN, ReportCheck.JUMP, ReportCheck.TAKEN]
    assert track.last == report(2.0)
    # It may be one of two aircraft that report in turns; another good report in a row shows that it
    # is not.
    assert track.fault is not None and track.fault.check is ReportCheck.JUMP
    assert feed(report(0.0), report(1.0, y=5_000.0), report(2.0), report(3.0))[0].fault is None


def take_in_turns(first, second, pattern: str, every: float = 1.0) -> list[Track]:
    """Return the track after each report of two aircraft, called a and b, in the order of a
    pattern.
    """
    track, history = UNKNOWN, []
    for number, turn in enumerate(pattern):
        seconds = every * number
        newest = (first if turn == "a" else second)(seconds)
        track = take_in(track, newest, "it", NOW + round(seconds * SECOND), RULES)
        history.append(track)
    return history


def second_aircraft(seconds: float):
    """Return a report of an aircraft 60 km away that flies westwards."""
    message = aircraft(
        60_000.0 - 80.0 * seconds, 5_000.0, math.pi, 80.0, time=NOW + round(seconds * SECOND)
    )
    return read(message, "it")


@pytest.mark.parametrize(
    ("pattern", "since"),
    # Two reports of one aircraft in a row look like the end of an outlier, or of a jump, the first
    # time only.
    [("ababababab", 1), ("aabaabaaba", 5), ("abbabbabba", 3), ("aabbaabbaa", 4), ("abbbabbbab", 4)],
)
def test_name_of_two_aircraft_is_a_fault_while_both_report(pattern: str, since: int):
    history = take_in_turns(report, second_aircraft, pattern)
    assert all(track.fault is not None for track in history[since:])
    assert history[-1].fault is not None and history[-1].fault.check is ReportCheck.SHARED
    assert history[-1].fault.field == "it.id"


@pytest.mark.parametrize("late", [0.0, 0.4])
def test_two_aircraft_of_one_name_are_found_whatever_their_stamps(late: float):
    track = UNKNOWN
    for second in range(6):
        for newest in (report(float(second)), second_aircraft(second - late)):
            track = take_in(track, newest, "it", NOW + second * SECOND, RULES)
    assert track.fault is not None and track.fault.check is ReportCheck.SHARED


def test_shared_name_is_free_again_when_one_aircraft_falls_silent():
    track = take_in_turns(report, second_aircraft, "abababab")[-1]
    for second in range(8, 50):
        track = take_in(track, report(float(second)), "it", NOW + second * SECOND, RULES)
        silent = second - 7.0
        assert (track.check is ReportCheck.TAKEN) == (silent > RULES.fresh_start)


def follow_in_turns(pattern: str, every: float = 1.0, tracks=None, first: int = 0):
    """Return the tracks of one name after reports of two aircraft, called a and b, in turns."""
    tracks = {} if tracks is None else tracks
    for number, turn in enumerate(pattern, start=first):
        seconds = every * number
        newest = (report if turn == "a" else second_aircraft)(seconds)
        tracks = follow(tracks, "it", newest, NOW + round(seconds * SECOND), RULES)
    return tracks


@pytest.mark.parametrize(
    "pattern", ["ababababab", "aabaabaaba", "abbabbabba", "aabbaabbaabb", "abbbabbbabb"]
)
def test_two_aircraft_of_one_name_are_both_followed(pattern: str):
    tracks = follow_in_turns(pattern)
    assert sharing(tracks, "it") == tuple(tracks) == ("it", "it#2")
    newest = {turn: pattern.rindex(turn) for turn in "ab"}
    last_reports = {report(float(newest["a"])), second_aircraft(float(newest["b"]))}
    assert {track.last for track in tracks.values()} == last_reports
    assert all(track.divided and track.fault is None for track in tracks.values())


def test_of_two_aircraft_of_one_name_one_may_fall_silent_or_be_unusable():
    tracks = follow_in_turns("abababab")
    tracks = follow_in_turns("b" * 40, tracks=tracks, first=8)
    remaining, silent = forget_silent(tracks, NOW + 48 * SECOND, 30.0)
    assert len(remaining) == 1 and len(silent) == 1
    [(name, track)] = remaining.items()
    assert track.last == second_aircraft(47.0)
    assert follow_in_turns("b", tracks=remaining, first=48)[name].last == second_aircraft(48.0)
    # Another place is another aircraft, or a jump that has to be confirmed.
    moved = follow_in_turns("a", tracks=remaining, first=48)
    assert moved[name].last == second_aircraft(47.0)


@given(st.lists(st.sampled_from("abc"), min_size=30, max_size=40))
def test_no_aircraft_of_a_name_is_lost(turns: list[str]):
    """Whatever the order: each of three aircraft is followed where it is, or the name is a
    fault."""
    tracks: dict[str, Track] = {}
    for number, turn in enumerate([*turns, *"abcabcabc"]):
        seconds = 0.3 * number
        offset = 40_000.0 * "abc".index(turn)
        newest = report(seconds, x=offset + 80.0 * seconds)
        tracks = follow(tracks, "it", newest, NOW + round(seconds * SECOND), RULES)
    moment = NOW + round(0.3 * (len(turns) + 9) * SECOND)
    faulty = any(track.fault is not None or track.age(moment) > 5.0 for track in tracks.values())
    assert faulty or len(tracks) == 3


def frozen(seconds: float, moving: float, jitter: float = 0.0):
    """Return a report of an aircraft at 80 m/s whose position stands still after ``moving``
    seconds.
    """
    return report(
        seconds, x=80.0 * min(seconds, moving), y=jitter * (-1.0) ** round(10.0 * seconds)
    )


@pytest.mark.parametrize("every", [0.1, 1.0])
@pytest.mark.parametrize("moving", [0.0, 2.9, 15.0])
@pytest.mark.parametrize("jitter", [0.0, 3.0])
def test_frozen_position_under_fresh_stamps_is_a_fault(every: float, moving: float, jitter: float):
    track, faulty = UNKNOWN, []
    for number in range(round((moving + 40.0) / every)):
        seconds = number * every
        track = take_in(
            track, frozen(seconds, moving, jitter), "it", NOW + round(seconds * SECOND), RULES
        )
        faulty.append((seconds, track.fault is not None))
    since = next(seconds for seconds, bad in faulty if bad)
    assert moving < since <= moving + 5.0
    assert all(bad for seconds, bad in faulty if seconds >= since)
    assert track.fault is not None and track.fault.check is ReportCheck.CONTRADICTION
    assert "outside_domain" in track.fault.message
    assert track.last is not None and track.age(NOW + round((moving + 40.0) * SECOND)) > 34.0


def test_position_that_moves_again_is_accepted_after_some_seconds():
    track = UNKNOWN
    for second in range(30):
        seconds = float(second)
        newest = frozen(seconds, 0.0) if second < 15 else report(seconds)
        track = take_in(track, newest, "it", NOW + second * SECOND, RULES)
    assert track.fault is None and track.last == report(29.0)


@pytest.mark.parametrize("std", [(46.2, 0.0), (46.2, 5.0), (60.0, 5.0)])
def test_frozen_position_is_a_fault_under_declared_noise_too(std: tuple[float, float]):
    track, faulty = UNKNOWN, []
    for second in range(60):
        message = aircraft(0.0, 0.0, 0.0, 80.0, time=NOW + second * SECOND, valid=0xC5)
        message.position_std, message.velocity_std = std
        track = take_in(track, read(message, "it"), "it", NOW + second * SECOND, RULES)
        faulty.append(track.fault is not None)
    assert faulty.index(True) <= 15 and all(faulty[faulty.index(True) :])


@pytest.mark.parametrize(
    ("unit", "turn"),
    [(1_852.0 / 3_600.0, 0.0), (3_600.0 / 1_852.0, 0.0), (1.0, 25.0), (1.0, -25.0), (1.2, 10.0)],
)
@pytest.mark.parametrize("std", [None, 1.0])
def test_a_velocity_that_differs_from_the_places_is_taken_from_them(
    unit: float, turn: float, std: float | None
):
    track = UNKNOWN
    for second in range(20):
        time, heading = NOW + second * SECOND, math.radians(turn)
        message = aircraft(80.0 * second, 0.0, heading, 80.0 * unit, time=time)
        if std is not None:
            message.valid |= 0x05
            message.position_std = message.velocity_std = std
        track = take_in(track, read(message, "it"), "it", time, RULES)
    assert track.fault is None and track.course is not None and track.estimate is not None
    assert (track.estimate.east, track.estimate.north) == pytest.approx((80.0, 0.0), abs=0.5)
    ((field, correction),) = track.course.corrections
    assert field == "velocity" and "taken from positions" in correction
    assert (f"{abs(turn):.0f} deg" in correction) == (turn != 0.0)
    assert (f"{80.0 * (unit - 1.0):+.0f} m/s" in correction) == (unit != 1.0)


@pytest.mark.parametrize("reported_climb", [5.0, -5.0, 0.0, 5.0 / 0.3048])
def test_a_vertical_speed_that_differs_from_the_altitudes_is_taken_from_them(reported_climb: float):
    track = UNKNOWN
    for second in range(30):
        plain = replace(report(float(second)), position_std=5.0)
        altitude = Altitude(
            30.48 * round((900.0 + 5.0 * second) / 30.48), "pressure", reported_climb
        )
        climbing = replace(plain, altitude=altitude)
        track = take_in(track, climbing, "it", climbing.time, RULES)
    assert track.fault is None and track.course is not None and track.estimate is not None
    believed = track.estimate.altitude
    assert believed is not None and track.last is not None
    if reported_climb == 5.0:
        assert believed == track.last.altitude and not track.course.corrections
        return
    assert believed.climb(10.0)[0] == pytest.approx(5.0, abs=believed.climb_error)
    assert 0.0 < believed.climb_error < 2.0
    (correction,) = track.course.corrections
    assert correction[0] == "altitude.vertical_speed" and "taken from altitudes" in correction[1]
    # What changes its reference, or says no vertical speed any more, begins anew.
    for altitude in (Altitude(900.0, "wgs84", reported_climb), Altitude(900.0, "pressure")):
        later = replace(report(30.0), altitude=altitude)
        assert take_in(track, later, "it", later.time, RULES).estimate.altitude == altitude


@pytest.mark.parametrize("unit", [0.3048, 1.0 / 0.3048, 3.6, 1.0 / 3.6])
def test_velocity_in_another_unit_is_a_fault(unit: float):
    track = UNKNOWN
    for second in range(12):
        message = aircraft(80.0 * second, 0.0, 0.0, 80.0 * unit, time=NOW + second * SECOND)
        track = take_in(track, read(message, "it"), "it", NOW + second * SECOND, RULES)
    assert track.fault is not None and track.fault.check is ReportCheck.CONTRADICTION
    # Nothing is taken instead of what cannot be believed.
    assert track.course is not None and track.course.estimate is track.course.newest
    assert "velocity" not in dict(track.course.corrections)


@pytest.mark.parametrize("turn", [0.5 * math.pi, math.pi])
def test_velocity_across_the_displacement_is_a_fault(turn: float):
    track = UNKNOWN
    for second in range(6):
        message = aircraft(80.0 * second, 0.0, turn, 80.0, time=NOW + second * SECOND)
        track = take_in(track, read(message, "it"), "it", NOW + second * SECOND, RULES)
    assert track.fault is not None and track.fault.check is ReportCheck.CONTRADICTION


def test_velocity_zero_of_an_aircraft_that_moves_is_a_fault():
    track = UNKNOWN
    for second in range(6):
        message = aircraft(80.0 * second, 0.0, 0.0, 0.0, time=NOW + second * SECOND)
        track = take_in(track, read(message, "it"), "it", NOW + second * SECOND, RULES)
    assert track.fault is not None and track.fault.check is ReportCheck.CONTRADICTION


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.1, 0.5, 1.0]),
    st.floats(-6.0, 6.0),
    st.floats(0.0, 100.0),
)
def test_noisy_turning_aircraft_do_not_contradict_themselves(
    seed: int, every: float, degrees: float, speed: float
):
    random, track = np.random.default_rng(seed), UNKNOWN
    start = VehicleState(
        np.float64(0.0), np.float64(0.0), np.float64(0.3), np.float64(max(speed, 50.0))
    )
    for number in range(round(30.0 / every)):
        at = kinematics.advance(
            start, 0.0, math.radians(degrees), np.float64(every * number), SURROGATE, np
        )
        time, (east, north, up) = NOW + round(every * number * SECOND), random.normal(size=3)
        state = (
            float(at.x) + 10.0 * east,
            float(at.y) + 10.0 * north,
            float(at.heading),
            float(at.speed) + up,
        )
        message = aircraft(*state, time=time, valid=0x45, position_std=10.0)
        track = take_in(track, read(message, "it"), "it", time, RULES)
        assert track.check is ReportCheck.TAKEN


def test_reports_in_whole_numbers_are_tracked_in_floats(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code refuses other types."""
    types: set[type] = set()

    def follow(tracks: Tracks, reports: Reports, dt: float) -> tuple[Tracks, Belief, bool]:
        types.update(map(type, (*reports.state, *reports[1:], dt)))
        return single.follow(tracks, reports, dt)

    monkeypatch.setattr(courses, "follow", follow)
    in_integers = [
        replace(report(second), position_std=30, velocity_std=3) for second in (0.0, 1.0)
    ]
    _, checks = feed(*in_integers)
    assert checks == [ReportCheck.TAKEN, ReportCheck.TAKEN]
    assert types == {float, bool}


def test_outliers_that_disagree_are_refused():
    track, checks = feed(report(0.0), report(1.0, y=5_000.0), report(2.0, y=-5_000.0))
    assert checks[1:] == [ReportCheck.JUMP, ReportCheck.JUMP]
    assert track.last == report(0.0)


@given(st.floats(0.1, 29.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_what_lies_within_the_allowance_is_no_jump(seconds: float, ahead: float, aside: float):
    allowed = 0.69 * (RULES.jump_distance + RULES.jump_speed * seconds)
    _, checks = feed(
        report(0.0), report(seconds, x=80.0 * seconds + ahead * allowed, y=aside * allowed)
    )
    assert checks[-1] is ReportCheck.TAKEN


def test_any_place_is_accepted_after_a_long_silence():
    _, checks = feed(report(0.0), report(31.0, y=50_000.0))
    assert checks[-1] is ReportCheck.TAKEN


def test_silent_aircraft_is_forgotten_and_a_faulty_one_is_not():
    late = NOW + 40 * SECOND
    silent = feed(report(0.0))[0]
    noisy = note_refused(silent, FieldError("it.latitude", "is nan"), late, RULES)
    fresh, _ = feed(report(0.0), report(39.0))
    remaining, forgotten = forget_silent({"a": silent, "b": noisy, "c": fresh}, late, 30.0)
    assert set(remaining) == {"b", "c"}
    assert forgotten == ("a",)


@pytest.mark.parametrize("behind", [29.0, 31.0, 40.0, 3_600.0])
def test_what_still_arrives_is_never_forgotten_however_old_it_says_that_it_is(behind: float):
    """A source whose clock is behind, or that repeats itself, is stale: it must block, not go."""
    tracks = {}
    for second in range(100):
        moment = NOW + second * SECOND
        for name, newest in (("late", report(second - behind)), ("frozen", report(-behind))):
            tracks = follow(tracks, name, newest, moment, RULES)
        tracks, forgotten = forget_silent(tracks, moment, 30.0)
        assert not forgotten and set(tracks) == {"late", "frozen"}
    assert tracks["late"].age(moment) == behind
    assert forget_silent(tracks, moment + 31 * SECOND, 30.0) == ({}, ("late", "frozen"))


def turning(rate: float, every: float, std: float = 0.0, count: int = 9) -> Track:
    """Return what is known of an aircraft that turns, after some reports."""
    track = UNKNOWN
    for number in range(count):
        seconds = every * number
        at = kinematics.advance(START, 0.0, rate, np.float64(seconds), SURROGATE, np)
        time = NOW + round(seconds * SECOND)
        state = tuple(float(value) for value in at)
        spread = {"position_std": 10.0 * std, "velocity_std": std}
        message = aircraft(*state, time=time, valid=0xC5, **spread)
        track = take_in(track, read(message, "it"), "it", time, RULES)
    return track


@given(st.floats(0.3, 5.5), st.sampled_from([-1.0, 1.0]), st.sampled_from([0.1, 0.25, 0.5, 1.0]))
def test_a_turn_shows_in_the_reports_whatever_their_rate(degrees: float, side: float, every: float):
    rate = side * math.radians(degrees)
    assert turning(rate, every).turn_rate == pytest.approx(
        rate, rel=1e-3, abs=5e-5
    )  # meridians converge


def test_gaps_show_no_turn():
    rate = math.radians(3.0)
    turned = turning(rate, 1.0).estimate
    assert turned is not None and turn_of(turned, SETTINGS.turns) == turned.turn_rate != 0.0
    level = turning(0.0, 1.0).estimate
    assert level is not None and turn_of(level, SETTINGS.turns) == 0.0
    assert turning(rate, 6.0, count=3).turn_rate == 0.0


def test_a_turn_too_fast_to_be_believed_counts_as_the_fastest() -> None:
    greatest = SETTINGS.turns.most
    for sign in (1.0, -1.0):
        estimate = turning(sign * math.radians(7.0), 1.0).estimate
        assert estimate is not None and turn_of(estimate, SETTINGS.turns) == sign * greatest


def test_a_turn_in_noise_is_expected_to_go_on_as_long_as_its_course_is_known() -> None:
    calm, rate, times = Wind(), math.radians(3.0), list[float]()
    for std in (3.0, 0.1):
        track = turning(rate, 1.0, std=std, count=40)
        estimate = track.estimate
        assert estimate is not None and track.turn_rate == pytest.approx(
            rate, abs=4.0 * estimate.turn_std
        )
        expected = expected_turn(estimate, START, calm, SETTINGS.turns)
        assert expected.rate != 0.0 and expected.std == estimate.turn_std > 0.0
        times.append(expected.time)
    assert 0.0 < times[0] < times[1] == SETTINGS.turns.lasts
