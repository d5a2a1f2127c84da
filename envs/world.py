"""The world's update, Algorithm 1 of the paper, for every array namespace.

The same functions train (``jax.numpy``, batches), evaluate (``numpy``, batches) and serve one
encounter at a time (:data:`envs.backend.EXACT_FLOATS`). Batches ``[..., K]`` keep their intruders
along the last axis, plain floats keep them in a tuple of K.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

from envs import intruder, observation, outcome
from envs.aircraft import Aircraft
from envs.altitudes import Altitudes, at_step
from envs.arrays import Array, ArrayModule
from envs.backend import FloatNamespace
from envs.encounters import Encounter, EncounterError
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.observation import SetObservation, Vehicles, beside
from envs.outcome import Outcome, Rules
from envs.perception import Coverage, Sensor, carry_back, perceive, report
from envs.reaction import Reaction, answer
from envs.relative import at_distance_scale, distance, leg_separation, leg_separation_in_space

Intruders: TypeAlias = Any
"""An `IntruderState` of arrays ``[..., K]``, or a tuple of K of floats."""

Intents: TypeAlias = Any
"""An `Intent` of arrays ``[..., K]`` or a `KnownFlight`, or a tuple of K intents of floats."""


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

    own: VehicleState[Air]
    goal_x: Array  # m
    goal_y: Array
    intruders: Intruders
    mask: Array  # which intruders exist, bool; a tuple of plain floats holds existing ones only
    intent: Intents
    sensor: Sensor  # [..., 1] or plain floats
    previous: tuple[Vehicles, Vehicles] | None
    """Intruders' vehicles one and two steps ago; None where no report is late."""
    steps: Array  # steps taken since the start
    ended: Array  # whether the last step ended the encounter, bool
    required_separation: Array | None = None
    """By which each encounter is judged, m; None: that of the rules."""
    coverage: Coverage | None = None  # [..., K]; None: reports of all intruders at any time
    separation: Array | None = None
    """To be kept from each intruder, m, ``[..., K]``; None: that of the rules, from all. Distances
    to an intruder count in it: twice as near where twice as much must be kept."""
    reaction: Reaction | None = None  # [..., K]; None: no intruder takes notice of the ownship
    altitudes: Altitudes | None = None  # numpy; None: all are at one level


class StepResult(NamedTuple):
    """Evaluation of a step; fields ``[...]``, distances in m."""

    outcome: Outcome
    reward: Array
    separations: Array
    """Smallest distance to each intruder during the step, m, ``[..., K]``; to one with a separation
    of its own in shares of it, times the aircraft's. In space the cylindrical distance."""
    separation: Array  # smallest distance to any intruder during the step, m
    goal_distance: Array  # at the end of the step, m


def begin(
    encounter: Encounter,
    xp: ArrayModule,
    *,
    history_dt: Array | None = None,
    required_separation: Array | None = None,
) -> State:
    """Return the state at the start of encounters ``[...]``.

    Args:
        history_dt: the time step, s, where reports may be late and need a history of the intruders;
            None: they are not.
        required_separation: by which each encounter is judged instead of the rules', m, ``[...]``.
    """
    previous = None
    if history_dt is not None:
        previous = (
            _carry_back(encounter.intruders, history_dt, xp),
            _carry_back(encounter.intruders, 2.0 * history_dt, xp),
        )
    steps = xp.zeros_like(encounter.goal_x)
    return State(
        own=encounter.own,
        goal_x=encounter.goal_x,
        goal_y=encounter.goal_y,
        intruders=_map_intruders(partial(intruder.start, xp=xp), xp, encounter.intruders),
        mask=encounter.mask,
        intent=encounter.intent,
        sensor=encounter.sensor,
        previous=previous,
        steps=steps,
        ended=steps > 0.0,
        required_separation=required_separation,
        coverage=encounter.coverage,
        separation=encounter.separation,
        reaction=encounter.reaction,
        altitudes=encounter.altitudes,
    )


def _carry_back(vehicles: Vehicles, seconds: Array, xp: ArrayModule) -> Vehicles:
    """Return where intruders ``[..., K]`` were some seconds ago if they flew straight until now."""
    return _map_intruders(lambda vehicle: carry_back(vehicle, seconds, xp), xp, vehicles)


def step(
    state: State, action: tuple[Array, Array], world: World, xp: ArrayModule
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
    return evaluate(
        state,
        own,
        intruders,
        world.rules,
        xp,
        usual=world.aircraft.separation,
        flatness=flatness_of(state, world.aircraft),
    )


def flatness_of(state: State | Encounter, aircraft: Aircraft) -> Array | None:
    """Return what vertical distances to intruders count as in the plane, ``[..., K]`` or one for
    all: the horizontal separation from each over the aircraft's vertical one; None where all are at
    one level.

    Raises:
        EncounterError: the aircraft states no vertical separation.
    """
    if state.altitudes is None:
        return None
    if aircraft.vertical is None:
        raise EncounterError(
            "encounters with altitudes are for an aircraft that states a vertical separation; "
            "expected one with climb_max_mps and what belongs to it, such as c208"
        )
    separation = aircraft.separation if state.separation is None else state.separation
    return separation / aircraft.vertical.separation


def move_intruders(state: State, dt: float, xp: ArrayModule) -> Intruders:
    """Return the intruders one time step of ``dt`` s later, ``[..., K]``."""
    time, dt = beside((state.steps * dt, dt))
    if state.reaction is not None:  # arrays alone
        answers = partial(answer, own=beside(state.own), reaction=state.reaction, xp=xp)
        return intruder.step(state.intruders, state.intent, time, dt, xp, answers=answers)
    return _map_intruders(
        lambda moving, intent: intruder.step(moving, intent, time, dt, xp),
        xp,
        state.intruders,
        state.intent,
    )


def evaluate(
    state: State,
    own: VehicleState[Air],
    intruders: Intruders,
    rules: Rules,
    xp: ArrayModule,
    *,
    usual: Array | None = None,
    flatness: Array | None = None,
) -> tuple[State, StepResult]:
    """Return the state after a step that has moved the vehicles, and the evaluation of the step.

    Args:
        state: before the step, ``[...]``.
        own: the ownship after it, ``[...]``.
        intruders: after it, ``[..., K]``.
        usual: the aircraft's separation, m; the distance to an intruder with a separation of its
            own counts in shares of that one, times the usual one. None: that of the rules.
        flatness: of encounters in space (:func:`flatness_of`), in which the ownship is level;
            numpy.
    """
    usual = rules.separation if usual is None else usual
    if state.required_separation is not None:
        rules = rules._replace(separation=state.required_separation)
    begin, end, dt = beside((state.own, own, rules.dt))
    if flatness is None:
        separations = _map_intruders(
            lambda old, new: leg_separation(begin, end, old.vehicle, new.vehicle, dt, xp),
            xp,
            state.intruders,
            intruders,
        )
    else:
        vehicles = state.intruders.vehicle, intruders.vehicle
        above = above_own(state, 0.0), above_own(state, 1.0)
        separations = leg_separation_in_space((begin, end), vehicles, above, flatness, dt)
    if state.separation is not None:
        distance_scale = _distance_scales(state.separation, usual, xp)
        separations = _map_intruders(
            lambda apart, times: apart * times, xp, separations, distance_scale
        )
    separation = smallest(separations, state.mask, xp)
    goal_distance = distance(state.goal_x - own.x, state.goal_y - own.y, xp)
    steps = state.steps + 1.0
    flight_outcome = outcome.judge(separation, goal_distance, steps * rules.dt, rules, xp)
    reward = outcome.reward(flight_outcome, rules, xp)
    result = StepResult(flight_outcome, reward, separations, separation, goal_distance)

    previous = None
    if state.previous is not None:
        previous = _vehicles(state.intruders, xp), state.previous[0]
    next_state = state._replace(
        own=own, intruders=intruders, previous=previous, steps=steps, ended=flight_outcome.ended(xp)
    )
    return next_state, result


def above_own(state: State, later: float, own: Array | None = None) -> Array:
    """Return how far intruders are above the ownship some time steps later, m, ``[..., K]``, of
    encounters in space; the altitude of the ownship then is ``[...]``, None: as at the start.
    """
    assert state.altitudes is not None
    intruders = at_step(state.altitudes.intruders, (state.steps + later)[..., None])
    return intruders - (state.altitudes.own if own is None else own)[..., None]


def perceive_intruders(state: State, noise: Array | None, dt: Array, xp: ArrayModule) -> Vehicles:
    """Return the intruders as the ownship believes them to be, ``[..., K]``.

    Args:
        noise: standard normal draws of the reports, ``[4, ..., K]``, or of plain floats a sequence
            of K times 4; None for perfect knowledge.
        dt: time step, s; reports are at most two of them old.
    """
    vehicles = _vehicles(state.intruders, xp)
    if noise is None:
        return vehicles
    # Where no history is kept no report is late, and earlier states have no weight.
    earlier = (vehicles, vehicles) if state.previous is None else state.previous
    return _map_intruders(
        lambda a, b, c, draws: perceive(a, b, c, state.sensor, draws, dt, xp),
        xp,
        vehicles,
        *earlier,
        noise,
    )


def distance_scales(state: State | Encounter, aircraft: Aircraft, xp: ArrayModule) -> Array | None:
    """Return at which part of its distance each intruder of encounters, in progress or at their
    start, counts, ``[..., K]``: the aircraft's separation divided by the intruder's own; None where
    they have none of their own.
    """
    if state.separation is None:
        return None
    return _distance_scales(state.separation, aircraft.separation, xp)


def _distance_scales(separation: Array, usual: Array, xp: ArrayModule) -> Array:
    return _map_intruders(lambda own: usual / own, xp, separation)


def known_intruders(state: State, aircraft: Aircraft, xp: ArrayModule) -> Array:
    """Return of which intruders the ownship knows, bool ``[..., K]``: those that exist and are
    reported.
    """
    if state.coverage is None:
        return state.mask
    own, time = beside((state.own, state.steps * aircraft.dt))
    return state.mask & report(own, _vehicles(state.intruders, xp), state.coverage, time, xp)


def _in_own_separations(
    state: State, noise: Array | None, aircraft: Aircraft, xp: ArrayModule
) -> Vehicles:
    """Return the intruders of :func:`perceive_intruders`, ``[..., K]``, each at that part of its
    distance at which it counts, on the same bearing.
    """
    perceived = perceive_intruders(state, noise, aircraft.dt, xp)
    distance_scale = distance_scales(state, aircraft, xp)
    if distance_scale is None:
        return perceived
    return _map_intruders(
        partial(at_distance_scale, beside(state.own)), xp, perceived, distance_scale
    )


def observe(
    state: State, aircraft: Aircraft, noise: Array | None = None, *, xp: ArrayModule
) -> Array:
    """Return the observation of the most critical intruder and the goal, ``[..., 8]``.

    The noise is that of :func:`perceive_intruders`.
    """
    perceived = _in_own_separations(state, noise, aircraft, xp)
    chosen = observation.most_critical(
        state.own, perceived, known_intruders(state, aircraft, xp), aircraft, xp
    )
    return observation.observe(state.own, chosen, state.goal_x, state.goal_y, aircraft, xp)


def observe_set(
    state: State,
    aircraft: Aircraft,
    noise: Array | None = None,
    count: int | None = None,
    *,
    xp: ArrayModule,
) -> SetObservation:
    """Return the observation of several intruders and the goal; arrays only.

    Observed are the ``count`` most critical ones, the most critical first; None: all K as they
    come. The noise is that of :func:`perceive_intruders`.
    """
    perceived = _in_own_separations(state, noise, aircraft, xp)
    mask = known_intruders(state, aircraft, xp)
    if count is not None:
        perceived, mask = observation.rank_urgent(state.own, perceived, mask, count, aircraft, xp)
    return observation.observe_set(
        state.own, perceived, mask, state.goal_x, state.goal_y, aircraft, xp
    )


def smallest(values: Array, mask: Array, xp: ArrayModule) -> Array:
    """Return the smallest of the values ``[..., K]`` of the intruders that exist, ``[...]``."""
    if isinstance(xp, FloatNamespace):
        return min(values)
    return xp.min(xp.where(mask, values, xp.inf), axis=-1)


def _map_intruders(function: Callable[..., Any], xp: ArrayModule, *trees: Any) -> Any:
    """Apply a function to arrays ``[..., K]`` at once, and to tuples of K plain ones one after
    another.
    """
    if isinstance(xp, FloatNamespace):
        return tuple(map(function, *trees))
    return function(*trees)


def _vehicles(intruders: Intruders, xp: ArrayModule) -> Vehicles:
    return _map_intruders(lambda moving: moving.vehicle, xp, intruders)
