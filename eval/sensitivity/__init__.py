"""What the success depends on: ``python -m eval.sensitivity``."""
