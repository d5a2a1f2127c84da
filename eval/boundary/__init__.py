"""The boundary of what can be resolved: ``python -m eval.boundary``."""
