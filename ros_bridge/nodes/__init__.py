"""The nodes: runner, monitor, simulator, translator and pilot."""
