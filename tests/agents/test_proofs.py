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

from agents.check import tolerances as check_tolerances
from agents.check.balls import BITS, ball
from agents.check.certificate import Report
from agents.check.certificate import Wind as StatedWind
from agents.check.chord import chord_bound
from agents.check.separation import track_of
from agents.kernel import areas, clearance, separation, trajectory
from agents.kernel.areas import ActiveArea
from agents.kernel.levels import Altitude
from agents.kernel.traffic import (
    Requirement,
    Traffic,
    advance_reports,
    growth,
    positions,
    requirement_of,
)
from agents.planner.judge import validator
from envs import area_geometry, waypoints
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.compiled import Entry
from envs.kinematics import C208_PUBLISHED, Limits, VehicleState
from envs.wind import Wind, narrow, over_ground, through_air

PROOFS = Path(__file__).parents[2] / "proofs"
FILES = (
    "Constants",
    "Vectors",
    "Bound",
    "Area",
    "Motion",
    "Quadrature",
    "Level",
    "Climb",
    "Wind",
    "Safe",
)
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
    for name in FILES:
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
        "area_need",
        "narrow_turn",
        "level_time",
        "first_change",
    } <= set(COQ)
    assert COQ["norm"](3.0, 4.0) == 5.0
    assert COQ["loss"](2.0, 4.0) == pytest.approx(0.5)
    assert COQ["first_change"](2.0, 10.0, -36.0) == pytest.approx(-4.0)


def test_constants_are_the_codes() -> None:
    assert runpy.run_path(str(PROOFS / "constants.py"))["text"]() == (
        PROOFS / "Constants.v"
    ).read_text(encoding="utf-8")
    assert (COQ["CLOSE"], COQ["ROUNDING"]) == (clearance.CLOSE, clearance.ROUNDING)
    assert COQ["NEARER"] == areas.NEARER == check_tolerances.NEARER


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
    intruder = Traffic.straight(VehicleState(zero, zero, zero, zero))
    none, second = np.zeros((1, 2_000)), np.ones((1, 2_000))
    pieces = trajectory.Pieces(
        np.zeros(1, dtype=int),
        np.zeros(1, dtype=int),
        none,
        second,
        *(-at.T[:, None]),
        *(none,) * 4,
        8.0 * sagittas[None],
        zero,
        zero,
        zero,
    )
    distances = separation.chords(pieces, intruder).distance
    proven = [
        COQ["bound"](*row, sagitta)
        for row, sagitta in zip(at.tolist(), sagittas.tolist(), strict=True)
    ]
    assert distances[0] == pytest.approx(np.array(proven), rel=1e-9, abs=1e-6)


ARROW = Polygon(((0.0, 0.0), (4e3, -2e3), (1e3, 0.0), (3e3, 3e3)))


def sides_of(ring: Any) -> list[tuple[float, ...]]:
    """Return the edges of a ring: where each begins and ends."""
    return [(*ring[n - 1], *ring[n]) for n in range(len(ring))]


def test_distances_of_chords_from_areas_are_the_proven_ones() -> None:
    rng = np.random.default_rng(6)
    at = rng.uniform(-2e3, 5e3, (4, 300))
    at[2:] = at[:2] + rng.normal(0.0, 1.0, (2, 300)) * 10.0 ** rng.uniform(0.0, 3.7, 300)
    distances = area_geometry.chord_distances(Area(ARROW), area_geometry.Parts(*at))
    crossing = 0
    for n, (px, py, qx, qy) in enumerate(at.T.tolist()):
        least = math.inf
        for edge in sides_of(ARROW.outer):
            ends = [COQ["side"](*edge, px, py), COQ["side"](*edge, qx, qy)]
            corners = [COQ["side"](px, py, qx, qy, *edge[k : k + 2]) for k in (0, 2)]
            if ends[0] * ends[1] < 0.0 and corners[0] * corners[1] < 0.0:
                least = -math.inf
            least = min(least, COQ["edge_distance"](px, py, qx, qy, *edge))
        if distances.begin[n] > 0.0 and least > 0.0:
            assert distances.bound[n] == pytest.approx(least, rel=1e-9, abs=1e-6)
        else:
            assert distances.bound[n] <= 1e-6
        crossing += least < 0.0
    assert 10 < crossing < 200


def test_the_side_of_an_area_is_the_proven_winding() -> None:
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-2e3, 5e3, (2, 300))
    angles = area_geometry.winding(area_geometry.edges(ARROW), x, y)
    proven = [
        sum(
            COQ["angle"](ax - px, ay - py, bx - px, by - py)
            for ax, ay, bx, by in sides_of(ARROW.outer)
        )
        for px, py in zip(x.tolist(), y.tolist(), strict=True)
    ]
    assert angles == pytest.approx(np.array(proven), abs=1e-9)
    turns = angles / (2.0 * math.pi)
    assert turns == pytest.approx(np.round(turns), abs=1e-9)
    assert set(np.round(turns)) == {0.0, 1.0}


def some_area(rng: np.random.Generator, *, circle: bool) -> Area:
    """Return an area that moves and grows, of either kind."""
    disc = Circle(*rng.uniform(-1e3, 1e3, 2).tolist(), float(rng.uniform(500.0, 4e3)))
    return Area(
        disc if circle else ARROW,
        keep=Keep.IN if rng.random() < 0.5 else Keep.OUT,
        velocity=tuple(rng.uniform(-30.0, 30.0, 2).tolist()),
        growth=float(rng.uniform(-3.0, 3.0)),
        clearance=float(rng.uniform(0.0, 500.0)),
    )


def gain(area: Area) -> float:
    return COQ["gain"](area.keep is Keep.OUT, area.growth)


def test_distances_of_chords_from_circles_are_the_proven_ones() -> None:
    rng = np.random.default_rng(8)
    for _ in range(50):
        area = some_area(rng, circle=True)
        assert isinstance(area.shape, Circle)
        x, y, radius = area.shape.x, area.shape.y, area.shape.radius
        at = ends(rng, 20)
        bounds = area_geometry.chord_distances(area, area_geometry.Parts(*at.T)).bound
        for (px, py, qx, qy), bound in zip(at.tolist(), bounds, strict=True):
            if area.keep is Keep.OUT:
                proven = COQ["nearest"](px - x, py - y, qx - x, qy - y) - radius
            else:
                proven = radius - max(COQ["norm"](px - x, py - y), COQ["norm"](qx - x, qy - y))
            assert bound == pytest.approx(proven, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("circle", [True, False])
def test_bounds_of_parts_of_plans_are_the_proven_ones(circle: bool) -> None:
    rng = np.random.default_rng(9)
    for _ in range(30):
        area, rows = some_area(rng, circle=circle), 20
        at, begin = rng.uniform(-5e3, 5e3, (2, rows)), rng.uniform(0.0, 300.0, rows)
        length, bend, error = rng.uniform(0.1, 5.0, rows), rng.uniform(0.0, 9.0, rows), 1e-3
        step = rng.normal(0.0, 100.0, (2, rows))
        arcs = areas.Chords(begin, begin + length, *at, *(at + step), bend, np.full(rows, error))
        bound, attained = areas.bounds_of_chords(area, arcs, np.full(rows, np.inf))
        own = area_geometry.Parts(
            *(at - np.outer(area.velocity, begin)),
            *(at + step - np.outer(area.velocity, begin + length)),
        )
        chord = area_geometry.chord_distances(area, own)
        for n in range(rows):
            grown = gain(area) * begin[n], gain(area) * (begin[n] + length[n])
            lost = COQ["area_sagitta"](bend[n], length[n]) + error
            assert bound[n] == pytest.approx(chord.bound[n] + min(grown) - lost, abs=1e-6)
            whole = min(chord.begin[n] + grown[0], chord.end[n] + grown[1])
            assert attained[n] == pytest.approx(whole, abs=1e-6)
            # The bound by the ends alone (by_ends) never says more.
            distance = math.hypot(own.x1[n] - own.x0[n], own.y1[n] - own.y0[n])
            assert chord.bound[n] >= 0.5 * (chord.begin[n] + chord.end[n] - distance) - 1e-6


def test_what_plans_must_keep_of_areas_is_the_proven_need() -> None:
    rng = np.random.default_rng(10)
    inside = 0
    for _ in range(600):
        area, margin = some_area(rng, circle=False), float(rng.uniform(0.0, 100.0))
        (x,), (y,) = place = rng.uniform(-3e3, 5e3, (2, 1))
        first = float(rng.choice([0.0, 30.0]))
        away = float(area_geometry.signed_distance(area, x, y))
        need = areas.required_distances(ActiveArea(0, area, first, 400.0), *place, margin)
        proven = COQ["area_need"](area.clearance + margin, away, first)
        assert need.item() == pytest.approx(proven, abs=1e-9)
        less = areas._less_tolerance(need).item()
        assert less == pytest.approx(COQ["area_need_with_tolerance"](proven), abs=1e-12)
        inside += 0.0 < proven < area.clearance + margin
    assert inside > 10


def test_areas_count_in_the_proven_window() -> None:
    rng = np.random.default_rng(11)
    closed = 0
    for _ in range(300):
        value, level, climb, error, spread = rng.uniform(
            [0.0, 0.0, -10.0, 0.0, 0.0], [3e3, 3e3, 10.0, 300.0, 2.0]
        ).tolist()
        above = bool(rng.random() < 0.5)
        heights = {"floor" if above else "ceiling": Level(level, "msl")}
        area = Area(ARROW, **heights)
        side = 1.0 if above else -1.0
        own = Altitude(value, "msl", climb, error, spread)
        begin, end = areas.window(area, own, 9.0)
        arguments = side, value, climb, error, spread, level
        gap, rate = (
            COQ["gap_at_request"](side, value, error, level),
            COQ["gap_rate"](side, climb, spread),
        )
        for time in (begin, end):
            if math.isfinite(time):
                assert time == pytest.approx(COQ["level_time"](gap, rate))
                assert COQ["over_level"](*arguments, time) == pytest.approx(0.0, abs=1e-6)
                closed += 1
        for time in rng.uniform(0.0, 500.0, 20).tolist():
            assert (begin <= time <= end) or COQ["over_level"](*arguments, time) < 0.0
    assert closed > 100


def test_limits_are_narrowed_as_proven() -> None:
    rng = np.random.default_rng(12)
    for _ in range(200):
        slow, fast, weak, strong, turn, error = rng.uniform(
            [0.0, 60.0, -2.0, 0.1, 0.02, 0.01], [50.0, 200.0, -0.1, 2.0, 0.3, 9.0]
        ).tolist()
        narrowed = narrow(Limits(slow, fast, weak, strong, turn), error)
        slow = COQ["lowest"](slow, weak, strong, turn, error)
        narrowed_turn = COQ["narrow_turn"](slow, weak, strong, turn, error)
        proven = (
            COQ["narrow_speed_min"](slow, error),
            COQ["narrow_speed_max"](fast, error),
            COQ["narrow_acc_min"](weak, narrowed_turn, error),
            COQ["narrow_acc_max"](strong, narrowed_turn, error),
            narrowed_turn,
        )
        assert narrowed == pytest.approx(proven)


def test_turns_in_another_wind_go_where_the_proof_says() -> None:
    rng = np.random.default_rng(13)
    for _ in range(200):
        heading, speed, turn = rng.uniform([-3.0, 5.0, -4.0], [3.0, 200.0, 4.0]).tolist()
        wind = Wind(*rng.uniform(-20.0, 20.0, 2).tolist())
        air = through_air(VehicleState(0.0, 0.0, heading, speed), wind, 0.0)
        later = over_ground(air._replace(heading=air.heading + turn), wind, 0.0)
        ground = speed * math.cos(heading), speed * math.sin(heading)
        proven = (
            COQ["turned_x"](*ground, wind.east, wind.north, turn),
            COQ["turned_y"](*ground, wind.east, wind.north, turn),
        )
        assert (
            later.speed * math.cos(later.heading),
            later.speed * math.sin(later.heading),
        ) == pytest.approx(proven)


def test_checkers_bound_is_the_best_proven_one() -> None:
    rng = np.random.default_rng(2)
    unit = 1 << BITS
    for x0, y0, x1, y1 in ends(rng, 300).tolist():
        sagitta = 10.0 ** rng.uniform(-6.0, 2.0)
        dx, dy = x1 - x0, y1 - y0
        open0, open1 = (
            (x0 * dx + y0 * dy) / math.hypot(x0, y0),
            -(x1 * dx + y1 * dy) / math.hypot(x1, y1),
        )
        proven = [COQ["cross_bound"](x0, y0, x1, y1, sagitta)]
        proven += [math.hypot(x0, y0) - COQ["loss"](sagitta, open0)] if open0 >= 0.0 else []
        proven += [math.hypot(x1, y1) - COQ["loss"](sagitta, open1)] if open1 >= 0.0 else []
        proven += [
            far - math.hypot(dx, dy) - sagitta for far in (math.hypot(x0, y0), math.hypot(x1, y1))
        ]
        stated = chord_bound(ball(x0, y0), ball(x1, y1), ball(sagitta).hi) / unit
        assert stated == pytest.approx(max(*proven, 0.0), rel=1e-9, abs=1e-6)


def test_requirement_is_the_proven_one() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        std, vstd, away, time, age = rng.uniform(0.0, [200.0, 10.0, 3_000.0, 500.0, 5.0])
        requirement = Requirement(1_000.0, rng.uniform(0.0, 100.0), rng.uniform(0.0, 5.0))
        zero, own = np.full((1, 1), 0.0), float(rng.choice([math.nan, 300.0, 2_500.0]))
        traffic = Traffic.straight(VehicleState(zero, zero, zero, zero))
        traffic = traffic._replace(
            position_std=zero + std, velocity_std=zero + vstd, age=zero + age, separation=zero + own
        )
        spread = COQ["norm"](std, vstd * age)
        least = requirement.separation if math.isnan(own) else own
        base = COQ["required"](least, requirement.margin, requirement.sigmas, spread, away)
        assert requirement_of(
            traffic, VehicleState(*np.full((4, 1), away / math.sqrt(2.0))), requirement
        )[0, 0] == pytest.approx(base)
        grown = growth(traffic, np.array([[time]]), requirement.sigmas)
        assert grown.item() == pytest.approx(
            COQ["growth"](requirement.sigmas, std, vstd, age, time), abs=1e-9
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
        place = positions(now, np.array([[time]]))
        assert (place[0].item(), place[1].item()) == pytest.approx((x, y), abs=1e-6)
        report = Report(0.0, 0.0, psi, v, age, w, lasts, 0.0, 0.0, 1.0)
        track = track_of(report, StatedWind(0.0, 0.0, 0.0))
        proven = track.position_at(ball(time))
        assert (proven.x / (1 << BITS), proven.y / (1 << BITS)) == pytest.approx((x, y), abs=1e-6)
        assert now.turn_time.item() == pytest.approx(COQ["advanced_lasts"](lasts, age))


def test_positions_along_an_arc_are_the_proven_sum() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        psi, v, w, a, h = rng.uniform([-3.0, 30.0, -0.09, -0.8, 0.1], [3.0, 100.0, 0.09, 0.5, 30.0])
        proven = [
            COQ["gauss"](lambda t, part=part: COQ[part](psi, v, w, a, t), h)  # noqa: B023
            for part in ("own_vx", "own_vy")
        ]
        assert waypoints.displacement(psi, v, w, a, h) == pytest.approx(proven, abs=1e-9)
        none = np.zeros((1, 1))
        arc = trajectory.Pieces(
            *(np.zeros(1, dtype=int),) * 2,
            *(none,) * 6,
            *(none + value for value in (psi, v, w, a)),
            none,
            none,
            none,
            none,
        )
        x, y = trajectory.along(arc, none + h / trajectory.FINE)
        assert (x[0, -1], y[0, -1]) == pytest.approx(proven, abs=1e-9)


def test_error_of_positions_is_the_proven_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Entry, "ready", False)
    # A leg of ten minutes that winds: 0.6 rad in half an arc.
    ends = ([0.0, 16_677.97], [0.0, -3_722.89], [0.0, 0.12332], [99.0, 99.0], [0.0, 600.0])
    plan_states = waypoints.PlanStates(*(np.array([row]) for row in ends))
    curves = waypoints.legs(plan_states)
    arcs = [
        field.ravel().tolist() for field in (curves.yaw_rate, curves.acceleration, curves.speed)
    ]
    error = trajectory.position_error_bound(curves).item()
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
    last += complex(*waypoints.displacement(*(field[0, 0, -1] for field in curves[5:]), 60.0))
    assert 1e-7 < abs(place - last) < error < 1e-3

    unit = np.ones((1, 1))
    traffic = Traffic.straight(VehicleState(8_000.0 * unit, 9_000.0 * unit, unit, 0.0 * unit))
    near = validator.validate(
        plan_states, traffic, Requirement(1_000.0), C208_PUBLISHED
    ).min_separation
    monkeypatch.setattr(
        trajectory, "position_error_bound", lambda curves: 1.0 + 0.0 * curves.duration
    )
    less = validator.validate(
        plan_states, traffic, Requirement(1_000.0), C208_PUBLISHED
    ).min_separation
    assert near - less == pytest.approx([1.0 - error])


def test_accelerations_are_the_proven_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Entry, "ready", False)
    calls_made: list[Any] = []
    chords = separation.chords

    def spy(*arguments: Any) -> Any:
        calls_made.append(arguments)
        return chords(*arguments)

    monkeypatch.setattr(separation, "chords", spy)
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
    unit = np.ones((1, 1))
    traffic = Traffic(
        VehicleState(9_000.0 * unit, 0.0 * unit, 3.0 * unit, 90.0 * unit),
        unit == 1.0,
        0.02 * unit,
        10.0 * unit,
        0.0 * unit,
        0.0 * unit,
        0.0 * unit,
    )
    validator.validate(plan_states, traffic, Requirement(1_000.0), C208_PUBLISHED)
    arcs, intruder = calls_made[0]  # of both legs
    turn = intruder.state.speed * intruder.turn_rate
    relative_acceleration = (arcs.bend + turn).ravel()
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
