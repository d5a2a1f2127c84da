"""Missions among fences, traffic and wind, flown by NASA's ICAROUS and by us."""
