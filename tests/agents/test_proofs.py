"""Formulas and constants of the proofs are those of the code: definitions are read from the Coq
files.
"""

import math
import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import check
from agents.planner import separation, validator
from agents.planner.traffic import Requirement, Traffic, advance_reports, requirement_of
from envs import area_geometry, waypoints
from envs.areas import Area, Polygon
from envs.kinematics import C208_PUBLISHED, VehicleState

PROOFS = Path(__file__).parents[2] / "proofs"
TOKEN = re.compile(r"\s*(\d+|[A-Za-z_][A-Za-z_0-9']*|[-+*/()])")
HEAD = re.compile(r"Definition (\w+)((?:\s*\([^()]*\))*)\s*: R :=\s*(.*?)\.\s*(?=\n|$)", re.DOTALL)
ARGUMENTS = re.compile(r"\(([\w\s]+):")
PRIMITIVE = {
    "Rmax": max,
    "Rmin": min,
    "Rabs": abs,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "atan": math.atan,
    "Rle_dec": lambda a, b: a <= b,
    "Rlt_dec": lambda a, b: a < b,
}


class Reader:
    """Translates an expression over the reals from Coq to Python."""

    def __init__(self, text: str) -> None:
        self.tokens = TOKEN.findall(text)

    def take(self) -> str:
        return self.tokens.pop(0)

    def ahead(self) -> str:
        return self.tokens[0] if self.tokens else ""

    def expression(self) -> str:
        if self.ahead() == "if":
            self.take()
            condition, _, yes, _, no = (
                self.application(),
                self.take(),
                self.expression(),
                self.take(),
                self.expression(),
            )
            return f"({yes} if {condition} else {no})"
        parts = [self.product()]
        while self.ahead() in ("+", "-") and self.tokens:
            parts += [self.take(), self.product()]
        return "(" + " ".join(parts) + ")"

    def product(self) -> str:
        if self.ahead() == "-":
            self.take()
            parts = ["-", self.application()]
        else:
            parts = [self.application()]
        while self.ahead() in ("*", "/") and self.tokens:
            parts += [self.take(), self.application()]
        return " ".join(parts)

    def application(self) -> str:
        head, arguments = self.atom(), []
        while (
            self.tokens
            and re.match(r"[\w(]", self.ahead())
            and self.ahead() not in ("then", "else")
        ):
            arguments.append(self.atom())
        return f"{head}({', '.join(arguments)})" if arguments else head

    def atom(self) -> str:
        if self.ahead() == "(":
            self.take()
            inside = self.expression()
            assert self.take() == ")"
            return inside
        return self.take()


def definitions() -> dict[str, Callable[..., Any]]:
    scope: dict[str, Any] = dict(PRIMITIVE)
    for name in ("Constants", "Vectors", "Bound", "Area", "Motion", "Quadrature", "Level", "Safe"):
        text = re.sub(
            r"\(\*.*?\*\)", "", (PROOFS / f"{name}.v").read_text(encoding="utf-8"), flags=re.DOTALL
        )
        for label, arguments, body in HEAD.findall(text):
            if re.search(
                r"RInt|\bfun\b|\^", body
            ):  # positions are integrals in the proofs, and have closed forms
                continue
            code, names = Reader(body).expression(), " ".join(ARGUMENTS.findall(arguments)).split()
            scope[label] = eval(f"lambda {', '.join(names)}: {code}" if names else code, scope)
    return scope


COQ = definitions()


def test_definitions_are_read() -> None:
    assert {
        "TINY",
        "CLOSE",
        "norm",
        "bound",
        "loss",
        "opening",
        "growth",
        "required",
        "required_with_tolerance",
        "own_acceleration",
        "edge_distance",
        "angle",
    } <= set(COQ)
    assert COQ["norm"](3.0, 4.0) == 5.0
    assert COQ["loss"](2.0, 4.0) == pytest.approx(0.5)


def test_constants_are_the_codes() -> None:
    assert runpy.run_path(str(PROOFS / "constants.py"))["text"]() == (
        PROOFS / "Constants.v"
    ).read_text(encoding="utf-8")
    assert (COQ["CLOSE"], COQ["ROUNDING"]) == (validator.CLOSE, validator.ROUNDING)


def ends(rng: np.random.Generator, count: int) -> Any:
    """Return relative positions at the ends of parts: far and near, at rest, closing, opening and
    passing.
    """
    first = rng.normal(0.0, 1.0, (count, 2)) * 10.0 ** rng.uniform(0.0, 4.0, (count, 1))
    step = rng.normal(0.0, 1.0, (count, 2)) * 10.0 ** rng.uniform(-9.0, 3.5, (count, 1))
    aimed = rng.random(count) < 0.3
    step[aimed] = -first[aimed] * rng.uniform(-1.0, 2.5, (aimed.sum(), 1)) + 0.1 * step[aimed]
    return np.concatenate([first, first + step], axis=1)


def test_validators_bound_is_the_proven_one() -> None:
    rng = np.random.default_rng(1)
    at, sagittas = ends(rng, 2_000), 10.0 ** rng.uniform(-10.0, 2.0, 2_000)
    zero = np.zeros((1, 1))
    still = Traffic.straight(VehicleState(zero, zero, zero, zero))
    found, _ = separation.chords(
        zero + np.zeros((1, 2_000)),
        np.ones((1, 2_000)),
        (-at[None, :, 0], -at[None, :, 1]),
        (-at[None, :, 2], -at[None, :, 3]),
        still,
        8.0 * sagittas[None, :, None],
    )
    proven = [
        COQ["bound"](*row, sagitta)
        for row, sagitta in zip(at.tolist(), sagittas.tolist(), strict=True)
    ]
    assert found[0, :, 0] == pytest.approx(np.array(proven), rel=1e-9, abs=1e-6)


ARROW = Polygon(((0.0, 0.0), (4e3, -2e3), (1e3, 0.0), (3e3, 3e3)))


def sides_of(ring: Any) -> list[tuple[float, ...]]:
    """Return the edges of a ring: where each begins and ends."""
    return [(*ring[n - 1], *ring[n]) for n in range(len(ring))]


def test_distances_of_chords_from_areas_are_the_proven_ones() -> None:
    rng = np.random.default_rng(6)
    at = rng.uniform(-2e3, 5e3, (4, 300))
    at[2:] = at[:2] + rng.normal(0.0, 1.0, (2, 300)) * 10.0 ** rng.uniform(0.0, 3.7, 300)
    found = area_geometry.chord_distances(Area(ARROW), area_geometry.Parts(*at))
    crossing = 0
    for n, (px, py, qx, qy) in enumerate(at.T.tolist()):
        least = math.inf
        for edge in sides_of(ARROW.outer):
            ends = [COQ["side"](*edge, px, py), COQ["side"](*edge, qx, qy)]
            corners = [COQ["side"](px, py, qx, qy, *edge[k : k + 2]) for k in (0, 2)]
            if ends[0] * ends[1] < 0.0 and corners[0] * corners[1] < 0.0:
                least = -math.inf
            least = min(least, COQ["edge_distance"](px, py, qx, qy, *edge))
        if found.begin[n] > 0.0 and least > 0.0:
            assert found.bound[n] == pytest.approx(least, rel=1e-9, abs=1e-6)
        else:
            assert found.bound[n] <= 1e-6
        crossing += least < 0.0
    assert 10 < crossing < 200


def test_the_side_of_an_area_is_the_proven_winding() -> None:
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-2e3, 5e3, (2, 300))
    found = area_geometry.winding(area_geometry.edges(ARROW), x, y)
    proven = [
        sum(
            COQ["angle"](ax - px, ay - py, bx - px, by - py)
            for ax, ay, bx, by in sides_of(ARROW.outer)
        )
        for px, py in zip(x.tolist(), y.tolist(), strict=True)
    ]
    assert found == pytest.approx(np.array(proven), abs=1e-9)
    turns = found / (2.0 * math.pi)
    assert turns == pytest.approx(np.round(turns), abs=1e-9)
    assert set(np.round(turns)) == {0.0, 1.0}


def test_checkers_bound_is_the_best_proven_one() -> None:
    rng = np.random.default_rng(2)
    unit = 1 << check.BITS
    for x0, y0, x1, y1 in ends(rng, 300).tolist():
        sagitta = 10.0 ** rng.uniform(-6.0, 2.0)
        dx, dy = x1 - x0, y1 - y0
        open0, open1 = (
            (x0 * dx + y0 * dy) / math.hypot(x0, y0),
            -(x1 * dx + y1 * dy) / math.hypot(x1, y1),
        )
        known = [COQ["cross_bound"](x0, y0, x1, y1, sagitta)]
        known += [math.hypot(x0, y0) - COQ["loss"](sagitta, open0)] if open0 >= 0.0 else []
        known += [math.hypot(x1, y1) - COQ["loss"](sagitta, open1)] if open1 >= 0.0 else []
        known += [
            far - math.hypot(dx, dy) - sagitta for far in (math.hypot(x0, y0), math.hypot(x1, y1))
        ]
        found = (
            check.chord_bound(check.ball(x0, y0), check.ball(x1, y1), check.ball(sagitta).hi) / unit
        )
        assert found == pytest.approx(max(*known, 0.0), rel=1e-9, abs=1e-6)


def test_requirement_is_the_proven_one() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        std, vstd, away, time, age = rng.uniform(0.0, [200.0, 10.0, 3_000.0, 500.0, 5.0])
        asked = Requirement(1_000.0, rng.uniform(0.0, 100.0), rng.uniform(0.0, 5.0))
        one, own = np.full((1, 1), 0.0), float(rng.choice([math.nan, 300.0, 2_500.0]))
        traffic = Traffic.straight(VehicleState(one, one, one, one))
        traffic = traffic._replace(
            position_std=one + std, velocity_std=one + vstd, age=one + age, separation=one + own
        )
        spread = COQ["norm"](std, vstd * age)
        least = asked.separation if math.isnan(own) else own
        base = COQ["required"](least, asked.margin, asked.sigmas, spread, away)
        assert requirement_of(
            traffic, VehicleState(*np.full((4, 1), away / math.sqrt(2.0))), asked
        )[0, 0] == pytest.approx(base)
        grown = separation.growth(traffic, np.array([[time]]), asked)
        assert grown.item() == pytest.approx(
            COQ["growth"](asked.sigmas, std, vstd, age, time), abs=1e-9
        )


def test_intruders_fly_the_proven_closed_form() -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        psi, v, w = (
            rng.uniform(-3.0, 3.0),
            rng.uniform(0.0, 400.0),
            10.0 ** rng.uniform(-12.0, -0.5) * rng.choice([-1, 1]),
        )
        lasts, time, age = rng.uniform([1.0, 0.0, 0.0], [200.0, 500.0, 5.0])
        turning = min(time + age, lasts)
        x, y = (
            v * COQ["reach"](w, turning) * side(psi + w * turning / 2.0)
            + v * (time + age - turning) * side(COQ["course"](psi, w, lasts, time + age))
            for side in (math.cos, math.sin)
        )
        row = [np.full((1, 1), value) for value in (0.0, 0.0, psi, v, w, lasts, 0.0, 0.0, 0.0)]
        traffic = Traffic(VehicleState(*row[:4]), np.ones((1, 1), dtype=bool), *row[4:])
        now = advance_reports(traffic, np.full((1, 1), age))
        place = separation._positions(now, np.array([[time]]))
        assert (place[0].item(), place[1].item()) == pytest.approx((x, y), abs=1e-6)
        report = check.Report(0.0, 0.0, psi, v, age, w, lasts, 0.0, 0.0, 1.0)
        ball = check.track(report, check.Wind(0.0, 0.0, 0.0)).place_at(check.ball(time))
        assert (ball.x / (1 << check.BITS), ball.y / (1 << check.BITS)) == pytest.approx(
            (x, y), abs=1e-6
        )
        assert now.turn_time.item() == pytest.approx(COQ["advanced_lasts"](lasts, age))


def test_positions_along_an_arc_are_the_proven_sum() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        psi, v, w, a, h = rng.uniform([-3.0, 30.0, -0.09, -0.8, 0.1], [3.0, 100.0, 0.09, 0.5, 30.0])
        proven = [
            COQ["gauss"](lambda t, part=part: COQ[part](psi, v, w, a, t), h)  # noqa: B023
            for part in ("own_vx", "own_vy")
        ]
        assert waypoints._arc(psi, v, w, a, h) == pytest.approx(proven, abs=1e-9)
        one = (np.array([[value]]) for value in (0.0, 0.0, psi, v, w, a))
        x, y = separation.along(*one, np.array([[h / separation.FINE]]))
        assert (x[0, -1], y[0, -1]) == pytest.approx(proven, abs=1e-9)


def test_error_of_positions_is_the_proven_one(monkeypatch: pytest.MonkeyPatch) -> None:
    # A leg of ten minutes that winds: 0.6 rad in half an arc.
    ends = ([0.0, 16_677.97], [0.0, -3_722.89], [0.0, 0.12332], [99.0, 99.0], [0.0, 600.0])
    plan_states = waypoints.PlanStates(*(np.array([row]) for row in ends))
    curves = waypoints.legs(plan_states)
    arcs = [
        field.ravel().tolist() for field in (curves.yaw_rate, curves.acceleration, curves.speed)
    ]
    error = separation.position_error_bound(curves).item()
    assert error == pytest.approx(
        sum(COQ["position_error_bound"](w, a, v, 60.0) for w, a, v in zip(*arcs, strict=True)),
        rel=1e-9,
    )
    place = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for psi, w, a, v in zip(curves.heading.ravel(), *arcs, strict=True):
        t = 30.0 * (1.0 + nodes)
        place += np.sum(30.0 * weights * (v + a * t) * np.exp(1j * (psi + w * t)))
    last = curves.x[0, 0, -1] + 1j * curves.y[0, 0, -1]
    last += complex(*waypoints._arc(*(field[0, 0, -1] for field in curves[5:]), 60.0))
    assert 1e-7 < abs(place - last) < error < 1e-3

    one = np.ones((1, 1))
    traffic = Traffic.straight(VehicleState(8_000.0 * one, 9_000.0 * one, one, 0.0 * one))
    near = validator.validate(
        plan_states, traffic, Requirement(1_000.0), C208_PUBLISHED
    ).min_separation
    monkeypatch.setattr(
        validator, "position_error_bound", lambda curves: 1.0 + 0.0 * curves.duration
    )
    less = validator.validate(
        plan_states, traffic, Requirement(1_000.0), C208_PUBLISHED
    ).min_separation
    assert near - less == pytest.approx([1.0 - error])


def test_accelerations_are_the_proven_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    chords = separation.chords

    def spy(*given: Any) -> Any:
        seen.append(given)
        return chords(*given)

    monkeypatch.setattr(validator, "chords", spy)
    plan_states = waypoints.PlanStates(
        *(
            np.array([row])
            for row in (
                [0.0, 1_500.0, 3_050.0],
                [0.0, 300.0, 500.0],
                [0.1, 0.3, 0.0],
                [80.0, 74.0, 80.0],
            )
        ),
        time=np.array([[0.0, 20.0, 40.0]]),
    )
    one = np.ones((1, 1))
    traffic = Traffic(
        VehicleState(9_000.0 * one, 0.0 * one, 3.0 * one, 90.0 * one),
        one == 1.0,
        0.02 * one,
        10.0 * one,
        0.0 * one,
        0.0 * one,
        0.0 * one,
    )
    validator.validate(plan_states, traffic, Requirement(1_000.0), C208_PUBLISHED)
    relative_acceleration = seen[0][5].ravel()  # of both legs
    curves = waypoints.legs(plan_states)
    expected = [
        COQ["own_acceleration"](v, w, p, 2.0) + COQ["other_acceleration"](90.0, 0.02, 10.0)
        for v, w, p in zip(
            *(
                field.ravel().tolist()
                for field in (curves.speed, curves.yaw_rate, curves.acceleration)
            ),
            strict=True,
        )
    ]
    assert relative_acceleration == pytest.approx(np.array(expected))
    assert COQ["sagitta"](2.0, 4.0) == pytest.approx(4.0)
