"""Numbers of the field for flights: rates, risk ratios with weights, volumes and their losses,
costs.
"""

from eval.metrics.summary import summarise
from eval.metrics.volumes import VOLUMES, Volume, costs, losses
from eval.metrics.weighted import Ratio, ratio

__all__ = ["VOLUMES", "Ratio", "Volume", "costs", "losses", "ratio", "summarise"]
