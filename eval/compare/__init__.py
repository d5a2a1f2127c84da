"""Peers on the same encounters, paired: ``python -m eval.compare``."""
