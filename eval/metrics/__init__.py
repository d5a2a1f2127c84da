"""Numbers of the field for flights: rates, risk ratios with weights, volumes and their losses, costs."""

from eval.metrics.field import Cost, Ratio, costs, losses, ratio
from eval.metrics.summary import summarise
from eval.metrics.volumes import ALERTS, VOLUMES, Volume

__all__ = ["ALERTS", "VOLUMES", "Cost", "Ratio", "Volume", "costs", "losses", "ratio", "summarise"]
