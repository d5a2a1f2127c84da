"""The command line of ``python -m ros_bridge.mavlink``, and the rules that follow from it."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from agents.planner.answer import RequestError
from agents.planner.request.options import HIGHEST, LOWEST, Maneuvers, default_vertical_margin
from agents.policy.domain import OutsideDomainError
from agents.policy.inference import Policy
from commands.command import InputError, Parser, require, whole
from envs.areas import Level
from ros_bridge.core.aircraft import load_policy
from ros_bridge.core.categories import Categories, separations_of
from ros_bridge.core.reports import UNKNOWN_WIND_STD, USUAL, WIND_STD, Unknown
from ros_bridge.mavlink.judging import IN_THE_PLANE, Climbs, Rules, rules
from ros_bridge.mavlink.vehicle import Vehicle
from ros_bridge.transport.receivers import EXAMPLES, check_ports, check_sources

MARGIN = 25.0
"""Added to the separation for what the autopilot leaves of its plan, m
(docs/reference/mavlink-measured.md)."""

VERTICAL_SEPARATION = 76.2
"""Kept from traffic above and below where plans may climb, m: 250 ft, the height of the well-clear
volume of small unmanned aircraft (ASTM F3442).
"""

VERTICAL_MARGIN = 15.0
"""Added to it for what the autopilot leaves of its plan's altitude, m
(docs/reference/mavlink-measured.md)."""

_DESCRIPTION = (
    "Watch the mission of an ArduPilot autopilot for conflicts with traffic and fences: advise, or "
    "with --fly avoid them. More: docs/howto/mavlink.md."
)

_HEIGHTS = ("floor", "ceiling", "vertical_separation", "vertical_margin")
"""Options of plans that may climb."""

_RANGES = {
    "separation": (10.0, 10_000.0, "m"),
    "margin": (0.0, 1_000.0, "m"),
    "vertical_filter": (0.0, 10_000.0, "m"),
    "floor": (LOWEST, HIGHEST, "m"),
    "ceiling": (LOWEST, HIGHEST, "m"),
    "vertical_separation": (1.0, 10_000.0, "m"),
    "vertical_margin": (0.0, 5_000.0, "m"),
    "unknown_position_std": (0.0, 1_000.0, "m"),
    "unknown_velocity_std": (0.0, 50.0, "m/s"),
    "unknown_wind_std": (0.0, 50.0, "m/s"),
    "wind_std": (0.0, 50.0, "m/s"),
    "deadline": (0.01, 10.0, "s"),
    "wait": (1.0, 3_600.0, "s"),
}


def options_of(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line, or raise :class:`InputError`."""
    options = _parser().parse_args(arguments)
    for name, (low, high, unit) in _RANGES.items():
        value = getattr(options, name)
        if value is not None and not low <= value <= high:
            option = name.replace("_", "-")
            raise InputError(f"--{option} is {value:g} {unit}; expected {low:g} to {high:g} {unit}")
    if options.own and not options.adsb:
        raise InputError("--own goes with --adsb; the autopilot leaves itself out of its traffic")
    if not re.fullmatch("(?:[0-9a-fA-F]{6})?", options.own):
        raise InputError(f"--own is {options.own!r}; expected six hexadecimal digits")
    if not re.fullmatch("[ -~]{0,20}", options.own_remote_id):
        remote_id = options.own_remote_id
        raise InputError(f"--own-remote-id is {remote_id!r}; expected up to 20 characters of ASCII")
    try:
        options.adsb = check_sources(options.adsb)
        check_ports(options.adsb)
    except ValueError as problem:
        raise InputError(f"--{problem}") from None
    options.categories = _categories(
        options.category_separations, options.category_vertical_separations
    )
    _check_heights(options)
    if options.seconds is not None and not options.seconds > 0.0:
        raise InputError(f"--seconds is {options.seconds:g} s; expected more than 0 s")
    options.policy = _policy(options.policy)
    _check_outputs(options)
    return options


def check_folder(option: str, file: Path) -> None:
    """Raise :class:`InputError` where a file of an option would be in a folder that is not there,
    or is a folder itself.
    """
    folder = file.absolute().parent
    if not folder.is_dir():
        raise InputError(f"--{option} {file}: there is no folder {folder}")
    if file.is_dir():
        raise InputError(f"--{option} {file} is a folder; expected a file")


def vertical_separation_of(options: argparse.Namespace) -> float | None:
    """Return what is kept above and below where plans may climb, m; None: they keep the height."""
    if options.maneuvers == Maneuvers.HORIZONTAL.value:
        return None
    separation = options.vertical_separation
    return VERTICAL_SEPARATION if separation is None else separation


def rules_of(
    options: argparse.Namespace,
    vehicle: Vehicle,
    fence: tuple[Level | None, Level | None] = (None, None),
) -> Rules:
    """Return how an autopilot's aircraft is watched and planned for, or raise :class:`InputError`
    where the policy is for no such aircraft, or plans may not climb as they are to; ``fence`` is
    the floor and the ceiling of the autopilot's.
    """
    try:
        policy = options.policy.for_aircraft(vehicle.aircraft)
    except OutsideDomainError as problem:
        raise InputError(
            f"--separation {options.separation:g} m with the autopilot's parameters: {problem}"
        ) from None
    fastest, wind = vehicle.aircraft.limits.speed_max, options.unknown_wind_std
    reported = options.wind_std
    unknown = Unknown(
        position_std=options.unknown_position_std,
        velocity_std=options.unknown_velocity_std,
        wind_std=UNKNOWN_WIND_STD * fastest if wind is None else wind,
        reported_wind_std=WIND_STD * fastest if reported is None else reported,
    )
    try:
        return rules(
            vehicle.aircraft,
            policy,
            margin=options.margin,
            vertical=options.vertical_filter,
            unknown=unknown,
            deadline=options.deadline,
            categories=options.categories,
            climbs=_climbs(options, vehicle, fence),
        )
    except RequestError as problem:
        option = problem.field.removeprefix("options.").removesuffix(".value").replace("_", "-")
        raise InputError(f"--{option} {problem.problem}") from None


def _climbs(
    options: argparse.Namespace, vehicle: Vehicle, fence: tuple[Level | None, Level | None]
) -> Climbs:
    """Return what plans may do up and down: within the floors and ceilings of options and fence."""
    vertical = vehicle.aircraft.vertical
    if vertical is None:
        return IN_THE_PLANE
    margin = options.vertical_margin
    margin = VERTICAL_MARGIN if margin is None else margin
    least = default_vertical_margin(vertical)
    if margin < least:
        raise InputError(
            f"--vertical-margin is {margin:g} m; expected {least:.1f} m or more, by which a change "
            "to the greatest climb leaves a plan's altitude"
        )
    floors, ceilings = (
        [level for level in (side, None if height is None else Level(height, "msl")) if level]
        for side, height in zip(fence, (options.floor, options.ceiling), strict=True)
    )
    return Climbs(
        Maneuvers(options.maneuvers), max(floors, default=None), min(ceilings, default=None), margin
    )


def _check_heights(options: argparse.Namespace) -> None:
    """Raise :class:`InputError` where plans could not climb as the options say."""
    if options.maneuvers == Maneuvers.HORIZONTAL.value:
        for name in _HEIGHTS:
            if getattr(options, name) is not None:
                option = name.replace("_", "-")
                raise InputError(
                    f"--{option} goes with --maneuvers vertical or both; by default plans keep the "
                    "height"
                )
        return
    floor, ceiling = options.floor, options.ceiling
    if floor is not None and ceiling is not None and not floor < ceiling:
        raise InputError(f"--floor is {floor:g} m; expected less than --ceiling, {ceiling:g} m")
    above_sea = (source.startswith("flarm://") for source in options.adsb)
    if options.traffic_altitude != "msl" and not any(above_sea):
        raise InputError(
            f"--maneuvers {options.maneuvers} goes with --traffic-altitude msl, or a receiver that "
            "has altitudes above mean sea level (--adsb flarm://...): no plan is above or below an "
            "aircraft whose altitude is unknown"
        )


def _policy(file: str) -> Policy:
    """Return the policy of a file, for "" the one that ships; InputError: it is none."""
    try:
        return load_policy(file)
    except ValueError as problem:
        raise InputError(str(problem).replace("policy_file:", "--policy")) from None


def _check_outputs(options: argparse.Namespace) -> None:
    """Raise :class:`InputError` where the display or a file could not be had in flight."""
    for name, file in (("record", options.record), ("plan-file", options.plan_file)):
        if file is not None:
            check_folder(name, file)
    if options.record is not None and options.record.exists():
        raise InputError(f"--record {options.record} exists already")
    if options.record is not None:
        require("--record", "mcap", "mcap_ros2")
    if options.display is not None:
        require("--display", "websockets")
        from ros_bridge.mavlink.adapter import host_and_port

        host_and_port(options.display)


def _categories(separations: str, vertical: str) -> Categories:
    try:
        return Categories(
            separations_of("--category-separations", separations),
            separations_of("--category-vertical-separations", vertical),
        )
    except ValueError as problem:
        raise InputError(str(problem)) from None


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m ros_bridge.mavlink", description=_DESCRIPTION)
    add = parser.add_argument
    add(
        "--connect",
        required=True,
        metavar="ADDRESS",
        help="udp:HOST:PORT (listens), udpout:HOST:PORT, tcp:HOST:PORT or a serial port",
    )
    baud = "speed of a serial port, baud (default 57600)"
    add("--baud", type=whole(1), default=57_600, help=baud)
    add("--system", type=whole(1, 255), default=245, help="our number, 1 to 255 (default 245)")
    add("--fly", action="store_true", help="take over in GUIDED while a conflict lasts")
    numbers = (
        ("separation", 610.0, "kept from traffic, m"),
        ("margin", MARGIN, "added for the distance of flights from their plans, m"),
        ("vertical-filter", 600.0, "traffic farther above or below does not count, m"),
        ("unknown-position-std", USUAL.position_std, "one sigma of positions without one, m"),
        ("unknown-velocity-std", USUAL.velocity_std, "one sigma of velocities without one, m/s"),
        ("deadline", 0.2, "computation in which a plan must be found, s"),
        ("wait", 30.0, "time to wait for the first heartbeat, s"),
    )
    for name, default, meaning in numbers:
        add(f"--{name}", type=float, default=default, help=f"{meaning} (default {default:g})")
    add(
        "--maneuvers",
        choices=[kind.value for kind in Maneuvers],
        default=Maneuvers.HORIZONTAL.value,
        help="what plans may do: turns and speeds (horizontal, the default), climbs and descents "
        "along the mission (vertical), or both",
    )
    for name, usual, meaning in (
        ("floor", "none", "least altitude of plans that may climb, m above mean sea level"),
        ("ceiling", "none", "greatest altitude of plans that may climb, likewise"),
        (
            "vertical-separation",
            f"{VERTICAL_SEPARATION:g}",
            "kept above or below traffic by plans that may climb, instead of --vertical-filter, m",
        ),
        (
            "vertical-margin",
            f"{VERTICAL_MARGIN:g}",
            "added to it for the distance of flights from their plans' altitudes, m",
        ),
    ):
        add(f"--{name}", type=float, help=f"{meaning} (default {usual})")
    for name, meaning in (
        ("category-separations", "separations from aircraft of emitter categories, m"),
        ("category-vertical-separations", "vertical filters likewise"),
    ):
        text = f"{meaning}, such as A5:2000,B6:300 (default: the same from all)"
        add(f"--{name}", default="", metavar="LIST", help=text)
    for name, share, meaning in (
        ("wind-std", WIND_STD, "the wind that the autopilot sends"),
        ("unknown-wind-std", UNKNOWN_WIND_STD, "a wind that it does not send, about calm"),
    ):
        usual = f"default {share:g} of the highest speed"
        add(f"--{name}", type=float, help=f"one sigma of {meaning}, m/s ({usual})")
    add(
        "--traffic-altitude",
        choices=("unknown", "msl"),
        default="unknown",
        help="what altitudes of ADS-B are above (default unknown: every aircraft counts)",
    )
    receivers = f"live receivers with commas between them: {EXAMPLES}"
    add("--adsb", default="", metavar="URL,...", help=receivers)
    own = "address of the ownship among its aircraft (default: the autopilot's ADSB_ICAO_ID)"
    add("--own", default="", metavar="HEX", help=own)
    own_drone = "the own Remote ID among those received, such as a serial number (default: as said)"
    add("--own-remote-id", default="", metavar="ID", help=own_drone)
    add("--policy", default="", metavar="FILE", help="policy file (default: the one that ships)")
    plan_file = "write the plan that is advised or flown: KML where it ends in .kml, or GeoJSON"
    add("--plan-file", type=Path, metavar="FILE", help=plan_file)
    add(
        "--display",
        nargs="?",
        const="127.0.0.1:8642",
        metavar="HOST:PORT",
        help="serve a traffic display for the browser (default address 127.0.0.1:8642)",
    )
    add(
        "--record",
        type=Path,
        metavar="FILE.mcap",
        help="record what the display shows (default: no recording)",
    )
    add("--seconds", type=float, help="end after this time, s (default: never)")
    add("--quiet", action="store_true", help="print nothing")
    simulated = (
        "the autopilot is a simulation, whose time may run faster than real time; what is computed "
        "takes as many times more of it, so that more than twice is warned of"
    )
    add("--simulated", action="store_true", help=simulated)
    return parser
