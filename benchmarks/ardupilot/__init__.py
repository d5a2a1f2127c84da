"""The real ArduPlane, in its own simulation, with and without us."""
