"""The folder of a run of flights: as that of an evaluation in the surrogate, with another configuration and table."""

from eval.hifi.config import HifiConfig
from eval.runner.outputs import RunFolder

__all__ = ["HifiFolder"]


class HifiFolder(RunFolder):
    """The files of one run of flights."""

    model = HifiConfig
    table = "flights.parquet"
    schema = b"hifi 1"
