"""Encounters flown by ArduPlane itself: its mission alone, its own avoidance, and ours."""
