"""The aircraft that an evaluation flies, in words, and what to beware of where it is not the one expected."""

import math
from collections.abc import Mapping
from typing import Any

from envs.kinematics import SURROGATE, Limits

__all__ = ["flown_limits", "lines_about"]


def flown_limits(flown: Limits, policy: Limits, *, named: bool) -> dict[str, Any]:
    """Return what a summary says of the aircraft, in JSON types.

    Args:
        flown: limits of the ownship.
        policy: limits that the policy was trained for.
        named: whether the configuration names the aircraft; otherwise it is the policy's, by its own word.
    """
    warning = None
    if flown != policy:
        warning = f"the policy was trained for another aircraft: {_described(policy)}"
    elif not named and flown != SURROGATE:
        warning = "these limits are the policy file's own and not the paper's; the key vehicle names an aircraft"
    return {"limits": flown._asdict(), "policy_limits": policy._asdict(), "aircraft_warning": warning}


def lines_about(summary: Mapping[str, Any]) -> list[str]:
    """Return what a table or a page says of :func:`flown_limits`; nothing where a summary of old does not know it."""
    if "limits" not in summary:
        return []
    warning = summary["aircraft_warning"]
    return [f"aircraft: {_described(Limits(**summary['limits']))}", *([f"warning: {warning}"] if warning else [])]


def _described(limits: Limits) -> str:
    """Return limits in one line."""
    return (
        f"{limits.speed_min:g} to {limits.speed_max:g} m/s, {limits.acceleration_min:g} to "
        f"{limits.acceleration_max:g} m/s², {math.degrees(limits.yaw_rate_max):.4g} deg/s"
    )
