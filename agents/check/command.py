"""The command: ``python -m agents.check FILE``."""

import argparse
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

from .aircraft import IN_PLANE, STANDARD, aircraft_file, check_aircraft, read_aircraft
from .certificate import FORMAT
from .proof import accept
from .reading import LARGEST
from .summary import summary

_MOST_BYTES = 1 << 26  # of a file


def main(arguments: list[str] | None = None) -> int:
    """Check a file; return the exit status, 130 after Ctrl-C."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # what its encoding lacks stands there as a code
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = check(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except OSError as problem:
        print(f"the output cannot be written: {problem.strerror}", file=sys.stderr)
        # What is still buffered must not complain again at the exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    return status


def check(arguments: list[str] | None) -> int:
    """Check a file and print what it proves, or why it is refused; return the exit status."""
    options = parse(arguments)
    changes = {"vertical": options.vertical_separation, "sigmas": options.sigmas}
    standard = STANDARD._replace(
        **{name: value for name, value in changes.items() if value is not None}
    )
    path = reading = options.file
    name = str(path).encode(errors="replace").decode()  # it may hold bytes that are no text
    aircraft = None
    try:
        data = json.loads(content(path, "a certificate"), object_pairs_hook=distinct)
        if options.aircraft is not None:
            reading = aircraft_file(options.aircraft)
            aircraft = read_aircraft(content(reading, "an aircraft file").decode())
    except (OSError, ValueError, RecursionError) as problem:
        print(f"{reading}: cannot be read: {problem}", file=sys.stderr)
        return 2
    try:
        certificate = accept(data)
        if aircraft is not None:
            check_aircraft(certificate, aircraft, standard)
    except (ValueError, ArithmeticError) as problem:
        print(f"{name}: refused: {problem}", file=sys.stderr)
        return 1
    print(f"{name}: accepted")
    for sentence in summary(certificate):
        print(f"  {sentence}")
    return 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line; end the program where they are wrong."""
    called = Path(sys.argv[0]).name
    parser = argparse.ArgumentParser(
        prog=called if called.startswith("rlcas-") else "python -m agents.check",
        description="Check the certificate of a plan: exit status 0 accepted, 1 refused, "
        "2 unreadable or bad usage.",
    )
    parser.add_argument("--version", action="version", version=FORMAT)
    parser.add_argument("file", type=Path, help="the certificate")
    parser.add_argument(
        "--aircraft",
        type=Path,
        metavar="FILE",
        help="aircraft file whose limits the plan must keep, and whose separation, or the name of "
        "one that ships, such as paper (default: those that the certificate states)",
    )
    parser.add_argument(
        "--vertical-separation",
        type=not_negative,
        metavar="METRES",
        help="with --aircraft: the least vertical separation, m "
        f"(default {IN_PLANE:g}, the aircraft's for a plan that climbs)",
    )
    parser.add_argument(
        "--sigmas",
        type=not_negative,
        metavar="COUNT",
        help="with --aircraft: the least number of sigmas of what is uncertain "
        f"(default {STANDARD.sigmas:g})",
    )
    options = parser.parse_args(arguments)
    if options.aircraft is None and (options.vertical_separation, options.sigmas) != (None, None):
        parser.error("--vertical-separation and --sigmas need --aircraft")
    return options


def not_negative(text: str) -> float:
    """Return a number of the command line that is 0 or more."""
    value = float(text)
    if not 0.0 <= value < LARGEST:
        raise argparse.ArgumentTypeError(f"{text!r} is no number from 0 on")
    return value


def distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; one with a key that stands twice means two things, and is none."""
    members: dict[str, Any] = {}
    for key, value in pairs:
        if key in members:
            raise ValueError(f"the key {key!r} stands twice")
        members[key] = value
    return members


def content(path: Path, expected: str) -> bytes:
    """Return the content of a regular file, or raise ValueError."""
    if not path.exists():
        raise ValueError(f"there is no such file; expected {expected}")
    if not path.is_file():
        raise ValueError(f"it is not a regular file; expected {expected}")
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"it is larger than {_MOST_BYTES >> 20} MiB; expected {expected}")
    return path.read_bytes()
