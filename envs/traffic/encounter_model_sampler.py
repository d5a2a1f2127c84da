"""Tracks of one aircraft drawn from an encounter model: bins from its networks, values inside the
bins, then motion.

As the models are meant to be read: variables are drawn in the order of the network; a value is
uniform inside its bin, but exactly 0 in the bin that 0 lies inside of; each second the transition
network draws the bins anew, and a value changes where its bin does or, with the chance of
``resample_rates``, inside its bin. A configuration of parents that was never seen has counts of 0
alone: all bins are then equally likely at first, and later on the bin stays.

Airspeed is taken for ground speed (no wind) and for its horizontal part. The speed stays
inside the edges of the model's own bins and below the traffic's greatest, where it is held. A model
without airspeed stands still.
"""

import math
from graphlib import TopologicalSorter
from typing import NamedTuple

import numpy as np

from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance
from envs.traffic.encounter_model import ACCELERATION, CLIMB, SPEED, TURN, EncounterModel, Variable
from envs.traffic.track_units import FOOT, KNOT

_SI = {SPEED: KNOT, ACCELERATION: KNOT, CLIMB: FOOT / 60.0, TURN: -math.radians(1.0)}
"""SI value of one unit; turns are clockwise in the model and counter-clockwise here."""


class Sampled(NamedTuple):
    """What was drawn for M aircraft; SI units."""

    bins: np.ndarray  # of the initial variables, [M, V]
    speed: np.ndarray  # at first, m/s, [M]
    acceleration: np.ndarray  # during each second, m/s^2, [M, T]
    turn_rate: np.ndarray  # rad/s, positive to the left, [M, T]
    climb: np.ndarray  # m/s, [M, T]; 0 where the model has none


def dimensions(model: EncounterModel, seconds: int) -> int:
    """Return the unit-uniform draws that one track takes."""
    return 2 * len(model.initial) + 3 * len(model.moving) * (seconds - 1)


def sample_model(model: EncounterModel, draws: np.ndarray, seconds: int) -> Sampled:
    """Return what unit-uniform draws ``[M, D]`` make of a model, D = :func:`dimensions`."""
    size = len(model.initial)
    bins = _initial(model, draws[:, :size])
    values = _initial_values(model, bins, draws[:, size : 2 * size])
    later = draws[:, 2 * size :].reshape(len(draws), seconds - 1, 3, len(model.moving))
    tables = [_table(variable) for variable in model.transition]
    order = _order(model.transition, size)
    current, rows = _Second(bins, values), [values]
    for second in range(seconds - 1):
        current = _next(model, tables, order, current, later[:, second])
        rows.append(current.values)
    series = np.stack(rows, axis=1)
    return Sampled(
        bins,
        speed=_column(model, series, SPEED)[:, 0],
        acceleration=_column(model, series, ACCELERATION),
        turn_rate=_column(model, series, TURN),
        climb=_column(model, series, CLIMB),
    )


class _Second(NamedTuple):
    """The initial network's variables at a time, ``[M, V]``."""

    bins: np.ndarray
    values: np.ndarray  # in the model's units


def _next(
    model: EncounterModel,
    tables: list[np.ndarray],
    order: list[int],
    current: _Second,
    draws: np.ndarray,
) -> _Second:
    """Return the variables a second later.

    Args:
        tables: cumulative chances of each variable of the transition network.
        order: those variables, parents first.
        draws: ``[M, 3, moving]``: of the bin, of whether the value is drawn anew, and of the value.
    """
    size = len(model.initial)
    bins, values = current.bins.copy(), current.values.copy()
    # The variables at t, and after them those at t + 1.
    bins_of_both = np.concatenate(
        [current.bins, np.zeros((len(bins), len(model.moving)), int)], axis=1
    )
    for k in order:
        variable, place = model.transition[k], model.moving[k]
        chance, again, inside = draws[:, :, k].T
        configuration = _configuration(model, variable, bins_of_both)
        drawn = _draw(tables[k][configuration], chance)
        observed = np.any(variable.counts[configuration], axis=1)
        bins_of_both[:, size + k] = drawn = np.where(observed, drawn, current.bins[:, place])
        redrawn = (drawn != current.bins[:, place]) | (again < model.rates[place])
        edges = model.boundaries[place]
        assert edges is not None  # the reader refuses it
        values[:, place] = np.where(redrawn, _value(edges, drawn, inside, True), values[:, place])
    bins[:, list(model.moving)] = bins_of_both[:, size:]
    return _Second(bins, values)


def _column(model: EncounterModel, series: np.ndarray, name: str) -> np.ndarray:
    """Return a variable's values in SI units, ``[M, T]``, from those of all, ``[M, T, V]``; 0 where
    the model has none of that name.
    """
    names = [variable.name for variable in model.initial]
    if name not in names:
        return np.zeros(series.shape[:2])
    return series[:, :, names.index(name)] * _SI[name]


def fly_tracks(model: EncounterModel, sampled: Sampled, speed_max: float) -> VehicleState[Air]:
    """Fly what was drawn, from the origin and eastward; fields ``[M, T + 1]``.

    Each second's acceleration and turn rate are flown exactly. A first speed beyond the limits
    stays until it is commanded inwards.
    """
    edges = _edges_of_speed(model)
    slowest, fastest = edges[0] * KNOT, min(edges[-1] * KNOT, speed_max)
    limits = Limits(slowest, fastest, -math.inf, math.inf, math.inf)
    zero = np.zeros(len(sampled.speed))
    states = [VehicleState(zero, zero, zero, sampled.speed)]
    for acceleration, turn_rate in zip(sampled.acceleration.T, sampled.turn_rate.T, strict=True):
        states.append(advance(states[-1], acceleration, turn_rate, 1.0, limits, np))
    return VehicleState(*(np.stack(field, axis=-1) for field in zip(*states, strict=True)))


def _edges_of_speed(model: EncounterModel) -> np.ndarray:
    """Return the edges of the bins of airspeed, kt; 0 of a model that has none."""
    names = [variable.name for variable in model.initial]
    edges = model.boundaries[names.index(SPEED)] if SPEED in names else np.zeros(2)
    assert edges is not None  # the reader refuses it
    return edges


def _initial(model: EncounterModel, draws: np.ndarray) -> np.ndarray:
    """Return the bins of the initial variables, ``[M, V]``."""
    bins = np.zeros(draws.shape, int)
    for place in _order(model.initial):
        variable = model.initial[place]
        bins[:, place] = _draw(
            _table(variable)[_configuration(model, variable, bins)], draws[:, place]
        )
    return bins


def _initial_values(model: EncounterModel, bins: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Return values inside the bins of the initial variables, ``[M, V]``; 0 of a category."""
    values = np.zeros(draws.shape)
    for place, edges in enumerate(model.boundaries):
        if edges is not None:
            moving = place in model.moving
            values[:, place] = _value(edges, bins[:, place], draws[:, place], moving)
    return values


def _order(variables: tuple[Variable, ...], before: int = 0) -> list[int]:
    """Return the variables so that parents come first; those below ``before`` are known already."""
    parents = {before + i: variable.parents for i, variable in enumerate(variables)}
    return [i - before for i in TopologicalSorter(parents).static_order() if i >= before]


def _table(variable: Variable) -> np.ndarray:
    """Return the cumulative chances of the bins, ``[C, bins]``; equal ones where nothing
    was seen.
    """
    counts = np.where(variable.counts.any(axis=1, keepdims=True), variable.counts, 1.0)
    return np.cumsum(counts, axis=1) / counts.sum(axis=1, keepdims=True)


def _configuration(model: EncounterModel, variable: Variable, bins: np.ndarray) -> np.ndarray:
    """Return the number of the parents' configuration, the first parent fastest, ``[M]``."""
    sizes = [*(node.bins for node in model.initial), *(node.bins for node in model.transition)]
    number, stride = np.zeros(len(bins), int), 1
    for parent in variable.parents:
        number += stride * bins[:, parent]
        stride *= sizes[parent]
    return number


def _draw(chances: np.ndarray, draw: np.ndarray) -> np.ndarray:
    """Return the bins that draws ``[M]`` choose by cumulative chances ``[M, bins]``."""
    # The last chance may be 1 less a rounding.
    return np.minimum((draw[:, None] >= chances).sum(axis=-1), chances.shape[-1] - 1)


def _value(edges: np.ndarray, bins: np.ndarray, draw: np.ndarray, moving: bool) -> np.ndarray:
    """Return values uniform inside bins ``[M]``; of what moves the bin around 0 means 0."""
    low, high = edges[bins], edges[bins + 1]
    value = low + (high - low) * draw
    return np.where((low < 0.0) & (high > 0.0), 0.0, value) if moving else value
