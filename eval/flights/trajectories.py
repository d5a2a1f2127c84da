"""Trajectories of flights, recorded step by step."""

from typing import Generic, NamedTuple

import numpy as np

from envs.altitudes import at_step
from envs.encounters import Encounter
from envs.frames import Air, F
from envs.kinematics import VehicleState
from envs.trees import map_leaves


class Trajectories(NamedTuple, Generic[F]):
    """Flights at T + 1 times one time step apart; NaN after an encounter's end."""

    own: VehicleState[F]  # fields [T + 1, N]
    intruders: VehicleState[F]  # fields [T + 1, N, K]
    action: np.ndarray  # [T, N, 2]; NaN where no action decides
    separation: np.ndarray  # smallest distance to any intruder during each step, m, [T, N]
    altitudes: "FlownAltitudes | None" = None  # None: all are at one level


class FlownAltitudes(NamedTuple):
    """Altitudes at the same times, m."""

    own: np.ndarray  # [T + 1, N]
    intruders: np.ndarray  # [T + 1, N, K]


def until(flown: Trajectories[F], end: np.ndarray, dt: float) -> Trajectories[F]:
    """Return trajectories of steps of dt, s, without what comes after the step in which ``end``, s,
    ``[N]``, falls.
    """
    after = np.arange(len(flown.own.x))[:, None] > np.ceil(end / dt)

    def cut(field: np.ndarray) -> np.ndarray:
        late = after[-len(field) :]  # steps are one fewer than states
        return np.where(late if field.ndim == 2 else late[..., None], np.nan, field)

    return map_leaves(cut, flown)


class TrajectoryRecorder:
    """Collects the steps of flights ``[N]``, of which fewer and fewer are in progress."""

    def __init__(self, encounters: Encounter) -> None:
        """Begin with the starts ``[N]``."""
        self._count = len(encounters.goal_x)
        self._own = [np.stack(encounters.own, axis=-1)]
        self._intruders = [np.stack(encounters.intruders, axis=-1)]
        self._steps: list[list[np.ndarray]] = []
        self._altitudes = encounters.altitudes
        self._own_altitude = [] if encounters.altitudes is None else [encounters.altitudes.own]

    def append(
        self,
        rows: np.ndarray,
        own: VehicleState[Air],
        intruders: VehicleState[Air],
        separation: np.ndarray,
        action: np.ndarray | None = None,
        own_altitude: np.ndarray | None = None,
    ) -> None:
        """Add a step of the flights in progress, by their numbers ``[M]``: states ``[M]`` and ``[M,
        K]`` at its end.

        The separation is the smallest to any intruder during the step, m, ``[M]``; no action where
        none decides. An own altitude that is not given is that of the start.
        """
        action = np.full((rows.size, 2), np.nan) if action is None else action
        self._own.append(self._all(rows, np.stack(own, axis=-1)))
        self._intruders.append(self._all(rows, np.stack(intruders, axis=-1)))
        self._steps.append([self._all(rows, values) for values in (action, separation)])
        if self._altitudes is not None:
            level = self._altitudes.own[rows]
            altitude = level if own_altitude is None else own_altitude
            self._own_altitude.append(self._all(rows, altitude))

    def stack(self) -> Trajectories[Air]:
        """Return everything recorded; one empty step if nothing was."""
        if not self._steps:
            none, others = np.zeros(0), np.zeros((0, self._intruders[0].shape[1]))
            nobody: VehicleState[Air] = VehicleState(none, none, none, none)
            self.append(
                none.astype(int), nobody, VehicleState(others, others, others, others), none
            )
        own, traffic = np.stack(self._own), np.stack(self._intruders)
        return Trajectories(
            VehicleState(*np.moveaxis(own, -1, 0)),
            VehicleState(*np.moveaxis(traffic, -1, 0)),
            *(np.stack(parts) for parts in zip(*self._steps, strict=True)),
            altitudes=self._flown_altitudes(),
        )

    def _flown_altitudes(self) -> FlownAltitudes | None:
        """Return the altitudes of everything recorded; None: all are at one level."""
        if self._altitudes is None:
            return None
        own = np.stack(self._own_altitude)
        rows = self._altitudes.intruders
        intruders = np.stack([at_step(rows, np.full((1, 1), float(t))) for t in range(len(own))])
        return FlownAltitudes(own, np.where(np.isfinite(own)[..., None], intruders, np.nan))

    def _all(self, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        every = np.full((self._count, *values.shape[1:]), np.nan, values.dtype)
        every[rows] = values
        return every
