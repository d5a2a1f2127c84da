"""Fields of messages, read one by one: every value is finite and in range, or refused by its name.

Messages are taken by their fields alone, so that nothing here needs ROS: a message of another package with the same
fields, or a plain object in a test, serves as well.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from ros_bridge.core.reports import Sighting

SECOND = 1_000_000_000
"""Nanoseconds in a second: times of messages are whole nanoseconds."""

_LONGEST_ID = 64  # bytes
_T = TypeVar("_T")


class FieldError(ValueError):
    """A field that cannot be used; the message says which, what it is and what was expected.

    Attributes:
        field: its name, such as ``ownship.velocity.x``.
        problem: the rest of the sentence.
        sighting: what the message still holds of the aircraft; None: nothing.
    """

    sighting: "Sighting | None" = None

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field} {problem}")
        self.field, self.problem = field, problem


def readable(read: Callable[[], _T]) -> _T | None:
    """Return what ``read`` returns, or None where it raises :class:`FieldError`."""
    try:
        return read()
    except FieldError:
        return None


def number(name: str, value: Any, low: float, high: float, unit: str) -> float:
    """Return a number as a plain float.

    Raises:
        FieldError: it is not a number, not finite or out of range.
    """
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise FieldError(name, f"is {value!r:.60}, expected a number") from None
    # NaN fails every comparison.
    if not low <= result <= high:
        raise FieldError(name, f"is {result:g}, expected {low:g} to {high:g} {unit}")
    return result


def integer(name: str, value: Any, low: int, high: int) -> int:
    """Return an integer in a range, or raise :class:`FieldError`."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise FieldError(name, f"is {value!r:.60}, expected an integer from {low} to {high}")
    return value


def latitude(name: str, value: Any) -> float:
    """Return a latitude in degrees, or raise :class:`FieldError`."""
    return number(name, value, -90.0, 90.0, "degrees")


def longitude(name: str, value: Any) -> float:
    """Return a longitude in degrees, or raise :class:`FieldError`."""
    return number(name, value, -180.0, 180.0, "degrees")


def place(name: str, message: Any) -> tuple[float, float]:
    """Return latitude and longitude of a message in degrees, or raise :class:`FieldError`."""
    return latitude(f"{name}.latitude", message.latitude), longitude(f"{name}.longitude", message.longitude)


def stamp(name: str, value: Any) -> int:
    """Return a time of ROS (``sec``, ``nanosec``) as nanoseconds, greater than 0.

    Raises:
        FieldError: it is no time, or zero, which means that it was not set.
    """
    seconds = integer(f"{name}.sec", value.sec, -(2**31), 2**31 - 1)
    rest = integer(f"{name}.nanosec", value.nanosec, 0, SECOND - 1)
    total = seconds * SECOND + rest
    if total <= 0:
        raise FieldError(name, f"is {total / SECOND:g} s, expected a time after zero")
    return total


def not_ahead(name: str, time: int, now: int, most: float) -> None:
    """Raise :class:`FieldError` for a time that is more than ``most`` seconds ahead of the clock; times in ns."""
    ahead = (time - now) / SECOND
    if ahead > most:
        raise FieldError(name, f"is {ahead:.3f} s ahead of the clock, expected {most:g} s at most")


def nanoseconds(value: Any) -> int:
    """Return a time of ROS as it is, ns."""
    return value.sec * SECOND + value.nanosec


def identifier(name: str, value: Any) -> str:
    """Return the name of an aircraft in lower case and without blanks around it, or raise :class:`FieldError`.

    Receivers write the same 24-bit address in either case and pad it.
    """
    if not isinstance(value, str) or not value.strip() or not value.strip().isprintable():
        raise FieldError(name, f"is {value!r:.60}, expected a printable name")
    if len(value.encode()) > _LONGEST_ID:
        raise FieldError(name, f"is {len(value.encode())} bytes long, expected {_LONGEST_ID} at most")
    return value.strip().lower()


def flags(name: str, value: Any, known: int) -> int:
    """Return bits of which all are known, or raise :class:`FieldError`."""
    bits = integer(name, value, 0, 2**32 - 1)
    if bits & ~known:
        raise FieldError(name, f"is {bits:#x}, expected bits of {known:#x} only")
    return bits
