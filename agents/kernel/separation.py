"""The separation from intruders as a constraint: a lower bound of the distance in each piece of a
trajectory (:mod:`agents.kernel.chords`), and what is required there.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.kernel.chords import BOUND_ERROR, SECANT, chords, least_margin, shares_lost
from agents.kernel.clearance import CLOSE, ROUNDING, Bounds, Clearance, Near
from agents.kernel.scalar_separation import FILL_CLEARANCE, Keeping
from agents.kernel.traffic import (
    Requirement,
    Traffic,
    Window,
    growth,
    positions,
    requirement_of,
    separations,
    within_window,
)
from agents.kernel.trajectory import STRAIGHT, Pieces, Trajectory
from envs.arrays import Array, Float, Int
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.relative import chord
from envs.trees import column, contiguous, map_leaves, take

_FEW = 4  # intruders whom it costs more to leave out than to look at
_PAIRS = 2_000  # legs set against intruders in a call of compiled code, which may last 1 ms


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

    def rows(self, numbers: Int[Array, " M"]) -> "Separation":
        """Return what some trajectories keep, by their numbers."""
        traffic, required, least = take((self.traffic, self.required, self.least), numbers)
        return Separation(traffic, required, least, self.sigmas)

    def fill(
        self,
        flown: Trajectory[Any],
        levels: Float[Array, "N K"],
        clearances: Clearance,
        *,
        closest: bool,
    ) -> bool:
        """Fill in what is kept by compiled code; return whether there is any."""
        if not FILL_CLEARANCE.ready:
            return False
        none = np.empty((0, 0))
        window = Window(none, none) if self.traffic.window is None else self.traffic.window
        traffic = self.traffic._replace(separation=None, window=None)
        least = none if self.least is None else self.least
        keeping = Keeping(
            *contiguous((traffic, window, self.required, least, levels)), sigmas=float(self.sigmas)
        )
        flown = contiguous(flown)
        rows, legs = flown.sagitta.shape
        step = max(_PAIRS // max(legs * self.size, 1), 1)
        for first in range(0, rows, step):
            end, few = min(first + step, rows), self.size <= _FEW
            FILL_CLEARANCE(flown, first, end, keeping, closest, few, clearances)
        return True

    def near(
        self,
        flown: Trajectory[Any],
        levels: Float[Array, "N K"],
        clearances: Clearance,
        *,
        closest: bool,
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
            + BOUND_ERROR
        )
        required = self.required[:, None]
        margin = bound - (required + growth(wide, np.maximum(end, 0.0), self.sigmas))
        near = ~(margin >= levels[:, None])
        if closest:
            away = np.sqrt(x * x + y * y)[:, :-1]
            # Where an intruder does not count at the beginning of a leg, its distance there is no
            # finding.
            begins = wide.mask & (begin >= 0.0) & within_window(wide, begin, begin)
            begin_margin = away - (required + growth(wide, np.maximum(begin, 0.0), self.sigmas))
            attained, least = (
                np.where(begins, values, np.inf).min(axis=(1, 2), keepdims=True, initial=np.inf)
                for values in (away, begin_margin)
            )
            near |= (bound <= attained) | (margin <= least)
        near &= counts
        far = np.where(counts & ~near, margin, np.inf).min(axis=1, initial=np.inf)
        np.minimum(clearances.margin, far, out=clearances.margin)
        return Near(*np.nonzero(near))

    def bounds(self, pieces: Pieces, number: Int[Array, " M"]) -> Bounds:
        """Return what pieces keep of the separation from an intruder each, by their numbers
        ``[M]``.

        The tolerance :data:`CLOSE` is for the margin, and for parts alone; the separation itself is
        kept but for rounding.
        """
        pair = pieces.row, number
        traffic = column(take(self.traffic, pair))
        chord = chords(pieces, traffic)
        counts = (pieces.end > 0.0) & within_window(traffic, pieces.begin, pieces.end)
        attained, straight = chord.attained, chord.sagitta <= STRAIGHT
        if traffic.window is not None:
            inside = (pieces.begin >= traffic.window.begin) & (pieces.end <= traffic.window.end)
            attained, straight = np.where(inside, attained, np.inf), straight & inside
        # At the end; and of straight pieces at the beginning, half-way and at the end, each a part
        # later, since of parts the end counts. What grows is convex: its secant is never less.
        middle = 0.5 * (pieces.begin + pieces.end)
        later = (time + pieces.part for time in (pieces.begin, middle, pieces.end))
        grown = growth(traffic, np.stack([pieces.end, *later]), self.sigmas)
        required = self.required[pair][:, None] + grown
        required = tolerated = np.broadcast_to(required, (4, *counts.shape))
        if self.least is not None:
            tolerated = np.maximum(required - CLOSE, self.least[pair][:, None] - ROUNDING)
        margin, tolerant = (chord.distance - distances[0] for distances in (required, tolerated))
        enters, leaves = (np.array(field) for field in (pieces.begin, pieces.end))
        places = np.nonzero(straight & counts)
        if places[0].size:
            line, length = take(chord, places), (pieces.end - pieces.begin)[places]
            begin, end = (
                distances[places] + np.broadcast_to(error, counts.shape)[places] + line.sagitta
                for distances, error in (
                    (tolerated[1], pieces.error_begin),
                    (tolerated[3], pieces.error),
                )
            )
            tolerant[places] = least_margin(line, begin, end, np)
            margin[places] = tolerant[places] - (required - tolerated).max(axis=0)[places]
            first, last = shares_lost(line, begin, end, np)
            enters[places] = pieces.begin[places] + first * length
            leaves[places] = pieces.begin[places] + last * length
        exact = straight & (0.5 * (tolerated[1] + tolerated[3]) - tolerated[2] <= SECANT)
        return Bounds(
            distance=chord.distance,
            nearest=np.where(
                straight, pieces.begin + chord.share * (pieces.end - pieces.begin), pieces.begin
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
