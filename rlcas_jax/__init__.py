"""Training application: configuration, loop, checkpoints, metrics and figures.

From Python: :func:`rlcas_jax.training.train`.
"""
