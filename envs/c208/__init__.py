"""The true aircraft: a Cessna 208B in JSBSim under an autopilot, and its low-fidelity
counterpart.
"""
