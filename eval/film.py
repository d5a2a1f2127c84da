"""Trajectories of flights, recorded step by step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from envs.encounters import Encounter
from envs.kinematics import VehicleState

__all__ = ["Film", "Trajectories"]


class Trajectories(NamedTuple):
    """What was flown, at T + 1 times one time step apart; NaN after an encounter's end."""

    own: VehicleState
    """Fields ``[T + 1, N]``."""
    intruders: VehicleState
    """Fields ``[T + 1, N, K]``."""
    observation: np.ndarray
    """``[T, N, 8]``, at the beginning of each step."""
    action: np.ndarray
    """``[T, N, 2]``."""
    separation: np.ndarray
    """Smallest distance to any intruder during each step, m, ``[T, N]``."""


class Film:
    """Records trajectories step by step."""

    def __init__(self, encounters: Encounter) -> None:
        """Begin with the starts ``[N]``."""
        self._count = len(encounters.goal_x)
        self._own = [np.stack(encounters.own, axis=-1)]
        self._intruders = [np.stack(encounters.intruders, axis=-1)]
        self._decisions: list[list[np.ndarray]] = []

    def expose(
        self, number: np.ndarray, own: VehicleState, intruders: VehicleState, decisions: Sequence[np.ndarray]
    ) -> None:
        """Add a step of those still in the air.

        Args:
            number: their rows, ``[M]``.
            own, intruders: at the end of the step, ``[M]`` and ``[M, K]``.
            decisions: observation, action and separation of the step, ``[M, ...]`` each.
        """
        self._own.append(self._all(number, np.stack(own, axis=-1)))
        self._intruders.append(self._all(number, np.stack(intruders, axis=-1)))
        self._decisions.append([self._all(number, values) for values in decisions])

    def developed(self) -> Trajectories:
        """Return everything recorded."""
        own, traffic = np.stack(self._own), np.stack(self._intruders)
        return Trajectories(
            VehicleState(*np.moveaxis(own, -1, 0)),
            VehicleState(*np.moveaxis(traffic, -1, 0)),
            *(np.stack(parts) for parts in zip(*self._decisions, strict=True)),
        )

    def _all(self, number: np.ndarray, values: np.ndarray) -> np.ndarray:
        everybody = np.full((self._count, *values.shape[1:]), np.nan, values.dtype)
        everybody[number] = values
        return everybody
