"""One aircraft: compiled code believes what Python's floats make of the same reports."""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from envs.backend import FLOATS
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.tracking import single
from envs.tracking.tracker import Belief, Reports, Tracks, begin
from tests.envs.tracking.flights import fly, reported

pytestmark = pytest.mark.usefixtures("compiled_code")

TURN = [0.0] * 20 + [math.radians(3.0)] * 20 + [0.0] * 20
FLIGHTS = 12


def flights(errors: tuple[float, float]) -> list[list[VehicleState[Ground]]]:
    """Return what is reported of flights; all jump, some have speeds in knots or stand still."""
    rng, kind, rows = np.random.default_rng(2), np.arange(FLIGHTS) % 3, []
    states = fly(TURN, rows=FLIGHTS)
    for second, state in enumerate(states):
        report = reported(state, rng, *errors)
        x = np.where(kind == 2, states[0].x + second % 2, report.x)
        y = np.where(kind == 2, states[0].y, report.y)
        speed = np.where(kind == 1, 1.944, 1.0) * report.speed
        rows.append(np.stack([x + 3_000.0 * (second > 45), y, report.heading, speed]))
    return [[VehicleState(*row[:, number].tolist()) for row in rows] for number in range(FLIGHTS)]


def numbers(tree: tuple[object, ...]) -> Iterator[object]:
    """Yield all numbers of nested tuples."""
    for branch in tree:
        if isinstance(branch, tuple):
            yield from numbers(branch)
        else:
            yield branch


@pytest.mark.parametrize("declared", [(0.0, 0.0), (10.0, 1.0), (30.0, 3.0)])
@pytest.mark.parametrize("errors", [(0.0, 0.0), (30.0, 3.0)])
@pytest.mark.parametrize("declares", [True, False])
def test_compiled_code_believes_what_python_does(
    errors: tuple[float, float], declared: tuple[float, float], declares: bool
) -> None:
    assert single.FOLLOW.ready
    jumps = doubts = 0
    for states in flights(errors):
        start = states[0]._replace(x=0.0, y=0.0)
        tracks: Tracks[Ground] = begin(Reports(start, *declared, declares), FLOATS)
        for before, state in pairwise(states):
            shifted = state._replace(x=state.x - before.x, y=state.y - before.y)
            reports = Reports(shifted, *declared, declares)
            expected = single.FOLLOW.function(tracks, reports, 1.0)
            followed = single.follow(tracks, reports, 1.0)
            assert isinstance(followed[0], Tracks) and isinstance(followed[1], Belief)
            np.testing.assert_allclose(
                list(numbers(followed)), list(numbers(expected)), rtol=1e-9, atol=1e-9
            )
            tracks, believed, jumped = expected
            jumps += jumped
            doubts += believed.doubtful
    assert jumps >= FLIGHTS // 3 and doubts
