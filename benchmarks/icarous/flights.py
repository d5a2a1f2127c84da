"""What a flight leaves for the judge."""

from typing import NamedTuple

import numpy as np

from benchmarks.icarous.judge import Track


class Flight(NamedTuple):
    """One mission flown by one side."""

    track: Track
    slowest: float  # processor time of the slowest answer, s; inf: unknown
    promised: np.ndarray  # at each time of the track, whether a plan called SAFE was flown, bool
    ended: str = ""  # why it ended before its time; "": it did not
