"""Proving something of an arc by parts: a part that is not clear is cut in two."""

from collections.abc import Callable
from typing import NamedTuple

from .balls import Ball, ball, to_float
from .leg import Arc
from .refusal import Work, demand


class Part(NamedTuple):
    """The ``number``-th of ``total`` equal parts of an arc, from 0 on."""

    number: int
    total: int
    begin: Ball  # s after the request
    end: Ball

    @classmethod
    def of(cls, arc: Arc, number: int, total: int) -> "Part":
        """Return a part of an arc, with its times."""
        if total == 1:
            return cls(number, total, arc.begin, arc.begin + arc.length)
        step = arc.length / ball(total)
        begin, end = arc.begin + step * ball(number), arc.begin + step * ball(number + 1)
        return cls(number, total, begin, end)

    @property
    def whole(self) -> bool:
        """Whether it is the whole arc."""
        return self.total == 1


def check_parts(
    arc: Arc, is_clear: Callable[[Part], bool], most: int, problem: str, work: Work
) -> None:
    """Check an arc by parts of it, ``most`` at most; refuse the certificate where one of these is
    not clear.

    Args:
        problem: what may be so before the end of that part.
    """
    open_parts = [(0, 1)]
    while open_parts:
        number, total = open_parts.pop()
        work.spend(1)
        part = Part.of(arc, number, total)
        if not is_clear(part):
            demand(total < most, f"{problem} before {to_float(part.end.hi):.2f} s")
            open_parts += [(2 * number, 2 * total), (2 * number + 1, 2 * total)]
