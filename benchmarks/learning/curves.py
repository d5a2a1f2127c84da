"""What is read off learning curves: scores in windows of steps, times to a score, intervals over
seeds.

The training score of a window is the mean sparse return of the episodes that ended in it, the same
for every learner. A run is a few seeds, so intervals are Student's t: of scores as they are, of
times on a logarithmic scale, because what is compared is how many times faster a learner is.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import stdtrit

from eval.stats.intervals import Interval

__all__ = [
    "CONFIDENCE",
    "TAIL",
    "WINDOW",
    "Axis",
    "Point",
    "Times",
    "Windows",
    "ratio",
    "score_at",
    "t_mean",
    "time_to_score",
]

WINDOW = 131_072
"""Environment steps of a window, at least: as many for every learner, so that no curve crosses a
score by noise sooner than another. About a thousand episodes, whose mean has a standard error of
some 2."""
TAIL = 0.05
"""Share of a training over which the score at a moment is taken, as our trainings report theirs."""
CONFIDENCE = 0.95

Axis = Literal["steps", "wall_s"]


class Episodes(NamedTuple):
    """What the episodes that ended during an update amount to."""

    steps: int
    """Environment steps of the update."""
    returns: float
    """Sum of the task's sparse rewards, unscaled and unshaped."""
    episodes: int


class Point(NamedTuple):
    """A window's end."""

    steps: int
    """Environment steps since the beginning."""
    wall_s: float
    """Time that training has taken since then, s; starting and compiling are not in it."""
    score: float
    """Mean sparse return of the episodes that ended in the window; not a number where none did."""
    episodes: int


class Windows:
    """Adds up updates into windows.

    Args:
        least: steps of a window; one ends with the update that makes it as long.
    """

    def __init__(self, least: int = WINDOW) -> None:
        self._least = least
        self._steps, self._wall_s = 0, 0.0
        self._begun = Episodes(0, 0.0, 0)

    def add(self, flown: Episodes, wall_s: float) -> Point | None:
        """Count an update that took so long, s; return the point where a window has ended
        with it.
        """
        self._steps += flown.steps
        self._wall_s += wall_s
        steps, returns, episodes = self._begun
        self._begun = Episodes(
            steps + flown.steps, returns + flown.returns, episodes + flown.episodes
        )
        return self.finish() if self._begun.steps >= self._least else None

    def finish(self) -> Point:
        """End the window where it is."""
        _, returns, episodes = self._begun
        self._begun = Episodes(0, 0.0, 0)
        return Point(
            self._steps, self._wall_s, returns / episodes if episodes else math.nan, episodes
        )


def time_to_score(curve: Sequence[Point], score: float, axis: Axis) -> float | None:
    """Return where a curve first comes to a score, between two windows' ends by a straight line;
    None if never.
    """
    before: Point | None = None
    for point in curve:
        if math.isnan(point.score):
            continue
        if point.score >= score:
            if before is None:
                return float(getattr(point, axis))
            share = (score - before.score) / (point.score - before.score)
            start, end = getattr(before, axis), getattr(point, axis)
            return float(start + share * (end - start))
        before = point
    return None


def score_at(curve: Sequence[Point], where: float, axis: Axis, tail: float = TAIL) -> float:
    """Return the mean over the episodes of the last share of a curve up to a place, of its last
    window there at least.

    Not a number where no episode had ended by then.
    """
    reached = [
        point
        for point in curve
        if getattr(point, axis) <= where * (1.0 + 1e-9) and point.episodes > 0
    ]
    if not reached:
        return math.nan
    last = [point for point in reached if getattr(point, axis) > (1.0 - tail) * where] or reached[
        -1:
    ]
    return float(
        np.average([point.score for point in last], weights=[point.episodes for point in last])
    )


def t_mean(values: Sequence[float], confidence: float = CONFIDENCE) -> Interval:
    """Return the mean of seeds with Student's interval; of a single one the interval is not
    known.
    """
    if not values:
        return Interval(math.nan, math.nan, math.nan)
    mean, error, freedom = _moments(values)
    return _interval(mean, error, freedom, confidence)


class Times(NamedTuple):
    """When a learner's seeds came to a score."""

    seeds: tuple[float | None, ...]
    """None where a seed did not."""
    lengths: tuple[float, ...]
    """How far each seed went."""

    @property
    def complete(self) -> bool:
        """Whether all seeds came to the score."""
        return bool(self.seeds) and None not in self.seeds

    def mean(self) -> Interval:
        """Return the geometric mean with its interval; not a number where a seed did not come to
        the score.
        """
        if not self.complete:
            return Interval(math.nan, math.nan, math.nan)
        return Interval(*(math.exp(x) for x in t_mean(self.logarithms())))

    def at_least(self) -> float:
        """Return the geometric mean with the length of each seed that did not come to the score in
        its time's place.
        """
        return math.exp(float(np.mean(self.logarithms())))

    def logarithms(self) -> list[float]:
        """Return the seeds' logarithms, of the length of each that did not come to the score."""
        seeds = zip(self.seeds, self.lengths, strict=True)
        return [math.log(length if time is None else time) for time, length in seeds]


def ratio(theirs: Times, ours: Times, confidence: float = CONFIDENCE) -> Interval:
    """Return how many times longer they took, by Welch's interval of the logarithms.

    Not a number unless all seeds of both came to the score.
    """
    if not (theirs.complete and ours.complete):
        return Interval(math.nan, math.nan, math.nan)
    (mean, error, freedom), (our_mean, our_error, our_freedom) = map(
        _moments, (theirs.logarithms(), ours.logarithms())
    )
    squares = (error**2, our_error**2)
    spread = sum(squares)
    # Welch and Satterthwaite; without any spread the degrees of freedom do not matter.
    terms = [
        square**2 / max(f, 1) for square, f in zip(squares, (freedom, our_freedom), strict=True)
    ]
    joint = spread**2 / sum(terms) if spread > 0.0 else 1.0
    if freedom == 0 or our_freedom == 0:
        joint = 0.0
    logarithms = _interval(mean - our_mean, math.sqrt(spread), joint, confidence)
    return Interval(*(math.exp(x) for x in logarithms))


def _moments(values: Sequence[float]) -> tuple[float, float, int]:
    """Return mean, standard error and degrees of freedom."""
    count = len(values)
    error = float(np.std(values, ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    return float(np.mean(values)), error, count - 1


def _interval(mean: float, error: float, freedom: float, confidence: float) -> Interval:
    if freedom <= 0.0:
        return Interval(mean, math.nan, math.nan)
    reach = float(stdtrit(freedom, 0.5 * (1.0 + confidence))) * error
    return Interval(mean, mean - reach, mean + reach)
