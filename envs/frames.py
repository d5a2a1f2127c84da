"""The frames that a state can be in, as types: ``VehicleState[Ground]`` is over the ground,
``VehicleState[Air]`` as the air mass sees it.

They differ by the wind, and only :mod:`envs.wind` takes a state from one into the other. Frames
exist for the type checker alone: at run time a state does not know its own, and is built as
``VehicleState(x, y, heading, speed)``. An annotation says which frame it is in, here or where it is
returned or handed on: ``own: VehicleState[Ground] = VehicleState(...)``.
"""

from envs.phantom import TypeVar


class Ground:
    """Over the ground: reports, waypoints, routes and areas."""


class Air:
    """In the air mass, which the wind carries over the ground: limits, policy and search."""


class Unframed:
    """Not said which: neither of both for the type checker."""


# A function with F takes states of either frame, all of them of the same one.
F = TypeVar("F", default=Unframed)
