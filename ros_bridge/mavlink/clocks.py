"""What clocks show: the autopilot's, ours, and this process's own time of computing."""

from typing import NamedTuple


class Spent(NamedTuple):
    """Time that has passed, and what of it this process has computed, s."""

    wall: float
    computed: float


NO_TIME = Spent(0.0, 0.0)


class Moment(NamedTuple):
    """What the clocks show at once."""

    time: int  # of the autopilot, ns; 0: it has not been heard yet
    spent: Spent  # since some time of our own
    speed: float = 1.0  # how many times as fast as ours the autopilot's clock runs
    races: bool = False  # whether that is too fast for what is promised
