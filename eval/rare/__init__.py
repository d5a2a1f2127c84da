"""Rare losses of separation by splitting: ``python -m eval.rare``."""
