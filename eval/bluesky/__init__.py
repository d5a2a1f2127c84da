"""The policy in BlueSky: a conflict-resolution method of the simulator, and a pilot of
BlueSky-Gym's environment.
"""
