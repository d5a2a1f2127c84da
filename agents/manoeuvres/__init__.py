"""Simple manoeuvres and the search among them, which planner, witness and proof share."""

from agents.manoeuvres.direct_to_goal import Task, clear
from agents.manoeuvres.escape_manoeuvre import Flight, Manoeuvre, fly
from agents.manoeuvres.escape_search import Found, search

__all__ = ["Flight", "Found", "Manoeuvre", "Task", "clear", "fly", "search"]
