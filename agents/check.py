"""Check a plan's certificate: ``python -m agents.check FILE`` (exit 0 accepted, 1 refused, 2
unreadable or bad usage).

It imports nothing else of the project. What decides is computed in balls (complex numbers with a
bound of their error, 256 bits) and follows the theorem ``safe`` of proofs/Safe.v: legs are flown
exactly; in each part of an arc the relative motion leaves its chord by at most a h^2 / 8; an arc is
left out where both can fly less than they are too far apart (``left_out_soundly``). At every real
time of an accepted plan every intruder is the required distance less 1.002 mm away, and the
separation itself less 3 micrometres (docs/explanation/safe-theorem.md).
"""

import argparse
import cmath
import json
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

BITS, ARCS, FORMAT = 256, 10, "RLCAS plan certificate 1"
FIELDS = {
    "format",
    "own",
    "waypoints",
    "controls",
    "intruders",
    "excluded",
    "requirement",
    "limits",
    "parts",
    "bounds",
}
REQUIREMENT = ("separation", "margin", "sigmas", "vertical")
LIMITS = ("speed_min", "speed_max", "acceleration_min", "acceleration_max", "yaw_rate_max")


class RefusedError(ValueError):
    """The certificate does not prove its plan; the message says why."""


class Ball:
    """All complex numbers at most ``r`` from x + iy; of real numbers ``lo`` and ``hi`` are bounds;
    units of 2^-256.
    """

    lo, hi = property(lambda self: self.x - self.r), property(lambda self: self.x + self.r)

    def __init__(self, x: int, y: int, r: int) -> None:
        self.x, self.y, self.r = x, y, r

    def __add__(self, other: "Ball") -> "Ball":
        return Ball(self.x + other.x, self.y + other.y, self.r + other.r)

    def __sub__(self, other: "Ball") -> "Ball":
        return Ball(self.x - other.x, self.y - other.y, self.r + other.r)

    def __mul__(self, other: "Ball") -> "Ball":
        a, b, c, d = self.x, self.y, other.x, other.y
        blur = (abs(a) + abs(b) + self.r) * other.r + (abs(c) + abs(d)) * self.r
        return Ball((a * c - b * d) >> BITS, (a * d + b * c) >> BITS, (blur >> BITS) + 3)

    def __truediv__(self, other: "Ball") -> "Ball":
        demand(other.lo > 0 or other.hi < 0, "it needs a division by zero")
        x, y = (self.x << BITS) // other.x, (self.y << BITS) // other.x
        blur = (self.r << BITS) + (abs(x) + abs(y) + 2) * other.r
        return Ball(x, y, blur // (abs(other.x) - other.r) + 3)

    def size(self) -> "Ball":
        """Return the magnitude."""
        return Ball(math.isqrt(self.x * self.x + self.y * self.y), 0, self.r + 1)


def demand(holds: bool, sentence: str) -> None:
    """Refuse the certificate unless something holds."""
    if not holds:
        raise RefusedError(sentence)


def ball(x: float, y: float = 0.0) -> Ball:
    """Return a number, or a place, as it is."""
    (a, b), (c, d) = float(x).as_integer_ratio(), float(y).as_integer_ratio()
    return Ball((a << BITS) // b, (c << BITS) // d, 0 if max(b, d) <= 1 << BITS else 2)


ZERO, ONE, J = ball(0.0), ball(1.0), ball(0.0, 1.0)
CLOSED, CLOSE, ROUNDING, FINE, TURN, TINY = map(
    ball, (1e-3 + 1e-6, 1e-3 + 2e-6, 3e-6, 2e-6, 2e-9, 1e-12)
)


def spin(angle: Ball) -> Ball:
    """Return cosine + i sine of a real angle."""
    halvings = (abs(angle.x) >> (BITS - 4)).bit_length()
    small, term, n, sums = angle.x >> halvings, 1 << BITS, 0, [0, 0, 0, 0]
    while term not in (0, -1):  # a term is 2^-4 of the one before at most, and off by 3 at most
        sums[n % 4] += term
        n, term = n + 1, (term * small >> BITS) // (n + 1)
    total = Ball(sums[0] - sums[2], sums[1] - sums[3], 4 * n + 8)
    for _ in range(halvings):
        total *= total
    return Ball(total.x, total.y, total.r + angle.r)


def travel(course: Ball, turn: Ball, v: Ball, a: Ball, w: Ball, t: Ball) -> Ball:
    """Return how far one gets in a time t with speed v + a t, on a course that turns by w t; both
    as cos + i sin.
    """
    if w.x == w.r == 0:
        return course * t * (v + a * t / ball(2.0))
    return course * (((v + a * t) * turn - v) * (ZERO - J) + a * (turn - ONE) / w) / w


def controls(a: list[float], b: list[float]) -> list[float]:
    """Return a leg's ten turn rates and ten accelerations, in floats: the curve that
    envs/waypoints.py defines.
    """
    roots = [
        (s, q, math.sqrt((3.0 + q * math.sqrt(4.8)) / 7.0)) for q in (-1, 1) for s in (-0.5, 0.5)
    ]
    nodes = [(0.5 + s * root, (18.0 - q * math.sqrt(30.0)) / 72.0) for s, q, root in roots]
    h, turn, gain = (b[4] - a[4]) / ARCS, b[2] - a[2], b[3] - a[3]
    turn -= math.tau * math.floor((turn + math.pi) * (1.0 / math.tau))
    turn -= math.tau if turn >= math.pi else 0.0  # half a circle is one to the right
    found = mean = [turn / (ARCS * h)] * ARCS + [gain / (ARCS * h)] * ARCS
    for step in range(13):
        psi, v, parts = a[2], a[3], []
        for w, p in zip(found[:ARCS], found[ARCS:], strict=True):
            parts.append(
                sum(g * h * (v + p * u * h) * cmath.rect(1.0, psi + w * u * h) for u, g in nodes)
            )
            psi, v = psi + w * h, v + p * h
        off = complex(b[0] - a[0], b[1] - a[1]) - sum(parts)
        if abs(off) <= 5e-4 or step == 12:
            break
        units = [h * h * part / max(abs(part), 1e-9) for part in parts]
        turns, pushes = (
            [sum(each[k:]) - 0.5 * each[k] for k in range(ARCS)] for each in (parts, units)
        )
        effects = [(4e-4, 1j * h * (one - sum(turns) / ARCS)) for one in turns]
        effects += [(4e-2, one - sum(pushes) / ARCS) for one in pushes]
        off += sum(e * u for (_, e), u in zip(effects, found, strict=True))
        # The normal equations: S m + D conj(m) = 2 off, S and D being the sums of |e|^2 and e^2.
        s, d = sum(g * abs(e) ** 2 for g, e in effects), sum(g * e * e for g, e in effects)
        m = 2.0 * (s * off - d * off.conjugate()) / max(s * s - abs(d) ** 2, 4e-12)
        found = [
            middle + g * (e * m.conjugate()).real
            for middle, (g, e) in zip(mean, effects, strict=True)
        ]
    return found


def table(name: str, rows: Any, width: int) -> list[list[float]]:
    """Return rows of numbers of moderate size."""
    good = isinstance(rows, list) and all(
        isinstance(row, list) and len(row) == width for row in rows
    )
    good = good and all(
        type(value) in (int, float) and abs(value) < 1e8 for row in rows for value in row
    )
    demand(good, f"{name} are not rows of {width} numbers below 1e8")
    return [[float(value) for value in row] for row in rows]


def flight(
    knots: list[list[float]], given: list[list[float]], limits: list[Ball]
) -> list[tuple[Ball, ...]]:
    """Return the plan's arcs, which keep the limits and join the waypoints.

    Of each: begin, length, first and last place, course, v, a, w, greatest speed and own
    acceleration.
    """
    arcs, low, high = [], 0, 1 << (BITS + 30)
    for number, (a, b) in enumerate(pairwise(knots)):
        leg = f"the leg to waypoint {number}"
        demand(b[4] - a[4] > 1e-3, f"{leg} takes no time")
        same = all(
            abs(one - two) <= 1e-8 for one, two in zip(given[number], controls(a, b), strict=True)
        )
        demand(same, f"{leg} is not flown along its curve")
        h, place, course, v = (
            (ball(b[4]) - ball(a[4])) / ball(ARCS),
            ball(a[0], a[1]),
            spin(ball(a[2])),
            ball(a[3]),
        )
        for k in range(ARCS):
            w, p, begin = (
                ball(given[number][k]),
                ball(given[number][ARCS + k]),
                ball(a[4]) + h * ball(k),
            )
            low, high, after = max(low, v.hi), min(high, v.lo), v + p * h
            slow = min(v.lo, after.lo) > 0 and after.lo >= min(limits[0].hi, low) - FINE.lo
            demand(
                slow and after.hi <= max(limits[1].lo, high) + FINE.lo,
                f"{leg} leaves the speed limits",
            )
            gentle = limits[2].hi - FINE.lo <= p.lo and p.hi <= limits[3].lo + FINE.lo
            demand(gentle, f"{leg} leaves the acceleration limits")
            demand(w.size().hi <= limits[4].lo + TURN.lo, f"{leg} turns too fast")
            quick, turn = Ball(max(v.hi, after.hi), 0, 0), spin(w * h)
            last = place + travel(course, turn, v, p, w, h)
            arcs.append((begin, h, place, last, course, v, p, w, quick, (p + J * quick * w).size()))
            place, course, v = last, course * turn, after
        end = (place - ball(b[0], b[1])).size().hi <= CLOSED.lo and (
            v - ball(b[3])
        ).size().hi <= FINE.lo
        demand(
            end and (course - spin(ball(b[2]))).size().hi <= FINE.lo, f"{leg} misses its waypoint"
        )
    return arcs


def other(row: list[Ball], t: Ball) -> Ball:
    """Return where an intruder is a time after the request: it turns for a while after its report,
    then flies on.
    """
    place, course, v, age, w, lasts = row[:6]
    time = t + age
    if w.x == w.r == 0:
        return place + course * v * time
    turning = Ball(min(time.x, lasts.x), 0, time.r + lasts.r)
    turn = spin(w * turning)
    return place + travel(course, turn, v, ZERO, w, turning) + course * turn * v * (time - turning)


def bound(first: Ball, last: Ball, bow: int) -> int:
    """Return a lower bound of the distance in a part of an arc from the relative positions at its
    ends, in units.
    """
    chord = last - first
    length, cross = chord.size(), Ball(first.x, -first.y, first.r) * chord
    best = 0
    if length.lo > 0:  # from the line through both ends
        best = max(best, (Ball(max(abs(cross.y) - cross.r, 0), 0, 0) / length).lo - bow)
    for end, way in ((first, chord), (last, ZERO - chord)):
        far, grow = end.size(), Ball(end.x, -end.y, end.r) * way
        best = max(best, far.lo - length.hi - bow)
        if far.lo > 0 and grow.lo >= 0:  # from an end at which the range opens
            rest = Ball(max(4 * bow - (Ball(grow.lo, 0, 0) / far).lo, 0), 0, 0)
            best = max(best, far.lo - (rest * rest / Ball(16 * bow, 0, 0)).hi)
    return best


def separated(
    number: int, row: list[Ball], start: Ball, arcs: Any, sizes: list[Ball], claim: Ball, parts: int
) -> None:
    """Check that an intruder (place, heading, speed, age, turn rate and time, sigmas) stays as far
    as it has to.
    """
    least, margin, sigmas = sizes
    old = Ball(
        max(row[3].x, -row[3].x), 0, row[3].r
    )  # one error of the velocity lasts from the report on
    std, away = (row[6] + J * row[7] * old).size(), (other(row, ZERO) - start).size()
    keep = max(least.hi, min((least + margin + sigmas * std).hi, away.hi))
    swerve = (row[2] * row[4]).size() if row[5].hi > row[3].lo else ZERO
    near = away.lo  # the distance at the beginning of an arc is this at least
    for begin, h, place, end, course, v, p, w, quick, own_swerve in arcs:
        pull, todo, near = own_swerve + swerve, [(0, 1)], near - (h * (quick + row[2])).hi
        while todo:
            i, n = todo.pop()
            later, known = begin + h * ball(i + 1) / ball(n), {0: place, n: end}
            need = keep + (sigmas * ((row[6] + J * row[7] * (old + later)).size() - std)).hi
            owed = max(need - CLOSE.lo, least.hi - ROUNDING.lo, claim.hi)
            bow = max((pull * h * h / ball(8 * n * n)).hi, TINY.hi)
            if n == 1 and near - bow >= owed:
                continue
            times = [(k, h * ball(k) / ball(n)) for k in (i, i + 1)]
            own = [
                known[k] if k in known else place + travel(course, spin(w * t), v, p, w, t)
                for k, t in times
            ]
            first, last = (
                other(row, begin + t) - at for (_, t), at in zip(times, own, strict=True)
            )
            near = last.size().lo if n == 1 else near
            if bound(first, last, bow) < owed:
                demand(
                    n < parts,
                    f"intruder {number} may come too close before {later.hi / (1 << BITS):.2f} s",
                )
                todo += [(2 * i, 2 * n), (2 * i + 1, 2 * n)]
        near -= CLOSED.hi


def accept(data: Any) -> float:
    """Return the smallest distance that is proven, m; raise RefusedError where the certificate
    proves nothing.
    """
    demand(
        isinstance(data, dict) and set(data) == FIELDS and data["format"] == FORMAT,
        f"it is not a {FORMAT}",
    )
    fields = (("requirement", REQUIREMENT), ("limits", LIMITS))
    right = all(
        isinstance(data[name], dict) and set(data[name]) == set(keys) for name, keys in fields
    )
    demand(right, "requirement or limits have other fields than expected")
    wanted, allowed = (
        table(name, [[data[name][key] for key in keys]], len(keys))[0] for name, keys in fields
    )
    waypoints, intruders = (
        table("waypoints", data["waypoints"], 5),
        table("intruders", data["intruders"], 9),
    )
    given, claims = (
        table("controls", data["controls"], 2 * ARCS),
        table("bounds", [data["bounds"]], len(intruders))[0],
    )
    demand(
        type(data["parts"]) is int and data["parts"] in [1 << n for n in range(11)],
        "parts is no power of 2 to 1024",
    )
    demand(
        len(given) == len(waypoints) > 0, "there are not as many controls as waypoints, one or more"
    )
    positive = (
        min([*wanted, *claims, *(value for row in intruders for value in (row[3], *row[6:]))])
        >= 0.0
    )
    demand(positive and wanted[0] > 0.0, "a size is negative")
    knots = [*([*row, 0.0] for row in table("own", [data["own"]], 4)), *waypoints]
    arcs = flight(knots, given, [ball(value) for value in allowed])
    for row in table("excluded", data["excluded"], 5):
        own, climb, height, rise, age = map(ball, row)
        now = height + rise * age - own
        then, apart = now + (rise - climb) * ball(knots[-1][4]), ball(wanted[3]).hi
        keeps = min(now.lo, then.lo) >= apart or max(now.hi, then.hi) <= -apart
        demand(keeps, "an excluded intruder does not stay above or below")
    for number, (x, y, *rest) in enumerate(intruders):
        row = [ball(x, y), spin(ball(rest[0])), *map(ball, rest[1:])]
        row[4] = row[4] if rest[4] > 0.0 else ZERO  # a turn that lasts for no time
        start = ball(knots[0][0], knots[0][1])
        separated(
            number,
            row,
            start,
            arcs,
            list(map(ball, wanted[:3])),
            ball(claims[number]),
            data["parts"],
        )
    return min(claims, default=math.inf)


def main(arguments: list[str] | None = None) -> int:
    """Check a file; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.check", description="Check the certificate of a plan."
    )
    parser.add_argument("--version", action="version", version=FORMAT)
    parser.add_argument("file", type=Path, help="the certificate")
    path = parser.parse_args(arguments).file
    try:
        demand(path.is_file() or not path.exists(), "not a regular file")
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as problem:
        print(f"{path}: cannot be read as JSON: {problem}", file=sys.stderr)
        return 2
    try:
        print(f"{path}: accepted: no intruder comes closer than {accept(data):.3f} m")
    except (ValueError, ArithmeticError) as problem:
        print(f"{path}: refused: {problem}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
