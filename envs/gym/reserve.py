"""Numbered starts drawn in advance, so that encounters can begin without waiting for the sampler."""

import numpy as np

from envs.encounters import Encounter, EncounterError, Scenario
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.starts import cast, joined, numbered
from envs.trees import take

_LEAST = 1_024  # fewest starts drawn at a time, so that drawing is seldom


class Reserve:
    """The next encounters of a seed by their numbers, each drawn once.

    ``rows`` holds them in single precision, ``[P]`` with a P that never changes; those before ``used`` are taken. At
    least ``count`` are always left.

    Args:
        scenario: the family.
        seed: of the run.
        first: number of the first encounter.
        count: most encounters taken at a time.
        columns: intruder columns K of the rows.

    Raises:
        EncounterError: the scenario has more intruders than there are columns, or its conditions are never met.
    """

    def __init__(self, scenario: Scenario, seed: int, first: int, count: int, columns: int) -> None:
        if scenario.intruders[1] > columns:
            raise EncounterError(
                f"the encounters given have {columns} intruder columns and scenario {scenario.name!r}, which follows "
                f"them, has {scenario.intruders[1]}; widen the encounters by masked columns or choose another scenario"
            )
        self._scenario, self._seed, self._count, self._columns = scenario, seed, count, columns
        self._size = count + max(count, _LEAST)
        self._first = first
        self.used = 0
        self.rows = self._draw(first, self._size)

    def take(self, count: int) -> bool:
        """Take the next starts; return whether ``rows`` has been filled up again and ``used`` set back to 0."""
        self.used += count
        if self._size - self.used >= self._count:
            return False
        left = take(self.rows, slice(self.used, None))
        self._first += self.used
        self.rows = joined(left, self._draw(self._first + self._size - self.used, self.used))
        self.used = 0
        return True

    def _draw(self, first: int, count: int) -> Encounter:
        drawn = cast(numbered(self._scenario, self._seed, first, count), np.float32)
        have = drawn.mask.shape[-1]
        # Columns that the scenario does not have repeat its last intruder and are masked.
        column = np.minimum(np.arange(self._columns), have - 1)
        return drawn._replace(
            intruders=VehicleState(*(field[:, column] for field in drawn.intruders)),
            intent=Intent(*(field[:, column] for field in drawn.intent)),
            mask=drawn.mask[:, column] & (np.arange(self._columns) < have),
        )
