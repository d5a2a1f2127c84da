"""The separation from intruders as a constraint: a lower bound of the distance in each piece of a
trajectory, and what is required there.

Where two aircraft move on curves, the relative motion leaves the chord between two times h apart by
at most a h^2 / 8, a being the largest relative acceleration (proofs/Bound.v, proofs/Safe.v).
"""

from typing import Any, NamedTuple

import numpy as np

from agents.kernel.clearance import CLOSE, ROUNDING, Bounds, Clearance, Near
from agents.kernel.traffic import (
    Requirement,
    Traffic,
    growth,
    positions,
    requirement_of,
    separations,
    within_window,
)
from agents.kernel.trajectory import STRAIGHT, Pieces, Trajectory
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.relative import chord
from envs.trees import column, map_leaves, take

_FEW = 4  # intruders whom it costs more to leave out than to look at
_SECANT = 0.02  # m by which a secant may be more than what is required
_BOUND_ERROR = 0.01  # m by which bounds that leave legs out may be off: tolerance and rounding


class Separation(NamedTuple):
    """What is kept from intruders; fields ``[N, K]``."""

    traffic: Traffic
    required: Array  # before uncertainty grows, m
    least: Array  # never less than this, but for rounding, m; None: no tolerance
    sigmas: float  # how many sigmas of the predicted position are added

    @property
    def size(self) -> int:
        """How many intruders there are, K."""
        return self.traffic.mask.shape[-1]

    @property
    def cuts_once(self) -> bool:
        """Whether arcs that surely lose the separation are cut only to tell when it is lost first;
        how much is lost is told exactly.
        """
        return False

    def rows(self, which: Array) -> "Separation":
        """Return what some trajectories keep, by their numbers."""
        traffic, required, least = take((self.traffic, self.required, self.least), which)
        return Separation(traffic, required, least, self.sigmas)

    def near(
        self, flown: Trajectory[Any], levels: Array, found: Clearance, *, closest: bool
    ) -> Near:
        """Return the legs that must be judged piece by piece, and note the bounds of all others.

        Of a leg that is left out the chord shows that nothing there is below the level of interest;
        for the ``closest`` it also shows that it is not there.
        """
        traffic, times = self.traffic, flown.states.time
        begin, end = times[:, :-1, None], times[:, 1:, None]
        wide = map_leaves(lambda field: field[:, None], traffic)
        counts = wide.mask & (end > 0.0) & within_window(wide, begin, end)
        if self.size <= _FEW:
            return Near(*np.nonzero(counts))
        x, y = positions(wide, times[..., None])
        x, y = x - flown.states.x[..., None], y - flown.states.y[..., None]
        turn = np.where(begin < wide.turn_time, np.abs(wide.state.speed * wide.turn_rate), 0.0)
        bound = chord(x[:, :-1], y[:, :-1], x[:, 1:], y[:, 1:]) - (
            (flown.sagitta + flown.error)[..., None]
            + 0.125 * turn * (end - begin) ** 2
            + _BOUND_ERROR
        )
        required = self.required[:, None]
        margin = bound - (required + growth(wide, np.maximum(end, 0.0), self.sigmas))
        near = ~(margin >= levels[:, None])
        if closest:
            away = np.sqrt(x * x + y * y)[:, :-1]
            # Where an intruder does not count at the beginning of a leg, its distance there is no
            # finding.
            told = wide.mask & (begin >= 0.0) & within_window(wide, begin, begin)
            now = away - (required + growth(wide, np.maximum(begin, 0.0), self.sigmas))
            attained, kept = (
                np.where(told, values, np.inf).min(axis=(1, 2), keepdims=True, initial=np.inf)
                for values in (away, now)
            )
            near |= (bound <= attained) | (margin <= kept)
        near &= counts
        far = np.where(counts & ~near, margin, np.inf).min(axis=1, initial=np.inf)
        np.minimum(found.margin, far, out=found.margin)
        return Near(*np.nonzero(near))

    def bounds(self, given: Pieces, which: Array) -> Bounds:
        """Return what pieces keep of the separation from an intruder each, by their numbers
        ``[M]``.

        The tolerance :data:`CLOSE` is for the margin, and for parts alone; the separation itself is
        kept but for rounding.
        """
        pair = given.row, which
        traffic = column(take(self.traffic, pair))
        chord = chords(given, traffic)
        counts = (given.end > 0.0) & within_window(traffic, given.begin, given.end)
        attained, straight = chord.attained, chord.sagitta <= STRAIGHT
        if traffic.window is not None:
            inside = (given.begin >= traffic.window.begin) & (given.end <= traffic.window.end)
            attained, straight = np.where(inside, attained, np.inf), straight & inside
        # At the end; and of straight pieces at the beginning, half-way and at the end, each a part
        # later, since of parts the end counts. What grows is convex: its secant is never less.
        middle = 0.5 * (given.begin + given.end)
        later = (time + given.part for time in (given.begin, middle, given.end))
        grown = growth(traffic, np.stack([given.end, *later]), self.sigmas)
        required = self.required[pair][:, None] + grown
        required = tolerated = np.broadcast_to(required, (4, *counts.shape))
        if self.least is not None:
            tolerated = np.maximum(required - CLOSE, self.least[pair][:, None] - ROUNDING)
        margin, tolerant = (chord.distance - each[0] for each in (required, tolerated))
        enters, leaves = (np.array(field) for field in (given.begin, given.end))
        some = np.nonzero(straight & counts)
        if some[0].size:
            line, length = take(chord, some), (given.end - given.begin)[some]
            begin, end = (
                each[some] + np.broadcast_to(error, counts.shape)[some] + line.sagitta
                for each, error in ((tolerated[1], given.error_begin), (tolerated[3], given.error))
            )
            tolerant[some] = line.least_margin(begin, end)
            margin[some] = tolerant[some] - (required - tolerated).max(axis=0)[some]
            first, last = line.within(begin, end)
            enters[some] = given.begin[some] + first * length
            leaves[some] = given.begin[some] + last * length
        exact = straight & (0.5 * (tolerated[1] + tolerated[3]) - tolerated[2] <= _SECANT)
        return Bounds(
            distance=chord.distance,
            nearest=np.where(
                straight, given.begin + chord.share * (given.end - given.begin), given.begin
            ),
            margin=margin,
            tolerant=tolerant,
            attained=attained,
            counts=counts,
            exact=exact,
            surely_lost=attained < tolerated[0],
            lost_from=enters,
            lost_until=leaves,
        )


def separation(traffic: Traffic, own: VehicleState[Air], requirement: Requirement) -> Separation:
    """Return what trajectories that begin at states ``[N]`` keep from intruders ``[N, K]``."""
    return Separation(
        traffic,
        requirement_of(traffic, own, requirement),
        np.broadcast_to(separations(traffic, requirement), traffic.mask.shape),
        requirement.sigmas,
    )


class Chord(NamedTuple):
    """Pieces of motion relative to an intruder each, as their chords; fields ``[M, P]``."""

    distance: Array  # a lower bound of it, m
    attained: Array  # the smaller distance of both ends, m
    sagitta: Array  # by how much the motion may leave the chord, m
    x: Array  # where the chord begins, m
    y: Array
    dx: Array  # from there to its end, m
    dy: Array
    share: Array  # of the chord at which it is nearest, 0 to 1

    def least_margin(self, begin: Array, end: Array) -> Array:
        """Return the smallest distance on the chords less what is required, m, which changes evenly
        from one value to another, the second the greater one.
        """
        grows, square = end - begin, np.maximum(self.dx * self.dx + self.dy * self.dy, 1e-12)
        nearest = -(self.x * self.dx + self.y * self.dy) / square
        passing = np.hypot(self.x + nearest * self.dx, self.y + nearest * self.dy)
        # Nearest to what is required: where the range opens as fast as that grows.
        faster = square > grows * grows
        after = passing * grows / np.sqrt(square * np.where(faster, square - grows * grows, 1.0))
        share = np.clip(np.where(faster, nearest + after, 1.0), 0.0, 1.0)
        distance = np.hypot(self.x + share * self.dx, self.y + share * self.dy)
        return distance - (begin + share * grows)

    def within(self, begin: Array, end: Array) -> tuple[Array, Array]:
        """Return from which share of the chords to which less than the required distance is left,
        which changes as for :meth:`least_margin`; of chords on which it is.
        """
        grows = end - begin
        a = self.dx * self.dx + self.dy * self.dy - grows * grows
        b = self.x * self.dx + self.y * self.dy - begin * grows
        c = self.x * self.x + self.y * self.y - begin * begin
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        enters = np.where(c < 0.0, 0.0, c / np.where(root > b, root - b, np.inf))
        leaves = np.where(a > 0.0, (root - b) / np.where(a > 0.0, a, 1.0), 1.0)
        return np.clip(enters, 0.0, 1.0), np.clip(leaves, 0.0, 1.0)


def chords(given: Pieces, traffic: Traffic) -> Chord:
    """Return pieces ``[M, P]`` relative to an intruder each, ``[M, 1]``, with what is known of the
    distance.
    """
    # Beginnings and ends in one array, [2, M, P]: half the calls, the same bits.
    times = np.stack([given.begin, given.end])
    x, y = positions(map_leaves(lambda field: field[None], traffic), times)
    (x0, x1), (y0, y1) = x, y = (
        x - np.stack([given.x0, given.x1]),
        y - np.stack([given.y0, given.y1]),
    )
    dx, dy = x1 - x0, y1 - y0
    s = np.clip(-(x0 * dx + y0 * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    first, last = np.sqrt(x * x + y * y)
    near_x, near_y = x0 + s * dx, y0 + s * dy
    near = np.sqrt(near_x * near_x + near_y * near_y)
    # A share s of the piece from its beginning, the motion leaves the chord by at most
    # 4 sagitta s (1 - s). Where the chord is nearest at an end, from which the range opens by at
    # least g s, the distance is smaller than there by at most (4 sagitta - g)^2 / (16 sagitta).
    turn = np.where(traffic.turn_time > 0.0, np.abs(traffic.state.speed * traffic.turn_rate), 0.0)
    length = given.end - given.begin
    sagitta = np.maximum((given.bend + turn) * (0.125 * length**2), 1e-12)
    opening = np.where(s <= 0.0, (x0 * dx + y0 * dy) / np.maximum(first, 1e-9), 0.0)
    opening = np.where(s >= 1.0, -(x1 * dx + y1 * dy) / np.maximum(last, 1e-9), opening)
    loss = np.maximum(4.0 * sagitta - np.maximum(opening, 0.0), 0.0) ** 2 / (16.0 * sagitta)
    distance = near - loss - given.error
    return Chord(distance, np.minimum(first, last), sagitta, x0, y0, dx, dy, s)
