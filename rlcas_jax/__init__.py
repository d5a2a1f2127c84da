"""Training application: configuration, loop, checkpoints, metrics and figures."""
