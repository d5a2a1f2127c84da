"""What a plan may miss, for rounding's sake: the theorem allows for it."""

JOINT = 1e-3 + 1e-6
"""By which the end of a leg may miss its waypoint, m."""

MARGIN = 1e-3 + 2e-6
"""By which a distance may fall short of the margin, m."""

ROUNDING = 3e-6
"""By which a distance may fall short of the separation itself, m."""

NEARER = 0.01
"""By which a plan that begins inside a clearance may come nearer to the area, m."""

FINE = 2e-6
"""Of speeds and climbs (m/s), accelerations (m/s^2) and headings (rad)."""

LEVEL = 2e-6
"""Of altitudes (m) and of the times at which climbs change (s)."""

TURN = 2e-9
"""Of turn rates, rad/s."""

CONTROLS = 1e-8
"""By which stated controls may differ from those of the curve, rad/s and m/s^2."""

LEAST_SAGITTA = 1e-12
"""Least sagitta of a part, m."""
