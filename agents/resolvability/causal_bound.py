"""The causal bound: what an oracle achieves that sees the present exactly and knows nothing of the
future.

At every time step it sees all states and the turn of the step before. It simulates escapes against
several futures of the intruders and follows the one that keeps most distance in them. What it
solves, a resolver without foresight can solve: a lower bound of what such resolvers can achieve, as
the clairvoyant search's is an upper one.
"""

from typing import NamedTuple

import numpy as np

from agents.manoeuvres.escape_manoeuvre import (
    REGARDLESS,
    Flight,
    Manoeuvre,
    count_in,
    fly_step,
    steps,
    takeoff,
    tracks,
)
from agents.manoeuvres.escape_search import (
    COARSE,
    STAGES,
    concatenate,
    fly_out,
    parts,
    scale,
    search,
    to_double,
)
from envs.angles import wrap
from envs.arrays import Array
from envs.encounters import Encounter
from envs.frames import Air
from envs.intruder import IntruderState, start, step
from envs.kinematics import Limits, VehicleState
from envs.outcome import Outcome, Rules, judge
from envs.starts import join
from envs.trees import scatter, take

ENOUGH = 1.5
"""A distance, in separations, beyond which more is not worth a detour."""

_EVERY = 10  # time steps between searches for a better plan while the intruders fly as expected
_DEAR = 0.001  # separations that a time step of flight must be worth

_WEIGHTS, _STEEP = (0.5, 0.25, 0.25), 4.0
"""Of the futures, the straight courses first; what a metre below the separation costs more than one
above it.
"""

_STRIDE = 2.0  # time step of simulated escapes, in time steps of the task
_LOST = -10.0  # worth of a plan, in separations, below which it fails
_TURN = 0.5 * np.pi  # heading change of an intruder that begins to turn now or goes on, rad

_FAMILY = concatenate(STAGES[0], COARSE)


class Causal(NamedTuple):
    """Flights of the oracle; fields ``[N]``."""

    outcome: Array  # code, the place of the one that is true in Outcome, int8
    separation: Array  # smallest distance to any intruder, m, as of an EscapeStep
    arrival: Array  # time at which the goal was reached, s; nan if it was not
    path: Array  # length flown until the end, m
    own: VehicleState[Air]  # the ownship's flight, [T + 1, N], a state a step; nan after the end

    @property
    def solved(self) -> Array:
        """Whether the goal was reached without a loss of separation, bool ``[N]``."""
        return self.outcome == Outcome._fields.index("reached")


class _Air(NamedTuple):
    """Encounters under way; fields ``[M]``, those of intruders ``[M, K]``."""

    number: Array  # of the encounter
    encounter: Encounter  # whose intents the oracle does not see
    own: VehicleState[Air]  # now
    intruders: IntruderState  # now
    rate: Array  # at which they turned in the step before, rad/s
    plan: Manoeuvre  # that is followed


def causal(encounters: Encounter, rules: Rules, limits: Limits) -> Causal:
    """Let the oracle fly encounters ``[N]`` (numpy); raise ValueError where they have no leading
    axis.
    """
    chosen, count = to_double(encounters), np.size(encounters.goal_x)
    inf, nan = np.full(count, np.inf), np.full(count, np.nan)
    record: VehicleState[Air] = VehicleState(
        *np.full((len(VehicleState._fields), steps(rules) + 1, count), np.nan)
    )
    result = Causal(np.full(count, 2, np.int8), inf, nan, np.zeros(count), record)
    for part in parts(np.arange(count), 1, chosen):
        _fly(take(chosen, part), part, rules, limits, result)
    return result


def _fly(encounter: Encounter, part: Array, rules: Rules, limits: Limits, result: Causal) -> None:
    """Fly a part of the encounters to their ends and write them into the result."""
    nothing = Manoeuvre(*np.zeros((len(Manoeuvre._fields), part.size)))
    air = _Air(
        number=part,
        encounter=encounter,
        own=encounter.own,
        intruders=start(encounter.intruders, np),
        rate=0.0 * encounter.intruders.x,
        plan=nothing,
    )
    scatter(result.own, (0, part), air.own)
    for index in range(steps(rules)):
        elapsed = index * rules.dt
        remaining_rules = rules._replace(t_max=rules.t_max - elapsed)
        air = air._replace(plan=_plan(air, index, remaining_rules, limits))
        goal, before = (air.encounter.goal_x, air.encounter.goal_y), air.intruders.vehicle
        counting = count_in(air.encounter, rules)
        traffic = step(air.intruders, air.encounter.intent, elapsed, rules.dt, np)
        ends = before, traffic.vehicle
        begun = takeoff(air.own, air.plan)
        flown = fly_step(begun, air.plan, 0.0, goal, ends, counting, remaining_rules, limits)
        flight = flown.flight
        ended = judge(flown.separation, flown.to_goal, elapsed + rules.dt, rules, np)
        nearest = result.separation[air.number]
        result.separation[air.number] = np.minimum(nearest, flown.separation)
        result.path[air.number] += (0.5 * rules.dt) * (air.own.speed + flight.own.speed)
        result.outcome[air.number[ended.violation]] = 0
        result.outcome[air.number[ended.reached]] = 1
        result.arrival[air.number[ended.reached]] = elapsed + rules.dt
        rate = wrap(traffic.vehicle.heading - before.heading, np) / rules.dt
        plan = _after_first_step(air.plan, flight, rules.dt)
        air = air._replace(own=flight.own, intruders=traffic, rate=rate, plan=plan)
        scatter(result.own, (index + 1, air.number), air.own)
        air = take(air, ~ended.ended(np))
        if air.number.size == 0:
            break


def _plan(air: _Air, index: int, rules: Rules, limits: Limits) -> Manoeuvre:
    """Return the plans to follow from now on: the old ones, unless these fail and better ones are
    found.
    """
    plan = np.stack(air.plan)
    surprised = np.any((np.abs(air.rate) > 1e-6) & air.encounter.mask, axis=-1)
    rows = np.flatnonzero(surprised | (index % _EVERY == 0))
    coarse = rules._replace(dt=_STRIDE * rules.dt)

    enough = ENOUGH * rules.separation - _DEAR * rules.separation / rules.dt * rules.t_max
    if index > 0 and rows.size:
        worth = _value(_futures_of(air, rows, limits), plan[:, rows, None], coarse, limits)
        rows = rows[worth[:, 0] < enough]
    family = np.stack(scale(_FAMILY, rules))
    for part in parts(rows, 3 * family.shape[-1], air.encounter):
        tried = np.broadcast_to(family[:, None], (family.shape[0], part.size, family.shape[-1]))
        # The old plan comes first, so that it is kept where nothing is better.
        tried = tried if index == 0 else np.concatenate([plan[:, part, None], tried], axis=-1)
        worth = _value(_futures_of(air, part, limits), tried, coarse, limits)
        best = np.argmax(worth, axis=-1)
        plan[:, part] = np.take_along_axis(tried, best[None, :, None], axis=-1)[:, :, 0]
        # Where no plan keeps clear of the straight courses, a thorough search may find one that
        # just does.
        lost = part[np.max(worth, axis=-1) < _LOST * rules.separation]
        if lost.size:
            escapes = search(_futures_of(air, lost, limits)[0], rules, limits)
            works = ~np.isnan(escapes.arrival)
            plan[:, lost[works]] = np.stack(escapes.manoeuvre)[:, works]
    return Manoeuvre(*plan)


def _futures_of(air: _Air, rows: Array, limits: Limits) -> list[Encounter]:
    """Return how the encounters in the air numbered ``rows`` may go on."""
    own, intruders = take((air.own, air.intruders.vehicle), rows)
    present = take(air.encounter, rows)._replace(own=own, intruders=intruders)
    return _futures(present, air.rate[rows], limits.yaw_rate_max)


def _futures(present: Encounter, rate: Array, most: float) -> list[Encounter]:
    """Return how encounters ``[M]`` may go on: straight courses, then turns as seen, else at the
    rate ``most``.
    """
    turning = np.abs(rate) > 1e-6
    zero = np.zeros_like(rate)

    def with_turn(change: Array, turn_rate: Array) -> Encounter:
        intent = present.intent._replace(
            onset=zero, heading_change=zero + change, turn_rate=zero + turn_rate
        )
        return present._replace(intent=intent)

    side, fast = np.sign(rate), np.where(turning, np.abs(rate), most)
    first_way = with_turn(np.where(turning, side * _TURN, _TURN), fast)
    second_way = with_turn(np.where(turning, side * 0.5 * _TURN, -_TURN), fast)
    return [with_turn(0.0, most), first_way, second_way]


def _value(futures: list[Encounter], tried: Array, rules: Rules, limits: Limits) -> Array:
    """Return what plans ``[8, M, C]`` are worth in the futures: mean distances less a little for
    the time, m.
    """
    shape = (len(futures), *tried.shape[1:])
    together = futures[0]
    for future in futures[1:]:
        together = join(together, future)
    owner = np.repeat(np.arange(shape[0] * shape[1]), shape[2])
    family = Manoeuvre(*(np.tile(np.ascontiguousarray(field).ravel(), shape[0]) for field in tried))
    flown = fly_out(
        together, tracks(together, steps(rules), rules), owner, family, rules, limits, scoring=True
    )
    arrival, separation = (field.reshape(shape) for field in flown[:2])
    weights = np.array(_WEIGHTS)[:, None, None]
    unit, enough = rules.separation, ENOUGH * rules.separation
    dear = _DEAR * unit * _STRIDE / rules.dt  # the plans are flown in strides
    missing = np.minimum(separation - rules.separation, 0.0)
    worth = np.minimum(separation, enough) + _STEEP * missing
    value = np.sum(weights * worth, axis=0) - dear * arrival[0]
    lost = _LOST * unit
    failed = np.minimum(separation[0], enough) + 2.0 * lost + lost * np.isnan(arrival[0])
    # A plan that does not keep the separation on the straight courses, or does not arrive, comes
    # after all that do.
    return np.where((separation[0] < rules.separation) | np.isnan(arrival[0]), failed, value)


def _after_first_step(plan: Manoeuvre, flight: Flight, dt: float) -> Manoeuvre:
    """Return what is left of plans after their first step."""
    switched = flight.switched
    return plan._replace(
        turn=flight.to_turn,
        throttle=np.where(switched, plan.throttle_after, plan.throttle),
        switch=np.maximum(plan.switch - dt, 0.0),
        turn_after=np.where(switched, 0.0, plan.turn_after),
        resume=np.where(flight.returning, 0.0, np.maximum(plan.resume - dt, 0.0)),
        slack=np.where(flight.returning, REGARDLESS, plan.slack),
    )
