"""The world: kinematics, observation, encounters, outcome and their adapters."""
