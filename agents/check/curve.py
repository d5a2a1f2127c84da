"""The curve of a leg between two waypoints, in floats, as envs/waypoints.py defines it."""

import cmath
import math

from .certificate import ARCS, PlanState

_STEPS = 12  # of Newton at most
_NEAR_ENOUGH = 5e-4  # of the curve's end to its waypoint, m
_RATE_WEIGHT = 4e-4
_ACCELERATION_WEIGHT = 4e-2


def gauss_legendre() -> list[tuple[float, float]]:
    """Return nodes and weights of the rule of four points over [0, 1].

    Over [-1, 1] the nodes are +-sqrt((3 +- 2 sqrt(6/5)) / 7), their weights
    (18 -+ sqrt(30)) / 36.
    """
    roots = [
        (s, q, math.sqrt((3.0 + q * math.sqrt(4.8)) / 7.0)) for q in (-1, 1) for s in (-0.5, 0.5)
    ]
    return [(0.5 + s * root, (18.0 - q * math.sqrt(30.0)) / 72.0) for s, q, root in roots]


_RULE = gauss_legendre()


def curve_controls(a: PlanState, b: PlanState) -> list[float]:
    """Return a leg's ten turn rates and ten accelerations: the curve of ten arcs with the least
    change of its controls from their means that ends where b stands, found by Newton steps.
    """
    h = (b.time - a.time) / ARCS
    mean = [turn_between(a.heading, b.heading) / (ARCS * h)] * ARCS
    mean += [(b.speed - a.speed) / (ARCS * h)] * ARCS
    controls = mean
    for step in range(_STEPS + 1):
        steps = arc_displacements(a, controls, h)
        miss = complex(b.x - a.x, b.y - a.y) - sum(steps)
        if abs(miss) <= _NEAR_ENOUGH or step == _STEPS:
            break
        controls = newton_step(mean, controls, control_effects(steps, h), miss)
    return controls


def turn_between(before: float, after: float) -> float:
    """Return the turn from a heading to another, rad, to the left, in [-pi, pi)."""
    turn = after - before
    turn -= math.tau * math.floor((turn + math.pi) * (1.0 / math.tau))
    return turn - math.tau if turn >= math.pi else turn  # half a circle is one to the right


def arc_displacements(a: PlanState, controls: list[float], h: float) -> list[complex]:
    """Return the displacement in each arc of h seconds from a, x + iy, m: the integral of
    (v + p t) exp(i (heading + w t)) over t from 0 to h, by the rule.
    """
    heading, speed, steps = a.heading, a.speed, []
    for w, p in zip(controls[:ARCS], controls[ARCS:], strict=True):
        step = sum(
            g * h * (speed + p * u * h) * cmath.rect(1.0, heading + w * u * h) for u, g in _RULE
        )
        steps.append(step)
        heading, speed = heading + w * h, speed + p * h
    return steps


def control_effects(steps: list[complex], h: float) -> list[tuple[float, complex]]:
    """Return of each control its weight and what a unit more of it adds to the leg's end, x + iy.

    More turn in an arc turns half of its own displacement and all after it to the left; more
    acceleration lengthens them along their directions. The means are taken off, so that the sums
    of the turn rates and of the accelerations stay as they are.
    """
    units = [h * h * step / max(abs(step), 1e-9) for step in steps]
    turns = [sum(steps[k:]) - 0.5 * steps[k] for k in range(ARCS)]
    gains = [sum(units[k:]) - 0.5 * units[k] for k in range(ARCS)]
    effects = [(_RATE_WEIGHT, 1j * h * (turn - sum(turns) / ARCS)) for turn in turns]
    effects += [(_ACCELERATION_WEIGHT, gain - sum(gains) / ARCS) for gain in gains]
    return effects


def newton_step(
    mean: list[float], controls: list[float], effects: list[tuple[float, complex]], miss: complex
) -> list[float]:
    """Return the controls nearest their means whose end, to first order, lies ``miss`` from that
    of some controls.

    With weights g and effects e they are mean + g Re(e conj(m)), where m solves the normal
    equations S m + D conj(m) = 2 miss: S is the sum of g |e|^2, D that of g e^2.
    """
    # From where the means end, to first order; what the means themselves add sums to nothing.
    miss += sum(e * u for (_, e), u in zip(effects, controls, strict=True))
    s = sum(g * abs(e) ** 2 for g, e in effects)
    d = sum(g * e * e for g, e in effects)
    m = 2.0 * (s * miss - d * miss.conjugate()) / max(s * s - abs(d) ** 2, 4e-12)
    return [
        middle + g * (e * m.conjugate()).real for middle, (g, e) in zip(mean, effects, strict=True)
    ]
