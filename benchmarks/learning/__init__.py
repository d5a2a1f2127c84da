"""Learning curves beside the peers': ``python -m benchmarks.learning``."""
