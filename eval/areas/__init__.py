"""Areas of the sky on a map: ``python -m eval.areas``."""
