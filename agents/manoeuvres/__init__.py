"""Simple manoeuvres and the search among them, which planner, witness and proof share."""

from agents.manoeuvres.direct_to_goal import DirectTask, clear
from agents.manoeuvres.escape_manoeuvre import Flight, Manoeuvre, fly
from agents.manoeuvres.escape_search import Escapes, search

__all__ = ["DirectTask", "Escapes", "Flight", "Manoeuvre", "clear", "fly", "search"]
