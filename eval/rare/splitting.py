"""Importance splitting: small probabilities as products of larger ones, in the space of the draws.

Particles below a level are copied until there are as many as before, moved by steps that leave
their distribution below that level as it is, and counted at the next, lower level. The product of
the shares is an unbiased estimate where levels and steps are fixed in advance (F. Cerou, A.
Guyader, Stochastic Analysis and Applications 25 (2007) 417; P. Del Moral, Feynman-Kac Formulae,
2004), so that a pilot of its own chooses them and independent repetitions estimate.

A step is a preconditioned Crank-Nicolson proposal: a particle's normal numbers are mixed with new
ones (S. L. Cotter et al., Statistical Science 28 (2013) 424). It is taken where it stays below the
level.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, Self

import numpy as np

from commands.command import InputError

_MOST_LEVELS = 60
_TARGET_ACCEPTANCE = 0.3
_LARGEST_STEP, _SMALLEST_STEP = 0.9, 1e-3
# ratio of the largest to the smallest step of a stage: failures may lie in thin strips
_SPREAD = 10.0
_TRIES = 1_000


class SplittingError(InputError):
    """The event cannot be reached; the message says at which level and why."""


class Problem(Protocol):
    """What is asked: how probable it is that a value of random draws lies below a threshold."""

    dimensions: int  # standard normal numbers that one particle takes

    def value(self, draws: np.ndarray) -> np.ndarray:
        """Return the values ``[N]`` of draws ``[N, dimensions]``.

        Not a number: the distribution (of normal draws on a condition) has no such particle;
        infinite: it cannot count.
        """
        ...


class Plan(NamedTuple):
    """What a pilot has chosen."""

    levels: tuple[float, ...]  # Falling; the last is the threshold
    steps: tuple[float, ...]  # largest size of the proposals below each level but the last
    evaluations: int

    @classmethod
    def of_arrays(cls, fields: Mapping[str, np.ndarray]) -> Self:
        """Return the plan whose fields were stored as arrays."""
        levels, steps = (tuple(fields[name].tolist()) for name in ("levels", "steps"))
        return cls(levels, steps, int(fields["evaluations"]))


class Repetition(NamedTuple):
    """One independent estimate; arrays ``[L]``, one entry a level."""

    probability: np.ndarray  # of a value below each level
    # share of the proposals accepted below each level but the last, [L - 1]; nan: none was left
    acceptance: np.ndarray
    ancestors: int  # different first particles from which those below the last level descend
    evaluations: int
    first: np.ndarray  # values of the first particles: plain sampling, [N]
    last: np.ndarray  # particles below the last level, [M, dimensions]

    @classmethod
    def of_arrays(cls, fields: Mapping[str, np.ndarray]) -> Self:
        """Return the estimate whose fields were stored as arrays."""
        return cls(
            probability=fields["probability"],
            acceptance=fields["acceptance"],
            ancestors=int(fields["ancestors"]),
            evaluations=int(fields["evaluations"]),
            first=fields["first"],
            last=fields["last"],
        )


def pilot(
    problem: Problem,
    threshold: float,
    particles: int,
    moves: int,
    share: float,
    rng: np.random.Generator,
) -> Plan:
    """Choose levels that a share of the particles passes, and steps of which about a third are
    taken.

    ``moves`` are the proposals for each particle and level. Values that stop falling before the
    threshold, the last level, raise ``SplittingError``.
    """
    draws, values = _first(problem, particles, rng)
    evaluations, step = particles, 0.5
    levels: list[float] = []
    steps: list[float] = []
    while True:
        level = np.sort(values)[int(share * particles)]
        if level == np.inf:
            level = np.max(values, where=np.isfinite(values), initial=-np.inf) + 1.0
        # A level on a plateau of equal values would let none pass.
        passing = np.count_nonzero(values < level)
        stuck = passing < 2 or bool(levels and level >= levels[-1]) or len(levels) == _MOST_LEVELS
        if (level <= threshold or stuck) and np.any(values <= threshold):
            return Plan((*levels, threshold), tuple(steps), evaluations)
        if stuck:
            at = f"{levels[-1]:g}" if levels else "the beginning"
            raise SplittingError(
                f"the pilot stops at level {at} after {len(levels)} levels, its particles being "
                f"at {values.min():g} "
                f"at best; expected them to come below {threshold:g}: more particles or moves may"
            )
        levels.append(float(level))
        rows = _copies(values < level, particles, rng)
        draws, values = draws[rows], values[rows]
        for _ in range(moves):
            draws, values, accepted, flown = _move(problem, draws, values, levels[-1], step, rng)
            evaluations += flown
            step = float(
                np.clip(step * np.exp(accepted - _TARGET_ACCEPTANCE), _SMALLEST_STEP, _LARGEST_STEP)
            )
        steps.append(step)


def repetition(
    problem: Problem, plan: Plan, particles: int, moves: int, rng: np.random.Generator
) -> Repetition:
    """Return one unbiased estimate; arguments as of :func:`pilot`."""
    draws, values = _first(problem, particles, rng)
    first, evaluations = values, particles
    family = np.arange(particles)
    probability = np.zeros(len(plan.levels))
    acceptance = np.full(len(plan.steps), np.nan)
    product = 1.0
    for stage, level in enumerate(plan.levels):
        below = values < level
        product *= np.count_nonzero(below) / particles
        probability[stage] = product
        if stage == len(plan.steps) or not below.any():
            # Where none passes, this estimate is 0, and so it is at all levels after it.
            ancestors = np.unique(family[below]).size
            return Repetition(probability, acceptance, ancestors, evaluations, first, draws[below])
        rows = _copies(below, particles, rng)
        draws, values, family = draws[rows], values[rows], family[rows]
        shares = []
        for _ in range(moves):
            draws, values, accepted, flown = _move(
                problem, draws, values, level, plan.steps[stage], rng
            )
            evaluations += flown
            shares.append(accepted)
        acceptance[stage] = np.mean(shares)
    raise AssertionError("the last level ends the loop")


def _first(problem: Problem, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return independent particles of the distribution asked about, and their values."""
    draws = rng.standard_normal((count, problem.dimensions))
    values = problem.value(draws)
    for _ in range(_TRIES):
        outside = np.flatnonzero(np.isnan(values))
        if not outside.size:
            return draws, values
        draws[outside] = rng.standard_normal((outside.size, problem.dimensions))
        values[outside] = problem.value(draws[outside])
    raise SplittingError(f"particles do not meet the problem's conditions in {_TRIES} draws")


def _move(
    problem: Problem,
    draws: np.ndarray,
    values: np.ndarray,
    level: float,
    step: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Propose one step for every particle; return particles, values, share of steps taken and
    evaluations.
    """
    # Sizes do not depend on where a particle is, so that a step back is as likely as the step.
    size = step * _SPREAD ** -rng.random((len(values), 1))
    proposals = np.sqrt(1.0 - size**2) * draws + size * rng.standard_normal(draws.shape)
    proposed = problem.value(proposals)
    accepted = proposed < level
    draws = np.where(accepted[:, None], proposals, draws)
    return (
        draws,
        np.where(accepted, proposed, values),
        float(np.mean(accepted)),
        int(np.count_nonzero(~np.isnan(proposed))),
    )


def _copies(chosen: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return ``count`` row numbers among the chosen, each equally often but for a random
    remainder.
    """
    rows = np.flatnonzero(chosen)
    whole, remainder = divmod(count, rows.size)
    return np.concatenate([np.repeat(rows, whole), rng.choice(rows, remainder, replace=False)])
