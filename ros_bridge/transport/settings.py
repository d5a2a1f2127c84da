"""Parameters declared on a node, and read back as the settings of what decides."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Requirement
from agents.planner.answer import RequestError
from agents.planner.request.options import (
    Maneuvers,
    Options,
    check,
    default_vertical_margin,
)
from envs.aircraft import Aircraft
from envs.areas import Level
from envs.kinematics import Limits
from ros_bridge.core.aircraft import aircraft_of, load_extensions
from ros_bridge.core.categories import Categories, separations_of
from ros_bridge.core.conversions import ALTITUDE_CODES
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.motion import Turns
from ros_bridge.core.reports import Unknown
from ros_bridge.core.tasks import Settings
from ros_bridge.core.tracks import Rules
from ros_bridge.transport.overrides import refuse_unknown_parameters
from ros_bridge.transport.parameters import Parameter, of

_SAME = (
    "rejoin_by",
    "waypoints",
    "spacing",
    "extend_route",
    "vertical_filter",
    "unknown_climb",
    "exhaustive",
)
_OPTIONS = {
    "max_age": "intruder_max_age",
    "deadline_s": "deadline",
    "vertical_margin": "vertical_margin_m",
} | {name: name for name in _SAME}
_RENAMED = _OPTIONS | {
    "aircraft.goal_radius": "goal_radius",
    "floor": "floor_m",
    "floor.value": "floor_m",
    "ceiling": "ceiling_m",
    "ceiling.value": "ceiling_m",
}
"""Parameters by the names that the planner's options have."""


def declare(node: Node, kind: str) -> Aircraft | None:
    """Declare the parameters of a kind of nodes, and return the aircraft that they name; None where
    there is none.

    A value out of its range, NaN too, is refused by ROS; one for a parameter that there is not, by
    ValueError.
    """
    mine, aircraft = list(of(kind)), None
    if mine[0].name == "aircraft":
        # The numbers follow from it.
        first = mine[:3]
        for parameter in first:
            node.declare_parameter(parameter.name, parameter.default, _descriptor(parameter))
        file, policy_file, extensions = (
            node.get_parameter(parameter.name).value for parameter in first
        )
        load_extensions(extensions)
        aircraft = aircraft_of(file, policy_file)
    for parameter in parameters_of(kind, aircraft):
        if not node.has_parameter(parameter.name):
            node.declare_parameter(parameter.name, parameter.default, _descriptor(parameter))
    refuse_unknown_parameters(node, [parameter.name for parameter in mine])
    return aircraft


def parameters_of(kind: str, aircraft: Aircraft | None) -> Iterator[Parameter]:
    """Yield the parameters of a kind of nodes for an aircraft, in SI units and degrees."""
    aircraft_values: dict[str, float] = Freshness()._asdict()
    if aircraft is not None:
        legs = aircraft.vehicle_limits
        aircraft_values |= legs._asdict() | {
            "yaw_rate_max": round(math.degrees(legs.yaw_rate_max), 9)
        }
        aircraft_values |= {name: getattr(aircraft, name) for name in ("separation", "goal_radius")}
        vertical = aircraft.vertical
        aircraft_values["vertical_margin"] = (
            0.0 if vertical is None else default_vertical_margin(vertical)
        )
        aircraft_values |= Freshness.for_aircraft(aircraft)._asdict()
    return (parameter.in_si(aircraft, aircraft_values) for parameter in of(kind))


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    text = f"{parameter.help}, {parameter.unit}" if parameter.unit else parameter.help
    descriptor = ParameterDescriptor(description=text, read_only=parameter.fixed)
    if (
        parameter.low is not None
        and parameter.high is not None
        and isinstance(parameter.default, int)
    ):
        descriptor.integer_range = [
            IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high), step=1)
        ]
    elif parameter.low is not None and parameter.high is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(parameter.low), to_value=float(parameter.high))
        ]
    return descriptor


def limits_of(value: Callable[[str], Any]) -> Limits:
    """Return what the vehicle can do by the parameters' values."""
    limits = Limits(**{name: value(name) for name in Limits._fields})
    return limits._replace(yaw_rate_max=math.radians(limits.yaw_rate_max))


AGREED = "runner and monitor agree on"
"""Name of a value in the diagnostics of both: what they must have alike."""

# What parameters name by paths, and what decides nothing.
_APART = {"aircraft", "policy_file", "extensions", "areas_file", "map_frame", "diagnostics_period"}


def agreed_text(value: Callable[[str], Any]) -> str:
    """Return the parameters that runner and monitor must have alike, ``name=value`` with blanks."""
    names = [parameter.name for parameter in of("runner") if "monitor" in parameter.nodes.split()]
    return " ".join(f"{name}={_plain(value(name))}" for name in names if name not in _APART)


def _plain(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value).replace(" ", "")


def disagreements(own_text: str, other_text: str) -> list[str]:
    """Return the parameters in which another node differs, a sentence each; both texts as
    :func:`agreed_text` has them.
    """
    ours, theirs = (
        {name: value for name, _, value in (part.partition("=") for part in text.split())}
        for text in (own_text, other_text)
    )
    return [
        f"{name} is {ours[name]} here and {theirs[name]} there, expected one value"
        for name in ours
        if name in theirs and ours[name] != theirs[name]
    ]


def aircraft_text(options: Options) -> str:
    """Return the aircraft that plans are made for, and what it keeps from others, as a text."""
    limits, requirement = options.limits, options.requirement
    return (
        f"{limits.speed_min:g} to {limits.speed_max:g} m/s, {limits.acceleration_min:g} to "
        f"{limits.acceleration_max:g} m/s^2, {math.degrees(limits.yaw_rate_max):g} deg/s; "
        f"separation {requirement.separation:g} m, margin {requirement.margin:g} m"
    )


def planning_options(value: Callable[[str], Any], aircraft: Aircraft) -> Options:
    """Return how plans are made for an aircraft, by the values of parameters (None for one that it
    has not).

    Raises:
        ValueError: the values contradict each other; the message begins with a parameter's name.
    """
    legs = limits_of(value)
    separations_by_category(value)  # refused here, where a node looks at all of its values
    freshness_of(value)  # the same
    fields = {name: value(parameter) for name, parameter in _OPTIONS.items()}
    # A false "rejoin_by" or what a node does not have leaves the usual value.
    fields = {
        name: setting
        for name, setting in fields.items()
        if setting is not None and (name != "rejoin_by" or setting)
    }
    fields |= _altitudes(value)
    fields["requirement"] = Requirement(value("separation"), value("margin"), value("sigmas"))
    if not 0.0 < value("goal_radius") <= value("separation"):
        raise ValueError(
            f"goal_radius is {value('goal_radius'):g} m, expected at most the separation, "
            f"{value('separation'):g} m"
        )
    if legs.speed_min >= legs.speed_max:
        raise ValueError(
            f"speed_min is {legs.speed_min:g} m/s, expected less than speed_max, "
            f"{legs.speed_max:g} m/s"
        )
    try:
        options = Options.for_aircraft(
            aircraft._replace(goal_radius=value("goal_radius")), legs, **fields
        )
        check(options)
    except RequestError as problem:
        field = problem.field.removeprefix("options.")
        for prefix in ("requirement.", "limits.", "manoeuvre."):
            field = field.removeprefix(prefix)
        raise ValueError(f"{_RENAMED.get(field, field)} {problem.problem}") from None
    except ValueError as problem:
        raise ValueError(f"speed_min, speed_max: {problem}") from None
    return options


def _altitudes(value: Callable[[str], Any]) -> dict[str, Any]:
    """Return the options of plans that may climb, from a node's parameters."""
    kinds, kind = [manoeuvre.value for manoeuvre in Maneuvers], value("maneuvers")
    if kind not in kinds:
        raise ValueError(f"maneuvers is {kind!r}, expected one of {', '.join(kinds)}")
    above = value("own_altitude_reference")
    if above not in ALTITUDE_CODES.values():
        references = ", ".join(ALTITUDE_CODES.values())
        raise ValueError(f"own_altitude_reference is {above!r}, expected one of {references}")
    fields: dict[str, Any] = {"maneuvers": Maneuvers(kind)}
    for name in ("floor", "ceiling"):
        height = value(f"{name}_m")
        fields[name] = None if math.isnan(height) else Level(height, above)
    return fields


def planning_settings(value: Callable[[str], Any], aircraft: Aircraft) -> Settings:
    """Return how old inputs may be, and how plans are made; arguments as :func:`planning_options`
    has them.
    """
    options = planning_options(value, aircraft)
    return Settings(
        options,
        Turns.of(Thresholds.for_plans(options)),
        freshness=freshness_of(value),
        unknown=unknown_spread(value),
        categories=separations_by_category(value),
    )


def separations_by_category(value: Callable[[str], Any]) -> Categories:
    """Return the separations by emitter category, from a node's parameters.

    Raises:
        FieldError: one is none; the message begins with the parameter's name.
    """
    names = "category_separations", "category_vertical_separations"
    return Categories(*(separations_of(name, value(name) or "") for name in names))


_FRESHNESS = {
    "own": "ownship_max_age",
    "intruder": "intruder_max_age",
    "alert": "alert_max_age",
    "silence": "forget_after",
    "monitor": "monitor_silence",
    "future": "future_tolerance",
    "request": "request_max_age",
    "node": "runner_silence",
}


def freshness_of(value: Callable[[str], Any]) -> Freshness:
    """Return for how long things count, from a node's parameters; what it does not have is the
    usual.

    Raises:
        ValueError: an aircraft would be forgotten while it counts; the message begins with a
            parameter's name.
    """
    ages = {name: value(parameter) for name, parameter in _FRESHNESS.items()}
    freshness = Freshness(**{name: age for name, age in ages.items() if age is not None})
    if freshness.silence < freshness.intruder:
        raise ValueError(
            f"forget_after is {freshness.silence:g} s, expected at least intruder_max_age, "
            f"{freshness.intruder:g} s: no aircraft may be forgotten while it counts"
        )
    return freshness


def unknown_spread(value: Callable[[str], Any]) -> Unknown:
    """Return what is taken for standard deviations that reports lack, from a node's parameters."""
    return Unknown(
        position_std=value("unknown_position_std"),
        velocity_std=value("unknown_velocity_std"),
        wind_std=value("unknown_wind_std"),
        reported_wind_std=value("wind_std"),
    )


def report_rules(value: Callable[[str], Any]) -> Rules:
    """Return what reports must keep to, from a node's parameters."""
    return Rules(freshness_of(value).future, value("jump_distance"), value("jump_speed"))


def monitor_thresholds(value: Callable[[str], Any], aircraft: Aircraft) -> Thresholds:
    """Return when the monitor acts; arguments as :func:`planning_options` has them."""
    names = ("cross_track", "along_track", "time_error", "intruder_position", "intruder_velocity")
    return Thresholds.for_plans(
        planning_options(value, aircraft),
        **{name: value(name) for name in (*names, "replan_interval", "answer_time")},
        own_age=freshness_of(value).own,
    )
