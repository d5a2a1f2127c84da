"""A policy over a family of random aircraft: ``python -m eval.family``."""
