"""Optimality gap of the least-cost witnesses: ``python -m benchmarks.witness``.

Circle encounters in conflict. Each witness is compared with the shortest flight that an independent
optimiser finds: free controls, constant over a thirtieth of the flight, by sequential quadratic
programming (scipy's SLSQP) with the gradients of the world's own functions, from the witness itself
and from crude flights past either side at several speeds. A flight counts only if it keeps the
rules at every second. The straight line is a true lower bound.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.optimize import minimize

from agents.manoeuvres.escape_manoeuvre import steps, tracks
from agents.manoeuvres.escape_search import Escapes
from agents.resolvability.classify import replay
from agents.resolvability.witness import least_cost
from benchmarks.measure import report, show
from commands.command import Parser, run_cli, whole
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.outcome import RULES
from envs.relative import bearing, distance, leg_separation, straight_cpa
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take

PIECES = 30
"""Of constant control that a flight is cut into."""

BLOCK = 5
"""Seconds whose smallest separation is one constraint."""

GUARD = 0.01
"""By which the optimiser keeps the rules more strictly, m, because it keeps them only nearly."""


_GUESSES = (0.0, 55.0), (0.0, 95.0), (0.35, 75.0), (-0.35, 75.0)  # rad aside of the goal, m/s


class Problem(NamedTuple):
    """One encounter and a duration for the optimiser."""

    own: VehicleState[Air]
    goal: Float[Array, "2"]  # m
    traffic: VehicleState[Air]
    """Intruders at the beginning and after every step, ``[T + 1, K]``."""
    mask: Bool[Array, " K"]
    steps: Int[Array, ""]
    """Of the flight."""


class Flight(NamedTuple):
    """What is asked of a flight, m."""

    length: Float[Array, ""]
    to_goal: Float[Array, ""]  # at the end
    separation: Float[Array, " T"]  # smallest in each step; 1e6 after the flight


class _Step(NamedTuple):
    """A step of a flight."""

    flying: Bool[Array, ""]
    control: Float[Array, "2"]
    traffic: VehicleState[Air]  # at its beginning, [K]
    traffic_next: VehicleState[Air]  # at its end, [K]


def fly(controls: Float[Array, "P 2"], problem: Problem) -> Flight:
    """Fly controls, one for each of :data:`PIECES` of the flight."""
    index = jnp.arange(problem.traffic.x.shape[0] - 1)
    stages = _Step(
        index < problem.steps,
        controls[jnp.minimum(index * PIECES // problem.steps, PIECES - 1)],
        jax.tree.map(lambda field: field[:-1], problem.traffic),
        jax.tree.map(lambda field: field[1:], problem.traffic),
    )
    last, (lengths, apart) = jax.lax.scan(partial(_step, problem), problem.own, stages)
    to_goal = distance(problem.goal[0] - last.x, problem.goal[1] - last.y, jnp)
    return Flight(jnp.sum(lengths), to_goal, apart)


def _step(
    problem: Problem, own: VehicleState[Air], step: _Step
) -> tuple[VehicleState[Air], tuple[Float[Array, ""], Float[Array, ""]]]:
    """Return the state after a step, its length and the smallest separation in it."""
    acceleration, yaw_rate = commands((step.control[0], step.control[1]), SURROGATE, jnp)
    moved = advance(own, acceleration, yaw_rate, RULES.dt, SURROGATE, jnp)
    apart = leg_separation(own, moved, step.traffic, step.traffic_next, RULES.dt, jnp)
    nearest = jnp.min(jnp.where(problem.mask, apart, 1e6))
    length = jnp.where(step.flying, 0.5 * RULES.dt * (own.speed + moved.speed), 0.0)
    after = jax.tree.map(lambda new, old: jnp.where(step.flying, new, old), moved, own)
    return after, (length, jnp.where(step.flying, nearest, 1e6))


def _objective_and_constraints(flat: Float[Array, " C"], problem: Problem) -> Float[Array, " D"]:
    """Return the length and what the constraints keep positive, in km."""
    flight = fly(flat.reshape(-1, 2), problem)
    blocks = jnp.min(flight.separation.reshape(-1, BLOCK), axis=-1)
    nearest = jnp.minimum(blocks, 3.0 * RULES.separation)
    slack = jnp.append(nearest - RULES.separation, RULES.goal_radius - flight.to_goal) - GUARD
    return jnp.concatenate([flight.length[None], slack]) * 1e-3


_VALUES = jax.jit(_objective_and_constraints)
_SLOPES = jax.jit(jax.jacfwd(_objective_and_constraints))
_FLY = jax.jit(fly)


def optimise(guess: np.ndarray, problem: Problem, iterations: int) -> float:
    """Return the length, m, of the best flight from a guess ``[PIECES, 2]``; inf if it breaks a
    rule.
    """
    cache: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = flat.tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = np.asarray(_VALUES(flat, problem)), np.asarray(_SLOPES(flat, problem))
        return cache[key]

    result = minimize(
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
    flight = _FLY(np.clip(result.x, -1, 1).reshape(-1, 2), problem)
    keeps_rules = (
        flight.separation.min() >= RULES.separation and flight.to_goal <= RULES.goal_radius
    )
    return float(flight.length) if keeps_rules else np.inf


def crude_controls(encounter: Encounter, aside: float, speed: float) -> np.ndarray:
    """Return controls ``[T, 2]`` of a flight that aims ``aside`` rad beside the goal until the
    closest approach, and goes to a speed, m/s.
    """
    own, controls = encounter.own, []
    batch = VehicleState(*(field[None] for field in own))
    until = float(
        straight_cpa(batch, VehicleState(*(field[:1] for field in encounter.intruders)), np).time[0]
    )
    for index in range(steps(RULES)):
        if distance(encounter.goal_x - own.x, encounter.goal_y - own.y, np) <= RULES.goal_radius:
            break
        turn = bearing(own, encounter.goal_x, encounter.goal_y, np)
        if index < until:
            turn += aside
        demand = [2.0 * (speed - own.speed), wrap(turn, np) / SURROGATE.yaw_rate_max]
        action = np.clip(demand, -1.0, 1.0)
        acceleration, yaw_rate = commands((action[0], action[1]), SURROGATE, np)
        own = advance(own, acceleration, yaw_rate, RULES.dt, SURROGATE, np)
        controls.append(action)
    return np.array(controls)


def pieces(controls: np.ndarray) -> np.ndarray:
    """Return the means of controls ``[T, 2]`` over the pieces, ``[PIECES, 2]``."""
    number = np.minimum(np.arange(len(controls)) * PIECES // len(controls), PIECES - 1)
    return np.stack(
        [
            np.mean(controls[number == i], axis=0) if (number == i).any() else controls[0]
            for i in range(PIECES)
        ]
    )


def witness_controls(encounter: Encounter, witnesses: Escapes, number: int) -> np.ndarray:
    """Return the controls ``[T, 2]`` of a witness."""
    own = replay(encounter, take(witnesses.manoeuvre, number), RULES, SURROGATE).own
    turn = wrap(np.diff(own.heading), np) / (SURROGATE.yaw_rate_max * RULES.dt)
    return np.stack([np.diff(own.speed) / (SURROGATE.acceleration_max * RULES.dt), turn], axis=-1)


def conflicts(count: int, seed: int) -> Encounter:
    """Return circle encounters whose straight courses pass within the separation, ``[count]``."""
    return encounters_of_seed(
        scenario("circle", PAPER, conflicts_closer_than=RULES.separation), seed, 0, count
    )


def compare(encounter: Encounter, witnesses: Escapes, number: int, iterations: int) -> float:
    """Return the shortest length that the optimiser finds for one encounter, m."""
    traffic = tracks(encounter, steps(RULES), RULES)
    goal = np.array([encounter.goal_x, encounter.goal_y])
    problem = partial(Problem, encounter.own, goal, traffic, encounter.mask)
    guesses = [witness_controls(encounter, witnesses, number)]
    guesses += [crude_controls(encounter, aside, speed) for aside, speed in _GUESSES]
    return min(
        optimise(pieces(controls), problem(np.asarray(len(controls))), iterations)
        for controls in guesses
    )


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    add = parser.add_argument
    help_text = "circle encounters in conflict (default 60)"
    add("--encounters", type=whole(1), default=60, help=help_text)
    add("--seed", type=whole(0), default=0, help="seed of the encounters (default 0)")
    add(
        "--iterations",
        type=whole(1),
        default=40,
        help="iterations of each optimisation (default 40)",
    )
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    encounters = conflicts(options.encounters, options.seed)
    witnesses = least_cost(encounters, RULES, SURROGATE)
    solved = np.flatnonzero(~np.isnan(witnesses.path))
    free = np.array(
        [compare(take(encounters, i), witnesses, int(i), options.iterations) for i in solved]
    )
    own = encounters.own
    to_goal = distance(encounters.goal_x - own.x, encounters.goal_y - own.y, np)
    straight = to_goal[solved] - RULES.goal_radius
    path = witnesses.path[solved]
    best = np.minimum(free, path)
    figures = {
        "encounters": options.encounters,
        "witnesses": solved.size,
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
