"""Trainings over a space of settings: ``python -m rlcas_jax.sweep``."""
