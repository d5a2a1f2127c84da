"""Encounters with traffic of an encounter model, and what each of them weighs.

The distribution that results, *weighted*, is this: intruders whose tracks are the model's fill the
plane evenly, in number and in course, all at the ownship's level; the ownship, its speed uniform,
flies straight along its route without a resolver; of all these intruders it is those whose closest
approach of the whole flight falls into a window of time and below a miss distance, that are not too
near at the start and not too fast at first. In space they fill it evenly in height too, and of them
those count that are also nearer above or below at that closest approach than a vertical distance.

An encounter is drawn by its closest approach: time and signed miss distance are uniform, the
intruder's course is uniform, and its track is shifted so that there, at that moment, it stands
beside the relative velocity. Places then are not even: the plane's area per second and metre is the
rate at which the closest approach sweeps it,

    w = |v| + m f,

with the relative speed |v|, the signed miss distance m and the rate f at which the relative
velocity turns. That is the encounter's weight, m/s. Where it is not positive the distance has no
minimum there; where the distance is smaller at another moment the encounter belongs to that one:
both are drawn again, so that each encounter counts once.

In space the vertical distance at the closest approach is uniform, which is even in height, so that
the weight stays. The ownship flies level, at an altitude that is uniform in the layer of which the
intruder was drawn, by whose part in traffic layers come; the intruder's vertical rate is the
model's, second by second. Neither the layer nor the ground holds it.

Strata make near closest approaches likelier than they are (importance sampling). Each is a cylinder
less the one inside of it: of closest approaches it has the part A of the area that both distances
span, and of the draws a share q, even inside. The weight becomes

    w = (|v| + m f) A / q.

Each attempt at an encounter draws its stratum anew, so that what the conditions refuse of a stratum
is weighed too.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from envs import draws as numbers
from envs.aircraft import Aircraft
from envs.altitudes import Altitudes, at_step
from envs.angles import wrap
from envs.encounters import Encounter, EncounterError, between
from envs.frames import Air
from envs.intruder import KnownFlight
from envs.kinematics import FASTEST, VehicleState, advance
from envs.perception import Coverage, Sensor
from envs.relative import distance, leg_separation
from envs.starts import check_number
from envs.traffic.encounter_model import LAYER, EncounterModel
from envs.traffic.encounter_model_sampler import Sampled, dimensions, fly_tracks, sample_model
from envs.traffic.replay import encounters_of
from envs.traffic.track_units import FOOT
from envs.trees import scatter, take

_OWN_DRAWS = 5
_MISS = 4  # place of the draw of the miss distance
_DRAWS_OF_HEIGHT = 2  # after the model's: of the own altitude and of the vertical distance
_STREAM = 1 << 32  # of the first attempt's draws: beyond those of starts and reports (envs.starts)
_STREAM_OF_ALTIMETERS = 1 << 33  # beyond those of all attempts
_STATED_SIGMAS = 2.0  # of an altimeter's error
_FREE = FASTEST._replace(speed_min=0.0)
_SAME = 0.5  # the closest approach counts as found again within this, m


class Stratum(NamedTuple):
    """Closest approaches within a cylinder, but not within a smaller one."""

    miss: float  # m
    vertical_miss: float  # m
    share: float  # of the draws


@dataclass(frozen=True)
class ModelTraffic:
    """A scenario of encounters with one intruder of a model; pairs (low, high) are ranges of a
    uniform draw.
    """

    model: EncounterModel
    aircraft: Aircraft
    own_speed: tuple[float, float]  # m/s
    cpa_time: tuple[float, float]  # time of the closest approach without a resolver, s
    miss: float  # largest distance there, m
    min_initial_separation: float  # starts closer than this, m, are drawn again
    ahead: float  # the goal lies so many seconds ahead at the own speed, s
    attempts: int = 200  # how many draws an encounter has to meet the conditions
    # greatest vertical distance at the closest approach, m; None: all are at one level
    vertical_miss: float | None = None
    # from the innermost, in space alone; the rest of the draws is beyond them
    strata: tuple[Stratum, ...] = ()
    position_std: float = 0.0  # of reports, one sigma per axis, m
    velocity_std: float = 0.0  # likewise, m/s
    latency: float = 0.0  # age of reports, s, at most two time steps
    # error of the intruder's altimeter beside the ownship's, the same in all of an encounter, one
    # sigma, m; reports state two of them
    altitude_std: float = 0.0
    sensor_range: float = math.inf  # beyond which nobody is reported, m
    field_of_view: float = 2.0 * math.pi  # in which intruders are reported, ahead, rad

    @property
    def flawed(self) -> bool:
        """Whether reports have noise or age."""
        return max(self.position_std, self.velocity_std, self.latency) > 0.0

    @property
    def partly_seen(self) -> bool:
        """Whether there are intruders without reports."""
        return math.isfinite(self.sensor_range) or self.field_of_view < 2.0 * math.pi

    @property
    def duration(self) -> int:
        """Whole seconds of traffic that are drawn: longer than any plan."""
        return math.ceil(4.0 * self.aircraft.t_max / 3.0)


class _Drawn(NamedTuple):
    """Encounters of one attempt; fields ``[M]``."""

    own: VehicleState[Air]
    recording: VehicleState[Air]  # [M, T + 1]
    weight: np.ndarray  # m/s
    altitudes: Altitudes | None  # with a row a second, [M, 1, T + 1]
    accepted: np.ndarray  # whether they meet the conditions, bool


def encounters_with(
    traffic: ModelTraffic, seed: int, first: int, count: int
) -> tuple[Encounter, np.ndarray]:
    """Return the encounters ``first .. first + count - 1`` of a seed and their weights, m/s.

    Encounter 1234 of a seed is the same wherever and with however many others it is drawn.

    Raises:
        EncounterError: seed or number are out of range, or the conditions are never met.
    """
    check_number(seed, first)
    size = dimensions(traffic.model, traffic.duration) + _OWN_DRAWS
    size += 0 if traffic.vertical_miss is None else _DRAWS_OF_HEIGHT
    size += 1 if traffic.strata else 0
    encounters_drawn: _Drawn | None = None
    pending = np.arange(count)
    for attempt in range(traffic.attempts):
        uniform = [
            numbers.uniforms(seed, first + int(i), 1, (size,), _STREAM + attempt)[0]
            for i in pending
        ]
        drawn = _attempt(traffic, np.stack(uniform))
        if encounters_drawn is None:
            encounters_drawn = drawn
        scatter(encounters_drawn, pending, drawn)
        pending = pending[~drawn.accepted]
        if not pending.size:
            break
    else:
        raise EncounterError(
            f"encounter {first + int(pending[0])} of seed {seed} does not meet the conditions in "
            f"{traffic.attempts} attempts; allow more, or other conditions"
        )
    assert encounters_drawn is not None  # there is an attempt at least
    recording = KnownFlight(
        *(field[:, None] for field in _at_steps(encounters_drawn.recording, traffic.aircraft.dt))
    )
    encounters = encounters_of(
        encounters_drawn.own, recording, np.ones((count, 1), bool), traffic.ahead
    )
    altitudes = encounters_drawn.altitudes
    if altitudes is not None:
        rows = _rows_at_steps(altitudes.intruders, traffic.aircraft.dt)
        altitudes = altitudes._replace(intruders=rows)
        if traffic.altitude_std > 0.0:
            draws = numbers.normals(seed, first, count, (1,), _STREAM_OF_ALTIMETERS)
            altitudes = altitudes._replace(
                too_high=traffic.altitude_std * draws,
                stated_error=np.full(draws.shape, _STATED_SIGMAS * traffic.altitude_std),
            )
        encounters = encounters._replace(altitudes=altitudes)
    return _reported(encounters, traffic), encounters_drawn.weight


def _reported(encounters: Encounter, traffic: ModelTraffic) -> Encounter:
    """Return encounters ``[N]`` with the sensors of their reports."""
    ones = np.ones(encounters.mask.shape)
    sensor = Sensor(
        traffic.position_std * ones, traffic.velocity_std * ones, traffic.latency * ones
    )
    encounters = encounters._replace(sensor=sensor)
    if not traffic.partly_seen:
        return encounters
    reach, half = traffic.sensor_range * ones, 0.5 * traffic.field_of_view * ones
    return encounters._replace(coverage=Coverage(reach, half, 0.0 * ones, 0.0 * ones))


def _attempt(traffic: ModelTraffic, uniform: np.ndarray) -> _Drawn:
    """Return one attempt at the encounters of draws ``[M, D]``: own speed, both courses, time and
    miss distance of the closest approach, then the model's, in space those of the heights, and that
    of the stratum.
    """
    rows = np.arange(len(uniform))
    most = traffic.aircraft.traffic_speed_max
    last = _OWN_DRAWS + dimensions(traffic.model, traffic.duration)
    sampled = sample_model(traffic.model, uniform[:, _OWN_DRAWS:last], traffic.duration)
    track = fly_tracks(traffic.model, sampled, most)
    speed = between(traffic.own_speed, uniform[:, 0])
    course, turned = (wrap(2.0 * np.pi * uniform[:, i], np) for i in (1, 2))
    time = between(traffic.cpa_time, uniform[:, 3])
    approach = _approach(traffic, uniform, last + 1)
    miss = approach.miss

    second = np.minimum(time.astype(int), traffic.duration - 1)
    # What the speed did, not what was drawn: it may have been held at a limit.
    acceleration = track.speed[rows, second + 1] - track.speed[rows, second]
    turn_rate = sampled.turn_rate[rows, second]
    at_cpa = advance(take(track, (rows, second)), acceleration, turn_rate, time - second, _FREE, np)
    own: VehicleState[Air] = VehicleState(np.zeros(len(rows)), np.zeros(len(rows)), course, speed)
    turned_there = at_cpa._replace(heading=at_cpa.heading + turned)
    passing = _pass(own, turned_there, acceleration, turn_rate, miss)

    # To the left of the relative velocity, at the miss distance from where the ownship is then.
    x, y = _rotate(at_cpa.x, at_cpa.y, turned)
    shift_x = speed * time * np.cos(course) - miss * passing.vy / passing.speed - x
    shift_y = speed * time * np.sin(course) + miss * passing.vx / passing.speed - y
    x, y = _rotate(track.x, track.y, turned[:, None])
    heading = wrap(track.heading + turned[:, None], np)
    recording: VehicleState[Air] = VehicleState(
        x + shift_x[:, None], y + shift_y[:, None], heading, track.speed
    )
    accepted = (
        (passing.weight > 0.0)
        & (sampled.speed <= most)
        & (distance(recording.x[:, 0], recording.y[:, 0], np) >= traffic.min_initial_separation)
        & (np.abs(_closest(own, recording, traffic.ahead) - np.abs(miss)) <= _SAME)
    )
    altitudes = None
    if approach.above is not None:
        altitudes = _altitudes(traffic.model, sampled, time, approach.above, uniform[:, last])
    return _Drawn(own, recording, approach.rarity * passing.weight, altitudes, accepted)


class _Approach(NamedTuple):
    """Where the intruder is at the closest approach; fields ``[M]``."""

    miss: np.ndarray  # signed, m
    above: np.ndarray | None  # the ownship, m; None: at its level
    rarity: np.ndarray  # how often it is drawn without strata, in terms of how often it is


def _approach(traffic: ModelTraffic, uniform: np.ndarray, height: int) -> _Approach:
    """Return closest approaches by draws ``[M, D]``; ``height``: place of that of the vertical
    distance.
    """
    miss, high = traffic.miss, traffic.vertical_miss
    if high is None or not traffic.strata:
        aside = between((-miss, miss), uniform[:, _MISS])
        above = None if high is None else between((-high, high), uniform[:, height])
        return _Approach(aside, above, np.ones(len(uniform)))
    to_the_side, upward = (2.0 * uniform[:, place] - 1.0 for place in (_MISS, height))
    ends = np.cumsum([stratum.share for stratum in traffic.strata])
    number = np.searchsorted(ends, uniform[:, -1], side="right")
    radii = np.array([0.0, *(stratum.miss for stratum in traffic.strata), miss])
    heights = np.array([0.0, *(stratum.vertical_miss for stratum in traffic.strata), high])
    radius, hole = radii[number + 1], radii[number]
    top, floor = heights[number + 1], heights[number]
    # Over the hole it is higher than that; beside it, anywhere.
    over, area = hole * (top - floor), radius * top - hole * floor
    part = np.abs(to_the_side) * area
    is_over = part < over
    with np.errstate(divide="ignore", invalid="ignore"):
        aside = np.where(is_over, part / (top - floor), hole + (part - over) / top)
    least = np.where(is_over, floor, 0.0)
    above = least + (top - least) * np.abs(upward)
    share = np.diff([0.0, *ends, 1.0])[number]
    return _Approach(
        np.copysign(aside, to_the_side),
        np.copysign(above, upward),
        area / (miss * high * share),
    )


def _altitudes(
    model: EncounterModel,
    sampled: Sampled,
    time: np.ndarray,
    above: np.ndarray,
    own_draw: np.ndarray,
) -> Altitudes:
    """Return altitudes with a row a second, of intruders ``[M, 1, T + 1]``.

    Args:
        model: the traffic's.
        sampled: of the model.
        time: of the closest approach, s, ``[M]``.
        above: the ownship at that time, m, ``[M]``.
        own_draw: of the own altitude, ``[M]``.
    """
    place = model.place(LAYER)
    edges = model.boundaries[place]
    assert edges is not None  # the reader of the configuration refuses it
    layer = sampled.bins[:, place]
    own = FOOT * (edges[layer] + (edges[layer + 1] - edges[layer]) * own_draw)
    risen = np.concatenate([np.zeros((len(own), 1)), np.cumsum(sampled.climb, axis=1)], axis=1)
    risen_at_cpa = at_step(risen[:, None], time[:, None])
    at_cpa = own + above
    return Altitudes(own, (at_cpa[:, None] - risen_at_cpa)[..., None] + risen[:, None])


def _rows_at_steps(rows: np.ndarray, dt: float) -> np.ndarray:
    """Return altitudes with a row a second, ``[M, 1, T + 1]``, with a row a time step (s)."""
    if dt == 1.0:
        return rows
    steps = np.arange(math.floor((rows.shape[-1] - 1) / dt) + 1) * dt
    return np.stack([at_step(rows, np.float64(second)) for second in steps], axis=-1)


class _Passing(NamedTuple):
    """The intruder's motion relative to the ownship at the closest approach; fields ``[M]``."""

    vx: np.ndarray  # m/s
    vy: np.ndarray
    speed: np.ndarray  # m/s, above 0
    weight: np.ndarray  # of the encounter, m/s


def _pass(
    own: VehicleState[Air],
    intruder: VehicleState[Air],
    acceleration: np.ndarray,
    turn_rate: np.ndarray,
    miss: np.ndarray,
) -> _Passing:
    """Return how an intruder passes the ownship, ``[M]``.

    Args:
        intruder: the intruder at the closest approach, accelerating along its path, m/s^2, and
            turning, rad/s.
        miss: its signed distance, m.
    """
    ahead_x, ahead_y = np.cos(intruder.heading), np.sin(intruder.heading)
    vx = intruder.speed * ahead_x - own.speed * np.cos(own.heading)
    vy = intruder.speed * ahead_y - own.speed * np.sin(own.heading)
    speed = np.maximum(distance(vx, vy, np), 1e-6)
    ax = acceleration * ahead_x - intruder.speed * turn_rate * ahead_y
    ay = acceleration * ahead_y + intruder.speed * turn_rate * ahead_x
    return _Passing(vx, vy, speed, weight=speed + miss * (vx * ay - vy * ax) / speed**2)


def _closest(own: VehicleState[Air], recording: VehicleState[Air], until: float) -> np.ndarray:
    """Return the smallest distance of the ownship, straight on, and a recording until a time, m,
    ``[M]``.
    """
    last = min(round(until), recording.x.shape[-1] - 1)
    along = own.speed[:, None] * np.arange(last + 1)
    x, y = along * np.cos(own.heading)[:, None], along * np.sin(own.heading)[:, None]
    straight: VehicleState[Air] = VehicleState(
        x, y, *(np.broadcast_to(field[:, None], x.shape) for field in (own.heading, own.speed))
    )
    parts = np.s_[:, :last], np.s_[:, 1 : last + 1]
    (own_begin, own_end), (begin, end) = (
        [take(state, part) for part in parts] for state in (straight, recording)
    )
    return leg_separation(own_begin, own_end, begin, end, 1.0, np).min(axis=-1)


def _at_steps(recording: VehicleState[Air], dt: float) -> VehicleState[Air]:
    """Return a recording with a row a second, ``[M, T + 1]``, with a row a time step (s)."""
    if dt == 1.0:
        return recording
    last = recording.x.shape[-1] - 1
    times = dt * np.arange(math.floor(last / dt) + 1)
    second = np.minimum(times.astype(int), last - 1)
    before, after = take(recording, np.s_[:, second]), take(recording, np.s_[:, second + 1])
    turn = wrap(after.heading - before.heading, np)
    return advance(before, after.speed - before.speed, turn, times - second, _FREE, np)


def _rotate(x: np.ndarray, y: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vectors turned by an angle, rad, to the left."""
    return x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
