"""Trajectories of flights, recorded step by step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from envs.encounters import Encounter
from envs.kinematics import VehicleState
from envs.observation import SIZE

__all__ = ["Film", "Trajectories", "until"]


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


def until(film: Trajectories, end: np.ndarray) -> Trajectories:
    """Return trajectories one second a step without what comes after the step in which ``end``, s, ``[N]``, falls."""
    after = np.arange(len(film.own.x))[:, None] > np.ceil(end)
    late = after[1:, :, None]
    return Trajectories(
        VehicleState(*(np.where(after, np.nan, field) for field in film.own)),
        VehicleState(*(np.where(after[..., None], np.nan, field) for field in film.intruders)),
        np.where(late, np.nan, film.observation),
        np.where(late, np.nan, film.action),
        np.where(late[..., 0], np.nan, film.separation),
    )


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
        """Return everything recorded; a step without anybody, if nobody ever flew."""
        if not self._decisions:
            nobody, others = np.zeros(0), np.zeros((0, self._intruders[0].shape[1]))
            blank = np.zeros((0, SIZE)), np.zeros((0, 2)), nobody
            self.expose(nobody.astype(int), VehicleState(*[nobody] * 4), VehicleState(*[others] * 4), blank)
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
