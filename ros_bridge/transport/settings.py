# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Parameters declared on a node, and read back as the settings of what decides."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor

from agents.assurance.thresholds import Thresholds
from agents.planner.options import Options
from agents.planner.traffic import Requirement
from envs.aircraft import PAPER
from envs.kinematics import SURROGATE, Limits, within
from ros_bridge.core.situation import Settings
from ros_bridge.core.tracks import Rules
from ros_bridge.transport.overrides import refuse_unknown_parameters
from ros_bridge.transport.parameters import NUMBERS, OTHERS, Number

__all__ = ["aircraft_text", "declare", "monitor_thresholds", "planning_settings", "report_rules", "vehicle_limits"]

_KEPT = 0.5
"""Share of the sigmas planned with that must be left before a new plan is asked for: what is believed of an intruder
wanders inside its uncertainty, and a plan that needs all of it would be void with every second report."""


def declare(node: Any, numbers: Sequence[Number] = NUMBERS, others: Sequence[tuple[str, Any, str]] = OTHERS) -> None:
    """Declare parameters on a node; a value out of its range, NaN too, is refused by ROS.

    Raises:
        ValueError: a value was given for a parameter that the node does not have.
    """
    for one in numbers:
        unit = f", {one.unit}" if one.unit else ""
        span = FloatingPointRange(from_value=float(one.low), to_value=float(one.high))
        descriptor = ParameterDescriptor(description=one.meaning + unit, floating_point_range=[span])
        node.declare_parameter(one.name, float(one.default), descriptor)
    for name, default, meaning in others:
        fixed = isinstance(default, str) or "read at the start" in meaning
        node.declare_parameter(name, default, ParameterDescriptor(description=meaning, read_only=fixed))
    try:
        refuse_unknown_parameters(node, [*(one.name for one in numbers), *(name for name, *_ in others)])
    except ValueError:
        node.destroy_node()
        raise


def aircraft_text(node: Any) -> str:
    """Return the aircraft that a node's parameters describe, and what it keeps from others, as a text."""

    def value(name: str) -> float:
        return node.get_parameter(name).value

    speed, acceleration = (
        f"{value(f'{name}_min'):g} to {value(f'{name}_max'):g}" for name in ("speed", "acceleration")
    )
    kept = f"separation {value('separation'):g} m, margin {value('margin'):g} m"
    return f"{speed} m/s, {acceleration} m/s^2, {value('yaw_rate_max'):g} deg/s; {kept}"


def vehicle_limits(value: Callable[[str], Any]) -> tuple[Limits, Limits]:
    """Return what legs must obey, the aircraft's limits, and those that are the surrogate's, too, for manoeuvres.

    Args:
        value: the value of a parameter by its name.

    Raises:
        ValueError: the aircraft and the surrogate have no speeds in common.
    """
    legs = Limits(
        *(value("speed_min"), value("speed_max"), value("acceleration_min"), value("acceleration_max")),
        math.radians(value("yaw_rate_max")),
    )
    try:
        return legs, within(SURROGATE, legs)
    except ValueError as problem:
        raise ValueError(f"speed_min, speed_max: {problem}") from None


def planning_settings(node: Any) -> Settings:
    """Return how plans shall be, from a node's parameters."""

    def value(name: str) -> Any:
        return node.get_parameter(name).value

    legs, _ = vehicle_limits(value)
    options = Options.for_aircraft(
        PAPER,
        legs,
        requirement=Requirement(value("separation"), value("margin"), value("sigmas")),
        rejoin_by=value("rejoin_by"),
        extend_route=value("extend_route"),
        vertical_filter=value("vertical_filter"),
        max_age=value("intruder_max_age"),
        exhaustive=value("exhaustive"),
    )
    return Settings(
        ownship_age=value("ownship_max_age"),
        intruder_age=value("intruder_max_age"),
        alert_age=value("alert_max_age"),
        request_age=value("request_max_age"),
        future=value("future_tolerance"),
        wind_max=value("wind_max"),
        options=options,
    )


def report_rules(node: Any) -> Rules:
    """Return what reports must keep to, from a node's parameters."""
    names = {"future": "future_tolerance", "jump_distance": "jump_distance", "jump_speed": "jump_speed"}
    return Rules(**{field: node.get_parameter(name).value for field, name in names.items()})


def monitor_thresholds(node: Any) -> Thresholds:
    """Return when the monitor acts, from a node's parameters."""

    def value(name: str) -> Any:
        return node.get_parameter(name).value

    legs, flown = vehicle_limits(value)
    wanted = Requirement(value("separation"), value("margin"), _KEPT * value("sigmas"))
    return Thresholds.for_plans(
        Options.for_aircraft(PAPER, legs, requirement=wanted),
        manoeuvre=flown,
        cross_track=value("cross_track"),
        along_track=value("along_track"),
        time_error=value("time_error"),
        intruder_position=value("intruder_position"),
        intruder_velocity=value("intruder_velocity"),
        replan_interval=value("replan_interval"),
        answer_time=value("answer_time"),
        own_age=value("ownship_max_age"),
        intruder_age=value("intruder_max_age"),
    )
