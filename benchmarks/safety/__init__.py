"""Attacks on SAFE: ``python -m benchmarks.safety``."""
