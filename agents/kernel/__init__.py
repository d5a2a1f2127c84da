"""How close what is flown comes to intruders and areas: their motion, distances with proven
bounds, and when each of them counts.
"""
