"""Rare violations by splitting: ``python -m eval.rare``."""
