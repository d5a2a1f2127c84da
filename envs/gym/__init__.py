"""The surrogate as Gymnasium environments."""
