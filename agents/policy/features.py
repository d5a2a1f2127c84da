"""Inputs that the network derives from the eight numbers of an observation inside its own forward
pass.

They say in the ownship's frame what a conflict is about: whether, when and on which side the
aircraft will pass.
"""

from agents.policy.set_features import PassingUnits, passing, soft
from envs.aircraft import PAPER
from envs.arrays import Array, ArrayModule
from envs.observation import decode

FEATURE_SETS = ("none", "mirror")
"""``none``: the bare observation (the paper's set-up); ``mirror``: geometry and closest point of
approach, with every scene seen so that the intruder is left of the line to the goal: an exactly
symmetric policy."""

_SIZES = {"none": 8, "mirror": 22}
_FAR = 10.0 * PAPER.separation
# of :func:`passing`, for m and m/s
_UNITS = PassingUnits(
    slow=25.0,
    horizon=300.0,
    per_time=1.0 / 60.0,
    per_length=1.0 / 1_000.0,
    per_far=1.0 / 5_000.0,
    floor=1.0,
)

_INTRUDER, _GOAL = 4, 6  # bearings in the observation, left positive


def size(feature_set: str) -> int:
    """Return the number of inputs of the first layer; raises a ValueError for an unknown set."""
    if feature_set not in _SIZES:
        raise ValueError(
            f"feature set {feature_set!r} is unknown; expected one of {', '.join(FEATURE_SETS)}"
        )
    return _SIZES[feature_set]


def mirror_sign(observation: list[Array], feature_set: str, xp: ArrayModule) -> Array:
    """Return the factor of the network's yaw rate, ``[...]`` or 1.0: -1 where the scene is seen
    mirrored.

    The scene is mirrored where the intruder is to the right of the line to the goal. That line
    moves with the positions alone; by the intruder's bearing, which a turn changes at once, a
    policy came to flutter behind an intruder.
    """
    if feature_set != "mirror":
        return 1.0
    # The sine of the angle from the goal to the intruder has the sign of the angle within half a
    # turn, and the other one beyond. Not a choice between constants, which numpy would widen to
    # float64; -0.0 counts as left.
    angle = observation[_INTRUDER] - observation[_GOAL] + 1e-30
    return xp.copysign(1.0, angle) * xp.copysign(1.0, 1.0 - xp.abs(angle))


def features(observation: list[Array], feature_set: str, xp: ArrayModule) -> list[Array]:
    """Return the inputs of the network's first layer, :func:`size` times ``[...]``, all within
    about [-3, 3].

    They are derived from the eight components of the contract, ``[...]`` each, by one of
    :data:`FEATURE_SETS`.
    """
    size(feature_set)
    if feature_set == "none":
        return list(observation)
    sign = mirror_sign(observation, feature_set, xp)
    geometry = decode(observation, PAPER, xp)
    x, y = geometry.intruder_x, geometry.intruder_y
    far = observation[5] + 1.0
    goal_far = observation[7] + 1.0
    guard = 1e-3
    goal_range = goal_far * _FAR + guard
    goal_cosine, goal_sine = geometry.goal_x / goal_range, geometry.goal_y / goal_range
    intruder_range = far * _FAR + guard

    vx, vy = geometry.intruder_vx - geometry.own_speed, geometry.intruder_vy
    ahead = passing(x, y, vx, vy, _UNITS, xp)
    # The same question for the course that leads straight to the goal: is it time to turn back?
    from_goal_x = geometry.intruder_vx - geometry.own_speed * goal_cosine
    from_goal_y = geometry.intruder_vy - geometry.own_speed * goal_sine
    to_goal = passing(x, y, from_goal_x, from_goal_y, _UNITS, xp)
    return [
        observation[0],
        observation[2],
        geometry.intruder_vx * 0.01,
        geometry.intruder_vy * 0.01 * sign,
        x / intruder_range,
        y / intruder_range * sign,
        observation[5],
        soft((intruder_range - 1_000.0) * (1.0 / 1_000.0), xp),
        goal_cosine,
        goal_sine * sign,
        observation[7],
        soft(goal_range * (1.0 / 1_000.0), xp),
        vx * 0.01,
        (x * vx + y * vy) / (intruder_range * 100.0),
        *(
            value
            for time, miss, far, depth in (ahead, to_goal)
            for value in (time, miss * sign, far * sign, depth)
        ),
    ]
