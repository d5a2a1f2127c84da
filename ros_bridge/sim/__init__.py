"""The simulator behind its node: world, receivers, guidance and log."""
