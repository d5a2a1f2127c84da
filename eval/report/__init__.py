"""One page of an evaluation: ``python -m eval.report``."""
