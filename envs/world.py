"""The world's update, Algorithm 1 of the paper, for every array namespace.

The same functions train (``jax.numpy``, batches), evaluate (``numpy``, batches) and serve one
encounter at a time (:data:`envs.backend.EXACT_FLOATS`). Batches ``[..., K]`` keep their intruders
along the last axis, plain floats keep them in a tuple of K.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from envs import intruder, observation, outcome
from envs.aircraft import Aircraft
from envs.arrays import ArrayModule
from envs.backend import FloatNamespace
from envs.encounters import Encounter
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.observation import SetObservation, beside
from envs.outcome import Outcome, Rules
from envs.perception import Coverage, Sensor, carry_back, perceive, report
from envs.reaction import Reaction, answer
from envs.relative import at_share, distance, leg_separation


class World(NamedTuple):
    """Parameters of the world, all of them data."""

    rules: Rules
    aircraft: Aircraft  # the ownship

    @property
    def limits(self) -> Limits:
        """Of the ownship."""
        return self.aircraft.limits


class State(NamedTuple):
    """Encounters in progress; fields ``[...]``, those of intruders ``[..., K]`` or tuples of K."""

    own: VehicleState
    goal_x: Any
    goal_y: Any
    intruders: Any  # envs.intruder.IntruderState; of plain floats a tuple of them
    mask: Any  # which intruders exist, bool; a tuple of plain floats holds existing ones only
    intent: Any
    sensor: Sensor  # [..., 1] or plain floats
    previous: (
        tuple[Any, Any] | None
    )  # intruders' vehicles one and two steps ago; None where no report is late
    steps: Any  # steps taken since the start
    ended: Any  # whether the last step ended the encounter, bool
    required_separation: Any = None  # by which each encounter is judged, m; None: that of the rules
    coverage: Coverage | None = None  # [..., K]; None: reports of all intruders at any time
    separation: Any = None
    """To be kept from each intruder, m, ``[..., K]``; None: that of the rules, from all. Distances
    to an intruder count in it: twice as near where twice as much must be kept."""
    reaction: Reaction | None = None  # [..., K]; None: no intruder takes notice of the ownship


class StepResult(NamedTuple):
    """Evaluation of a step; fields ``[...]``, distances in m."""

    outcome: Outcome
    reward: Any
    separations: Any
    """Smallest distance to each intruder during the step, m, ``[..., K]``; to one with a separation
    of its own in shares of it, times the aircraft's."""
    separation: Any  # smallest distance to any intruder during the step, m
    goal_distance: Any  # at the end of the step, m


def begin(
    encounter: Encounter,
    xp: ArrayModule,
    *,
    history_dt: Any = None,
    required_separation: Any = None,
) -> State:
    """Return the state at the start of encounters ``[...]``.

    Args:
        history_dt: the time step, s, where reports may be late and need a history of the intruders;
            None: they are not.
        required_separation: by which each encounter is judged instead of the rules', m, ``[...]``.
    """
    previous = None
    if history_dt is not None:
        previous = tuple(
            _each(
                lambda one, ago=ago: carry_back(one, ago * history_dt, xp),
                xp,
                encounter.intruders,
            )
            for ago in (1.0, 2.0)
        )
    steps = xp.zeros_like(encounter.goal_x)
    return State(
        encounter.own,
        encounter.goal_x,
        encounter.goal_y,
        _each(lambda vehicle: intruder.start(vehicle, xp), xp, encounter.intruders),
        encounter.mask,
        encounter.intent,
        encounter.sensor,
        previous,
        steps,
        steps > 0.0,
        required_separation,
        encounter.coverage,
        encounter.separation,
        encounter.reaction,
    )


def step(
    state: State, action: tuple[Any, Any], world: World, xp: ArrayModule
) -> tuple[State, StepResult]:
    """Advance encounters ``[...]`` by one time step under an action of
    :func:`envs.kinematics.commands`.

    (Algorithm 1 of the paper.)
    """
    # Update the intruders: their controllers compute the controls, then the vehicles move.
    intruders = move_intruders(state, world.rules.dt, xp)

    # Update the agent: the action is its control, then the vehicle moves.
    acceleration, yaw_rate = commands(action, world.limits, xp)
    own = advance(state.own, acceleration, yaw_rate, world.rules.dt, world.limits, xp)

    # Evaluate the state: conflict, termination, score.
    return evaluate(state, own, intruders, world.rules, xp, usual=world.aircraft.separation)


def move_intruders(state: State, dt: float, xp: ArrayModule) -> Any:
    """Return the intruders one time step later, ``[..., K]``."""
    time, dt = beside((state.steps * dt, dt))
    if state.reaction is not None:  # arrays alone
        answers = partial(answer, own=beside(state.own), reaction=state.reaction, xp=xp)
        return intruder.step(state.intruders, state.intent, time, dt, xp, answers=answers)
    return _each(
        lambda one, intent: intruder.step(one, intent, time, dt, xp),
        xp,
        state.intruders,
        state.intent,
    )


def evaluate(
    state: State,
    own: VehicleState,
    intruders: Any,
    rules: Rules,
    xp: ArrayModule,
    *,
    usual: Any = None,
) -> tuple[State, StepResult]:
    """Return the state ``[...]`` before a step with the vehicles that it has moved, and the
    evaluation of the step.

    Args:
        usual: the aircraft's separation, m, in which distances count to intruders with one of their
            own; None: that of the rules.
    """
    usual = rules.separation if usual is None else usual
    if state.required_separation is not None:
        rules = rules._replace(separation=state.required_separation)
    before, after, dt = beside((state.own, own, rules.dt))
    separations = _each(
        lambda old, new: leg_separation(before, after, old.vehicle, new.vehicle, dt, xp),
        xp,
        state.intruders,
        intruders,
    )
    if state.separation is not None:
        shares = _shares(state.separation, usual, xp)
        separations = _each(lambda one, share: one * share, xp, separations, shares)
    separation = smallest(separations, state.mask, xp)
    goal_distance = distance(state.goal_x - own.x, state.goal_y - own.y, xp)
    steps = state.steps + 1.0
    judged = outcome.judge(separation, goal_distance, steps * rules.dt, rules, xp)
    previous = (
        None if state.previous is None else (_vehicles(state.intruders, xp), state.previous[0])
    )
    moved = state._replace(
        own=own, intruders=intruders, previous=previous, steps=steps, ended=judged.ended(xp)
    )
    return moved, StepResult(
        judged, outcome.reward(judged, rules, xp), separations, separation, goal_distance
    )


def perceive_intruders(state: State, noise: Any, dt: Any, xp: ArrayModule) -> Any:
    """Return the intruders as the ownship believes them to be, ``[..., K]``.

    Args:
        noise: standard normal draws of the reports, ``[4, ..., K]``, or of plain floats a sequence
            of K times 4; None for perfect knowledge.
        dt: time step, s; reports are at most two of them old.
    """
    now = _vehicles(state.intruders, xp)
    if noise is None:
        return now
    # Where no history is kept no report is late, and earlier states have no weight.
    earlier = (now, now) if state.previous is None else state.previous
    return _each(
        lambda a, b, c, draws: perceive(a, b, c, state.sensor, draws, dt, xp),
        xp,
        now,
        *earlier,
        noise,
    )


def shares(state: State, aircraft: Aircraft, xp: ArrayModule) -> Any:
    """Return how much of its distance each intruder counts at, ``[..., K]``: the aircraft's
    separation over its own; None where they have none of their own.
    """
    if state.separation is None:
        return None
    return _shares(state.separation, aircraft.separation, xp)


def _shares(separation: Any, usual: Any, xp: ArrayModule) -> Any:
    return _each(lambda own: usual / own, xp, separation)


def known(state: State, aircraft: Aircraft, xp: ArrayModule) -> Any:
    """Return of which intruders the ownship knows, bool ``[..., K]``: those that exist and are
    reported.
    """
    if state.coverage is None:
        return state.mask
    own, time = beside((state.own, state.steps * aircraft.dt))
    return state.mask & report(own, _vehicles(state.intruders, xp), state.coverage, time, xp)


def _in_own_separations(state: State, noise: Any, aircraft: Aircraft, xp: ArrayModule) -> Any:
    """Return the intruders as :func:`perceive_intruders` does, ``[..., K]``, each at its distance
    in its own separation, on the same bearing.
    """
    seen, share = perceive_intruders(state, noise, aircraft.dt, xp), shares(state, aircraft, xp)
    return seen if share is None else _each(partial(at_share, beside(state.own)), xp, seen, share)


def observe(state: State, aircraft: Aircraft, noise: Any = None, *, xp: ArrayModule) -> Any:
    """Return the observation of the most critical intruder and the goal, ``[..., 8]``; see
    :func:`perceive_intruders`.
    """
    seen = _in_own_separations(state, noise, aircraft, xp)
    chosen = observation.most_critical(state.own, seen, known(state, aircraft, xp), aircraft, xp)
    return observation.observe(state.own, chosen, state.goal_x, state.goal_y, aircraft, xp)


def observe_set(
    state: State,
    aircraft: Aircraft,
    noise: Any = None,
    count: int | None = None,
    *,
    xp: ArrayModule,
) -> SetObservation:
    """Return the observation of several intruders and the goal, by the noise of
    :func:`perceive_intruders`; arrays only.

    Seen are the ``count`` most critical ones, in their order; None: all K as they come.
    """
    seen, mask = _in_own_separations(state, noise, aircraft, xp), known(state, aircraft, xp)
    if count is not None:
        seen, mask = observation.rank_urgent(state.own, seen, mask, count, aircraft, xp)
    return observation.observe_set(state.own, seen, mask, state.goal_x, state.goal_y, aircraft, xp)


def smallest(values: Any, mask: Any, xp: ArrayModule) -> Any:
    """Return the smallest value of the intruders that exist, ``[...]``."""
    if isinstance(xp, FloatNamespace):
        return min(values)
    return xp.min(xp.where(mask, values, xp.inf), axis=-1)


def _each(function: Callable[..., Any], xp: ArrayModule, *trees: Any) -> Any:
    """Apply a function to arrays ``[..., K]`` at once, and to tuples of K plain ones one after
    another.
    """
    if isinstance(xp, FloatNamespace):
        return tuple(map(function, *trees))
    return function(*trees)


def _vehicles(intruders: Any, xp: ArrayModule) -> Any:
    return _each(lambda one: one.vehicle, xp, intruders)
