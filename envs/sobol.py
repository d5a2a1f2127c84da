"""Quasi-random encounters: scrambled Sobol points by number, in several independent randomisations.

Encounter i is point i // R of randomisation i mod R (R = :data:`REPLICATES`), so that it is the same wherever and with
however many others it is drawn, and so that the first N encounters are the first N / R points of every randomisation.
Points of one randomisation fill the cube evenly, which is why their mean is closer than that of independent draws and
why no interval of independent draws fits it; randomisations are independent, and an interval comes from these.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from envs.encounters import Encounter, EncounterError, Scenario, sample
from envs.starts import numbered
from envs.trees import mapped

__all__ = ["REPLICATES", "QuasiScenario", "quasi", "quasi_numbered", "sobol"]

REPLICATES = 16
"""Independent randomisations R."""

_MOST = 2**30
"""Points of one randomisation: its numbers have 30 bits."""


@dataclass(frozen=True)
class QuasiScenario(Scenario):
    """A scenario whose encounters are drawn by :func:`quasi_numbered`."""


def quasi(scenario: Scenario) -> QuasiScenario:
    """Return the scenario, to be drawn quasi-randomly."""
    return QuasiScenario(**{field.name: getattr(scenario, field.name) for field in fields(scenario)})


def sobol(seed: int, first: int, count: int, dimensions: int) -> np.ndarray:
    """Return the unit-uniform draws of the encounters ``first .. first + count - 1``.

    Direction numbers are those of Joe and Kuo (2008). Each randomisation is a random linear matrix scramble with a
    digital shift (Matousek, 1998): every point is uniform, and a mean has the variance of Owen's nested scrambling.

    Args:
        seed: of the run, 0 .. 2**64 - 1.
        first: number of the first encounter.
        count: how many encounters.
        dimensions: draws that one encounter takes.

    Returns:
        Float64 in [0, 1), ``[count, dimensions]``.

    Raises:
        EncounterError: there are not so many points.
    """
    if first + count > REPLICATES * _MOST:
        raise EncounterError(f"encounter {first + count - 1} is out of range; expected less than {REPLICATES * _MOST}")
    draws = np.empty((count, dimensions))
    for begin in range(min(REPLICATES, count)):
        point, replicate = divmod(first + begin, REPLICATES)
        rows = draws[begin::REPLICATES]
        rows[:] = _points(seed, replicate, point, len(rows), dimensions)
    return draws


def quasi_numbered(scenario: Scenario, seed: int, first: int, count: int) -> Encounter:
    """Return the encounters ``first .. first + count - 1`` of a seed, as :func:`envs.starts.numbered` does.

    A Sobol point is an encounter's only quasi-random attempt. Where it does not meet the scenario's conditions, the
    encounter is the pseudo-random one of that seed and number, so that the distribution is the scenario's own.

    Raises:
        EncounterError: seed or number are out of range, or the scenario's conditions are never met.
    """
    if not 0 <= seed < 2**64:
        raise EncounterError(f"seed is {seed}; expected 0 <= seed < 2**64")
    if first < 0:
        raise EncounterError(f"encounter number is {first}; expected 0 or more")
    encounter, accepted = sample(scenario, sobol(seed, first, count, scenario.dimensions)[None], np)
    rejected = np.flatnonzero(~accepted)
    if not rejected.size:
        return encounter
    others = [numbered(scenario, seed, first + int(row), 1) for row in rejected]

    def replaced(field: np.ndarray, *new: np.ndarray) -> np.ndarray:
        whole = np.array(field)
        whole[rejected] = np.concatenate(new)
        return whole

    return mapped(replaced, encounter, *others)


def _points(seed: int, replicate: int, point: int, count: int, dimensions: int) -> np.ndarray:
    """Return consecutive points of one randomisation, ``[count, dimensions]``."""
    from scipy.stats import qmc

    # A generator of its own: SeedSequence keeps these apart from the Philox streams that are keyed by the seed itself.
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence((seed, replicate, dimensions))))
    engine: Any = qmc.Sobol(dimensions, scramble=True, rng=rng)
    if point:
        return engine.fast_forward(point).random(count)
    # From the beginning whole powers of two are asked for: of others the library warns.
    return engine.random(1 << (count - 1).bit_length())[:count]
