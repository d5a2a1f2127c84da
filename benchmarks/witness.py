"""Optimality gap of the least-cost witnesses: ``python -m benchmarks.witness``.

Circle encounters in conflict. Each witness is compared with the shortest flight that an independent
optimiser finds: free controls, constant over a thirtieth of the flight, by sequential quadratic
programming (scipy's SLSQP) with the gradients of the world's own functions, from the witness itself
and from crude flights past either side at several speeds. A flight counts only if it keeps the
rules at every second. The straight line is a true lower bound.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from agents.manoeuvres.escape_manoeuvre import steps, tracks
from agents.manoeuvres.escape_search import Found
from agents.resolvability.classify import replay
from agents.resolvability.witness import least_cost
from benchmarks.measure import report, show
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.edge.command import Parser, run_cli
from envs.encounters import Encounter, scenario
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.outcome import RULES
from envs.relative import bearing, distance, leg_separation, straight_cpa
from envs.starts import encounters_of_seed
from envs.trees import take

PIECES = 30
"""Of constant control that a flight is cut into."""

BLOCK = 5
"""Seconds whose smallest separation is one constraint."""

GUARD = 0.01
"""By which the optimiser keeps the rules more strictly, m, because it keeps them only nearly."""


class Problem(NamedTuple):
    """One encounter and a duration for the optimiser."""

    own: VehicleState
    goal: Any
    """``[2]``, m."""
    traffic: VehicleState
    """Intruders at the beginning and after every step, ``[T + 1, K]``."""
    mask: Any
    """``[K]``."""
    count: Any
    """Steps of the flight."""


def fly(controls: Any, problem: Problem) -> tuple[Any, Any, Any]:
    """Fly controls ``[PIECES, 2]``; return the length, the last distance to the goal and the
    separations ``[T]``.
    """
    index = jnp.arange(problem.traffic.x.shape[0] - 1)
    each = controls[jnp.minimum(index * PIECES // problem.count, PIECES - 1)]
    before = jax.tree.map(lambda field: field[:-1], problem.traffic)
    after = jax.tree.map(lambda field: field[1:], problem.traffic)

    def step(own: VehicleState, now: Any) -> tuple[VehicleState, tuple[Any, Any]]:
        flying, control, traffic, traffic_next = now
        acceleration, yaw_rate = commands((control[0], control[1]), SURROGATE, jnp)
        moved = advance(own, acceleration, yaw_rate, RULES.dt, SURROGATE, jnp)
        apart = jnp.where(
            problem.mask, leg_separation(own, moved, traffic, traffic_next, RULES.dt, jnp), 1e6
        )
        length = jnp.where(flying, 0.5 * RULES.dt * (own.speed + moved.speed), 0.0)
        kept = jax.tree.map(lambda new, old: jnp.where(flying, new, old), moved, own)
        return kept, (length, jnp.where(flying, jnp.min(apart), 1e6))

    last, (lengths, apart) = jax.lax.scan(
        step, problem.own, (index < problem.count, each, before, after)
    )
    to_goal = distance(problem.goal[0] - last.x, problem.goal[1] - last.y, jnp)
    return jnp.sum(lengths), to_goal, apart


def _numbers(flat: Any, problem: Problem) -> Any:
    """Return the length and what the constraints keep positive, in km, ``[1 + C]``."""
    length, to_goal, apart = fly(flat.reshape(-1, 2), problem)
    nearest = jnp.minimum(jnp.min(apart.reshape(-1, BLOCK), axis=-1), 3.0 * RULES.separation)
    slack = jnp.append(nearest - RULES.separation, RULES.goal_radius - to_goal) - GUARD
    return jnp.concatenate([length[None], slack]) * 1e-3


_VALUES = jax.jit(_numbers)
_SLOPES = jax.jit(jax.jacfwd(_numbers))
_FLOWN = jax.jit(fly)


def optimise(guess: Any, problem: Problem, iterations: int) -> float:
    """Return the length, m, of the best flight from a guess ``[PIECES, 2]``; inf if it breaks a
    rule.
    """
    cache: dict[bytes, tuple[Any, Any]] = {}

    def at(flat: Any) -> tuple[Any, Any]:
        key = flat.tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = np.asarray(_VALUES(flat, problem)), np.asarray(_SLOPES(flat, problem))
        return cache[key]

    done = minimize(
        lambda flat: at(flat)[0][0],
        np.clip(guess, -1.0, 1.0).ravel(),
        jac=lambda flat: at(flat)[1][0],
        bounds=[(-1.0, 1.0)] * guess.size,
        constraints={
            "type": "ineq",
            "fun": lambda flat: at(flat)[0][1:],
            "jac": lambda flat: at(flat)[1][1:],
        },
        method="SLSQP",
        options={"maxiter": iterations, "ftol": 1e-6},
    )
    length, to_goal, apart = (
        np.asarray(value) for value in _FLOWN(np.clip(done.x, -1, 1).reshape(-1, 2), problem)
    )
    return (
        float(length)
        if apart.min() >= RULES.separation and to_goal <= RULES.goal_radius
        else np.inf
    )


def crude(encounter: Encounter, aside: float, speed: float) -> tuple[Any, int]:
    """Return controls ``[T, 2]`` of a flight that aims ``aside`` rad beside the goal until the
    closest approach.
    """
    own, controls = encounter.own, []
    seen = VehicleState(*(field[None] for field in own))
    until = float(
        straight_cpa(seen, VehicleState(*(field[:1] for field in encounter.intruders)), np).time[0]
    )
    for index in range(steps(RULES)):
        if distance(encounter.goal_x - own.x, encounter.goal_y - own.y, np) <= RULES.goal_radius:
            break
        course = bearing(own, encounter.goal_x, encounter.goal_y, np) + (
            aside if index < until else 0.0
        )
        action = np.clip(
            [2.0 * (speed - own.speed), wrap(course, np) / SURROGATE.yaw_rate_max], -1.0, 1.0
        )
        own = advance(
            own, *commands((action[0], action[1]), SURROGATE, np), RULES.dt, SURROGATE, np
        )
        controls.append(action)
    return np.array(controls), len(controls)


def pieces(controls: Any) -> Any:
    """Return the means of controls ``[T, 2]`` over the pieces, ``[PIECES, 2]``."""
    number = np.minimum(np.arange(len(controls)) * PIECES // len(controls), PIECES - 1)
    return np.stack(
        [
            np.mean(controls[number == i], axis=0) if (number == i).any() else controls[0]
            for i in range(PIECES)
        ]
    )


def record(encounter: Encounter, witnesses: Found, number: int) -> Any:
    """Return the controls ``[T, 2]`` of a witness."""
    own = replay(encounter, take(witnesses.manoeuvre, number), RULES, SURROGATE).own
    turn = wrap(np.diff(own.heading), np) / (SURROGATE.yaw_rate_max * RULES.dt)
    return np.stack([np.diff(own.speed) / (SURROGATE.acceleration_max * RULES.dt), turn], axis=-1)


def in_conflict(count: int, seed: int) -> Encounter:
    """Return circle encounters whose straight courses pass within the separation, ``[count]``."""
    return encounters_of_seed(
        scenario("circle", PAPER, conflicts_closer_than=RULES.separation), seed, 0, count
    )


def compare(encounter: Encounter, witnesses: Found, number: int, iterations: int) -> float:
    """Return the shortest length that the optimiser finds for one encounter, m."""
    traffic = tracks(encounter, steps(RULES), RULES)
    goal = np.array([encounter.goal_x, encounter.goal_y])
    solve = partial(Problem, encounter.own, goal, traffic, encounter.mask)
    controls = record(encounter, witnesses, number)
    guesses = [(controls, len(controls))]
    guesses += [
        crude(encounter, aside, speed)
        for aside, speed in ((0.0, 55.0), (0.0, 95.0), (0.35, 75.0), (-0.35, 75.0))
    ]
    return min(
        optimise(pieces(flight), solve(np.asarray(count)), iterations) for flight, count in guesses
    )


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument(
        "--encounters", type=int, default=60, help="circle encounters in conflict (default 60)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the encounters (default 0)")
    parser.add_argument(
        "--iterations", type=int, default=40, help="of each optimisation (default 40)"
    )
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    encounters = in_conflict(options.encounters, options.seed)
    witnesses = least_cost(encounters, RULES, SURROGATE)
    known = np.flatnonzero(~np.isnan(witnesses.path))
    free = np.array(
        [compare(take(encounters, i), witnesses, int(i), options.iterations) for i in known]
    )
    own = encounters.own
    straight = (
        distance(encounters.goal_x - own.x, encounters.goal_y - own.y, np)[known]
        - RULES.goal_radius
    )
    path = witnesses.path[known]
    best = np.minimum(free, path)
    figures = {
        "encounters": options.encounters,
        "witnesses": known.size,
        "optimiser_found_none": int(np.sum(np.isinf(free))),
        "optimiser_shorter_by_more_than_1_m": int(np.sum(free < path - 1.0)),
        "witness_shorter_by_more_than_1_m": int(np.sum(path < free - 1.0)),
        "gap_to_best_mean": float(np.mean(path / best - 1.0)),
        "gap_to_best_p95": float(np.percentile(path / best - 1.0, 95.0)),
        "gap_to_best_max": float(np.max(path / best - 1.0)),
        "gap_to_straight_line_mean": float(np.mean(path / straight - 1.0)),
        "gap_to_straight_line_p95": float(np.percentile(path / straight - 1.0, 95.0)),
        "path_mean_m": float(np.mean(path)),
    }
    show(figures)
    report(figures, ("jax", "jaxlib", "numpy", "scipy"))


if __name__ == "__main__":
    run_cli(main)
