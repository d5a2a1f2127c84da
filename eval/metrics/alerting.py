"""When a flight is first alerted of a loss of a standard's volume: one rule for all resolvers.

Once a time step the volume's loss is predicted from the reports, on straight courses and even
climbs of both aircraft. The levels follow as :mod:`agents.assurance.alerts` has them, with the
times of DO-365 (Phase I, NASA's ``DO_365B_no_SUM.conf``): corrective at 55 s, warning at 25 s, left
after 75 s and 55 s, two of four looks. F3442 publishes no times; the same are used.
"""

import numpy as np

from agents.assurance.alerts import Alerting, Level, Times, no_alerts, update
from envs.frames import F
from eval.flights.trajectories import Trajectories
from eval.metrics.volumes import Relative, Volume, is_lost, relative

ALERTING = Alerting(
    reached=Times(55.0, 55.0, 25.0), left=Times(75.0, 75.0, 55.0), hold=4.0, forget=5.0
)
"""A preventive level of its own does not exist: its volume is another."""

_PERIOD = 1.0  # s between the moments at which a predicted loss is looked for


def time_to_loss(
    volume: Volume, relative_state: Relative, climb: np.ndarray | float, look_ahead: float
) -> np.ndarray:
    """Return after how many whole seconds a volume is lost if velocities and climbs, m/s, relative
    to the ownship, stay as they are, ``[...]``; inf: not within the look-ahead, s.
    """
    loss = np.full(np.shape(relative_state.x), np.inf)
    with np.errstate(invalid="ignore"):
        for ahead in np.arange(look_ahead, -0.5 * _PERIOD, -_PERIOD):
            later = relative_state._replace(
                x=relative_state.x + ahead * relative_state.vx,
                y=relative_state.y + ahead * relative_state.vy,
                z=relative_state.z + ahead * climb,
            )
            loss = np.where(is_lost(volume, later), ahead, loss)
    return loss


def first_alert(
    volume: Volume, reported: Trajectories[F], dt: float, alerting: Alerting = ALERTING
) -> np.ndarray:
    """Return when flights with time steps of dt, s, are first alerted at the corrective level or
    above, s, ``[N]``; inf: never.

    The intruders are as reported, not a number where nobody reports one.
    """
    motion = relative(reported)
    loss = time_to_loss(volume, motion, _climb(motion, dt), max(alerting.left))
    there = np.isfinite(motion.x)
    _, count, most = there.shape
    shown, first = no_alerts(count, most, alerting), np.full(count, np.inf)
    for number, mask in enumerate(there):
        time = np.full(first.size, number * dt)
        shown = update(shown, time, loss[number], mask, alerting)
        alerted = (shown.level >= Level.CORRECTIVE).any(axis=-1)
        first = np.where(alerted, np.minimum(first, time), first)
    return first


def _climb(motion: Relative, dt: float) -> np.ndarray | float:
    """Return climbs relative to the ownship since the step before, m/s, ``[T + 1, N, K]``."""
    if np.ndim(motion.z) == 0:
        return 0.0
    rise = np.diff(motion.z, axis=0) / dt
    return np.concatenate([rise[:1], rise])
