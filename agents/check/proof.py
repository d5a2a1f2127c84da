"""The proof: everything that a certificate has to show, in order."""

from collections import defaultdict
from typing import Any

from .altitude import check_altitudes, own_lines
from .area import check_area
from .certificate import Certificate
from .leg import fly
from .profile import check_profile
from .reading import read
from .refusal import Work, demand
from .separation import check_separation, covered, joined

_LEG_WORK = 50  # of a leg, in parts of arcs


def accept(data: Any, work: Work | None = None) -> Certificate:
    """Return what a certificate proves, with some work at most; raise RefusedError where it proves
    nothing.

    Args:
        data: an object of JSON.
    """
    certificate = read(data)
    work = work or Work()
    work.spend(_LEG_WORK * len(certificate.controls))
    work.spend(len(certificate.reports))
    flight = fly(certificate)
    check_profile(certificate, flight)
    lines = own_lines(certificate)
    check_altitudes(certificate, lines, work)
    apart = times_apart(certificate)
    for number, bound in enumerate(certificate.bounds):
        times = apart[number]
        never = bound > 0.0 or covered(times, certificate.end)
        demand(never, f"intruder {number} counts, but its bound of 0 says that it never does")
        check_separation(number, certificate, flight, times, work)
    for number in range(len(certificate.areas)):
        check_area(number, flight, certificate, lines, work)
    return certificate


def times_apart(certificate: Certificate) -> defaultdict[int, list[tuple[float, float]]]:
    """Return by an intruder's number the times in which it is above or below, from and until, s, as
    of :func:`agents.check.separation.joined`.
    """
    times: defaultdict[int, list[tuple[float, float]]] = defaultdict(list)
    for row in certificate.apart:
        times[row.number].append((row.begin, row.end))
    for number, rows in times.items():
        times[number] = joined(rows)
    return times
