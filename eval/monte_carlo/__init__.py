"""Encounters by the thousand with exact intervals: ``python -m eval.monte_carlo``."""
