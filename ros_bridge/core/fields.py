"""Fields of messages, read one by one: every value is finite and in range, or refused by its name
and with a status.

Messages are taken by their fields alone, so that nothing here needs ROS: a message of another
package with the same fields, or a plain object in a test, serves as well.
"""

import re
from collections.abc import Callable
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from agents.kernel.levels import Altitude

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

SECOND = 1_000_000_000
"""Nanoseconds in a second: times of messages are whole nanoseconds."""

_CALLSIGN = re.compile(r"[A-Z0-9 _-]*")
_LONGEST_CALLSIGN = 16
_LONGEST_ID = 64  # bytes
_T = TypeVar("_T")


class Sighting(NamedTuple):
    """Which aircraft a message that cannot be used is about, and where it was, as far as that is
    known.
    """

    identifier: str
    time: int | None = None  # ns
    place: tuple[float, float] | None = None  # latitude and longitude, degrees
    altitude: Altitude | None = None


class FieldError(ValueError):
    """A field that cannot be used: its name, such as ``ownship.velocity.x``, what is wrong, and
    what was expected.

    The sighting is what the message still holds of the aircraft; None: nothing.
    """

    sighting: Sighting | None = None

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field} {problem}")
        self.field, self.problem = field, problem


def attempt(read: Callable[[], _T]) -> _T | FieldError:
    """Return what ``read`` returns, or the :class:`FieldError` that it raises."""
    try:
        return read()
    except FieldError as error:
        return error


def readable(read: Callable[[], _T]) -> _T | None:
    """Return what ``read`` returns, or None where it raises :class:`FieldError`."""
    outcome = attempt(read)
    return None if isinstance(outcome, FieldError) else outcome


def number(name: str, value: Any, low: float, high: float, unit: str) -> float:
    """Return a finite number in a range as a plain float, or raise :class:`FieldError`."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise FieldError(name, f"is {value!r:.60}, expected a number") from None
    # NaN fails every comparison.
    if not low <= result <= high:
        raise FieldError(name, f"is {result:g}, expected {low:g} to {high:g} {unit}")
    return result


def integer(name: str, value: object, low: int, high: int) -> int:
    """Return an integer in a range, or raise :class:`FieldError`."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise FieldError(name, f"is {value!r:.60}, expected an integer from {low} to {high}")
    return value


def place(name: str, latitude: Any, longitude: Any) -> tuple[float, float]:
    """Return latitude and longitude in degrees, or raise :class:`FieldError`."""
    latitude = number(f"{name}.latitude", latitude, -90.0, 90.0, "degrees")
    return latitude, number(f"{name}.longitude", longitude, -180.0, 180.0, "degrees")


def stamp(name: str, value: "Time") -> int:
    """Return a time of ROS that was set (not 0) in nanoseconds, or raise :class:`FieldError`."""
    seconds = integer(f"{name}.sec", value.sec, -(2**31), 2**31 - 1)
    nanoseconds = integer(f"{name}.nanosec", value.nanosec, 0, SECOND - 1)
    total = seconds * SECOND + nanoseconds
    if total <= 0:
        raise FieldError(name, f"is {total / SECOND:g} s, expected a time after zero")
    return total


def not_ahead(name: str, time: int, moment: int, tolerance: float) -> None:
    """Raise :class:`FieldError` for a time that is more than ``tolerance`` seconds ahead of the
    clock; times in ns.
    """
    ahead = (time - moment) / SECOND
    if ahead > tolerance:
        raise FieldError(
            name, f"is {ahead:.3f} s ahead of the clock, expected {tolerance:g} s at most"
        )


def nanoseconds(value: "Time") -> int:
    """Return a time of ROS as it is, ns."""
    return value.sec * SECOND + value.nanosec


def identifier(name: str, value: object) -> str:
    """Return an aircraft's name, stripped and in lower case as receivers vary, or raise
    :class:`FieldError`.
    """
    if not isinstance(value, str) or not value.strip() or not value.strip().isprintable():
        raise FieldError(name, f"is {value!r:.60}, expected a printable name")
    if len(value.encode()) > _LONGEST_ID:
        raise FieldError(
            name, f"is {len(value.encode())} bytes long, expected {_LONGEST_ID} at most"
        )
    return value.strip().lower()


def callsign(value: object) -> str:
    """Return a callsign, stripped and in upper case; "": none, or one that cannot be read. It is
    shown and decides nothing, so that no aircraft is refused for it.
    """
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else value
    if not isinstance(text, str):
        return ""
    plain = text.partition("\0")[0].strip().upper()
    return plain if len(plain) <= _LONGEST_CALLSIGN and _CALLSIGN.fullmatch(plain) else ""


def called(value: object) -> str:
    """Return what an aircraft is called by a name that :func:`identifier` refuses: its first
    characters, with what cannot be printed as escapes.
    """
    return f"{value!r:.40}"


def flags(name: str, value: object, known_bits: int) -> int:
    """Return bits of which all are known, or raise :class:`FieldError`."""
    bits = integer(name, value, 0, 2**32 - 1)
    if bits & ~known_bits:
        raise FieldError(name, f"is {bits:#x}, expected bits of {known_bits:#x} only")
    return bits


class Code(IntEnum):
    """Status codes of GenerateTrajectory."""

    UNKNOWN = 0
    SAFE = 1
    UNRESOLVED = 2
    NOT_ACTIVE = 10
    NO_CLOCK = 11
    NO_GEO_REFERENCE = 12
    NO_OWNSHIP = 13
    NO_ROUTE = 14
    NO_INTRUDER = 15
    STALE_OWNSHIP = 20
    STALE_INTRUDER = 21
    STALE_REQUEST = 22
    FUTURE_OWNSHIP = 30
    FUTURE_INTRUDER = 31
    FUTURE_REQUEST = 32
    INVALID_GEO_REFERENCE = 40
    INVALID_OWNSHIP = 41
    INVALID_INTRUDER = 42
    INVALID_ALERT = 43
    INVALID_ROUTE = 44
    INVALID_REQUEST = 45
    SUPERSEDED = 46
    INVALID_TASK = 47
    CANCELLED = 48
    INTERNAL_ERROR = 255


class Refusal(FieldError):  # noqa: N818 - an answer, not a failure
    """Why there is no plan: the status of the answer, which input is meant, and a sentence."""

    def __init__(self, code: Code, field: str, problem: str) -> None:
        super().__init__(field, problem)
        self.code = code
