"""Failed flights, sorted and drawn: ``python -m eval.failures``."""
