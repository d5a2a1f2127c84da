"""The aircraft that an evaluation flies, in words, and what to beware of where it is not the one expected."""

import math
from typing import Any

from envs.kinematics import SURROGATE, Limits

__all__ = ["described", "flown_limits"]


def described(limits: Limits) -> str:
    """Return limits in one line."""
    return (
        f"{limits.speed_min:g} to {limits.speed_max:g} m/s, {limits.acceleration_min:g} to "
        f"{limits.acceleration_max:g} m/s², {math.degrees(limits.yaw_rate_max):.4g} deg/s"
    )


def flown_limits(flown: Limits, policy: Limits, *, named: bool) -> dict[str, Any]:
    """Return what a summary says of the aircraft, in JSON types.

    Args:
        flown: limits of the ownship.
        policy: limits that the policy was trained for.
        named: whether the configuration names the aircraft; otherwise it is the policy's, by its own word.
    """
    warning = None
    if flown != policy:
        warning = f"the policy was trained for another aircraft: {described(policy)}"
    elif not named and flown != SURROGATE:
        warning = "these limits are the policy file's own and not the paper's; the key vehicle names an aircraft"
    return {"limits": flown._asdict(), "policy_limits": policy._asdict(), "aircraft_warning": warning}
