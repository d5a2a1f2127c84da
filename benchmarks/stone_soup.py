"""Interacting-multiple-model filters made of Stone Soup's parts, as a peer of our tracker.

`Stone Soup <https://stonesoup.readthedocs.io>`_ is the tracking library of the ISIF's working group
on open source. It has motion models, predictors, updaters and the reduction of mixtures, but no
filter of interacting models: those lines are here (Bar-Shalom, Li and Kirubarajan 2001, section
11.6.6). States are ``x, vx, y, vy`` and, of a turn at an unknown rate, the rate. Needs Stone Soup,
of the extra ``peers``.
"""

import importlib
import importlib.util
import math
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from commands.command import InputError
from envs.tracking.tracker import FIRST, ONSET, STRAIGHT_LASTS, TURN_LASTS, TURNING, WANDER

INSTALL = "pip install -c constraints/peers.txt stonesoup"
"""How to get Stone Soup."""

KNOWN_RATES = tuple(math.radians(rate) for rate in (-3.0, -1.5, 1.5, 3.0))
"""Turn rates, rad/s, of the filter whose turns have known ones."""

_RATE_NOISE = 1e-5  # rad^2/s^3, white: 0.8 deg/s within 20 s
_BEGAN = datetime(2000, 1, 1)


class Model(NamedTuple):
    """One motion: its predictor and its updater; whether it is a turn."""

    predictor: Any
    updater: Any
    turns: bool


class Filter(NamedTuple):
    """Interacting models of one kind of state."""

    models: Sequence[Model]
    position_std: float  # of the reports, one sigma per axis, m
    velocity_std: float  # m/s
    rate: bool  # whether the turn rate is part of the state


class Known(NamedTuple):
    """What a filter knows of one aircraft."""

    states: Sequence[Any]  # a GaussianState a model
    shares: np.ndarray  # probabilities of the models, [M]
    time: float  # s


class Answer(NamedTuple):
    """What a filter says of one aircraft."""

    mean: np.ndarray  # x, vx, y, vy
    covariance: np.ndarray  # [4, 4]
    turns: float  # probability of a turn


def installed() -> bool:
    """Return whether Stone Soup is installed."""
    return importlib.util.find_spec("stonesoup") is not None


def require() -> None:
    """Raise an InputError where Stone Soup is not installed."""
    if not installed():
        raise InputError(f"--peer: Stone Soup is not installed; to have it: {INSTALL}")


def filter_of_known_rates(position_std: float, velocity_std: float) -> Filter:
    """Return Kalman filters of constant velocity and of turns at :data:`KNOWN_RATES`."""
    linear, kalman = _part("models.transition.linear"), _part("predictor.kalman")
    turns = [
        linear.KnownTurnRate(turn_noise_diff_coeffs=[WANDER, WANDER], turn_rate=rate)
        for rate in KNOWN_RATES
    ]
    updater = _updater(4, position_std, velocity_std)
    models = [
        Model(kalman.KalmanPredictor(motion), updater, number > 0)
        for number, motion in enumerate([_straight(linear), *turns])
    ]
    return Filter(models, position_std, velocity_std, rate=False)


def filter_of_unknown_rate(position_std: float, velocity_std: float) -> Filter:
    """Return a Kalman filter of constant velocity, and an unscented one of a turn at a nearly
    constant rate.
    """
    linear, kalman = _part("models.transition.linear"), _part("predictor.kalman")
    motion = _part("models.transition.nonlinear").ConstantTurn(
        linear_noise_coeffs=np.array([WANDER, WANDER]), turn_noise_coeff=_RATE_NOISE
    )
    straight = _straight(linear, [linear.RandomWalk(0.0)])
    updater = _updater(5, position_std, velocity_std)
    models = [
        Model(kalman.KalmanPredictor(straight), updater, turns=False),
        Model(kalman.UnscentedKalmanPredictor(motion), updater, turns=True),
    ]
    return Filter(models, position_std, velocity_std, rate=True)


def begin(filter_: Filter, report: np.ndarray, time: float) -> Known:
    """Return what a filter knows after one report ``x, vx, y, vy``, at a time, s."""
    position, speed = filter_.position_std**2, filter_.velocity_std**2
    mean, variance = [*report], [position, speed, position, speed]
    if filter_.rate:
        mean, variance = [*mean, 0.0], [*variance, _onset(report) ** 2]
    state = _gaussian(np.array(mean)[:, None], np.diag(variance), time)
    turns = np.array([model.turns for model in filter_.models], float)
    shares = np.where(turns > 0.0, FIRST / turns.sum(), 1.0 - FIRST)
    return Known([state] * len(filter_.models), shares, time)


def extend(filter_: Filter, belief: Known, report: np.ndarray, time: float) -> Known:
    """Return what a filter knows with a later report."""
    chances = _chances(filter_, time - belief.time)
    expected = belief.shares @ chances
    detection = _part("types.detection").Detection(report[:, None], timestamp=_at(time))
    states, densities = [], []
    for number, model in enumerate(filter_.models):
        mixed = _mix(filter_, belief, belief.shares * chances[:, number] / expected[number], number)
        prediction = model.predictor.predict(mixed, timestamp=_at(time))
        measured = model.updater.predict_measurement(prediction)
        hypothesis = _part("types.hypothesis").SingleHypothesis(prediction, detection, measured)
        states.append(model.updater.update(hypothesis))
        off = np.asarray(report - np.asarray(measured.state_vector, float).ravel())
        covariance = np.asarray(measured.covar, float)
        squared = off @ np.linalg.solve(covariance, off)
        densities.append(-0.5 * (squared + np.linalg.slogdet(covariance)[1]))
    shares = expected * np.exp(np.array(densities) - max(densities))
    return Known(states, shares / shares.sum(), time)


def answer(filter_: Filter, belief: Known) -> Answer:
    """Return what a filter says after its newest report."""
    mean, covariance = _reduce(belief.states, belief.shares)
    turns = [model.turns for model in filter_.models]
    return Answer(
        np.asarray(mean, float).ravel()[:4],
        np.asarray(covariance, float)[:4, :4],
        float(belief.shares[turns].sum()),
    )


def _chances(filter_: Filter, seconds: float) -> np.ndarray:
    """Return the chances that one model is followed by another, ``[M, M]``, as our tracker has
    them; a turn becomes one at another rate as often as it ends.
    """
    count = len(filter_.models) - 1
    changes = 1.0 - math.exp(-seconds * (1.0 / STRAIGHT_LASTS + 1.0 / TURN_LASTS))
    begins, ends = changes * TURNING, changes * (1.0 - TURNING)
    chances = np.full((count + 1, count + 1), ends / max(count - 1, 1))
    chances[0, 1:], chances[1:, 0], chances[0, 0] = begins / count, ends, 1.0 - begins
    for number in range(1, count + 1):
        chances[number, number] = 1.0 - (ends if count == 1 else 2.0 * ends)
    return chances


def _mix(filter_: Filter, belief: Known, shares: np.ndarray, number: int) -> Any:
    """Return the state that a model begins a step with."""
    states = list(belief.states)
    if filter_.rate:
        # Straight flight says nothing of the rate of a turn that begins.
        states[0] = _without_rate(states[0])
    mean, covariance = _reduce(states, shares)
    mixed = _gaussian(mean, covariance, belief.time)
    return _without_rate(mixed) if filter_.rate and number == 0 else mixed


def _without_rate(state: Any) -> Any:
    """Return a state whose turn rate is open."""
    mean, covariance = np.array(state.state_vector, float), np.array(state.covar, float)
    covariance[4, :], covariance[:, 4], mean[4] = 0.0, 0.0, 0.0
    covariance[4, 4] = _onset(mean.ravel()) ** 2
    return _part("types.state").GaussianState(mean, covariance, timestamp=state.timestamp)


def _onset(state: np.ndarray) -> float:
    """Return one sigma of the rate that a turn begins with, rad/s."""
    return ONSET / max(math.hypot(state[1], state[3]), 1.0)


def _reduce(states: Sequence[Any], shares: np.ndarray) -> tuple[Any, Any]:
    means = np.hstack([np.asarray(state.state_vector, float) for state in states])
    covariances = np.stack([np.asarray(state.covar, float) for state in states], axis=-1)
    vectors = _part("types.array").StateVectors(means)
    return _part("functions").gm_reduce_single(vectors, covariances, shares)


def _straight(linear: Any, more: Sequence[Any] = ()) -> Any:
    """Return the model of straight flight, with more of the state's parts behind it."""
    parts = [linear.ConstantVelocity(WANDER), linear.ConstantVelocity(WANDER), *more]
    return linear.CombinedLinearGaussianTransitionModel(parts)


def _updater(size: int, position_std: float, velocity_std: float) -> Any:
    """Return the updater by reports of a state of some size."""
    noise = np.diag([position_std**2, velocity_std**2] * 2)
    model = _part("models.measurement.linear").LinearGaussian(size, (0, 1, 2, 3), noise)
    return _part("updater.kalman").KalmanUpdater(model)


def _gaussian(mean: Any, covariance: Any, time: float) -> Any:
    return _part("types.state").GaussianState(mean, covariance, timestamp=_at(time))


def _at(time: float) -> datetime:
    return _BEGAN + timedelta(seconds=time)


def _part(name: str) -> Any:
    return importlib.import_module(f"stonesoup.{name}")
