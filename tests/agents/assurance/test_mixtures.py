"""What the assurance says of several intruders together is what it says of each alone, however
different they are: known exactly or not, turning, counting for a while only, or absent.
"""

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.assurance.bands import Bands, heading_bands, losses_on_course, speed_bands
from agents.planner.traffic import Requirement, Traffic, Window
from envs.kinematics import C208_PUBLISHED, VehicleState
from tests.support import one

REQUIREMENT = Requirement(1_000.0, margin=0.02, sigmas=2.0)
LOOK_AHEAD = 120.0
INTEREST = 200.0  # m of clearance, beyond which a lower bound will do
GOOD = 0.6  # m that a clearance may be off


@st.composite
def intruders(draw: Any) -> dict[str, float]:
    """Draw one intruder: near or far, exact or not, turning or not, always there or for a while."""
    away = draw(st.sampled_from([900.0, 3_000.0, 9_000.0, 60_000.0]))
    bearing = draw(st.floats(-math.pi, math.pi))
    exact, turning, timed = draw(st.booleans()), draw(st.booleans()), draw(st.booleans())
    begin = draw(st.floats(-50.0, 150.0)) if timed else -math.inf
    return {
        "x": away * math.cos(bearing),
        "y": away * math.sin(bearing),
        "heading": draw(st.floats(-math.pi, math.pi)),
        "speed": draw(st.sampled_from([0.0, 40.0, 75.0, 110.0])),
        "mask": draw(st.sampled_from([True, True, True, False])),
        "turn_rate": draw(st.sampled_from([-0.05, 1e-12, 0.03])) if turning else 0.0,
        "turn_time": draw(st.sampled_from([0.0, 15.0, 200.0])) if turning else 0.0,
        "position_std": 0.0 if exact else draw(st.sampled_from([0.0, 30.0, 400.0])),
        "velocity_std": 0.0 if exact else draw(st.sampled_from([0.0, 1.0, 5.0])),
        "age": 0.0 if exact else draw(st.sampled_from([0.0, 3.0])),
        "separation": draw(st.sampled_from([math.nan, 300.0, 2_000.0])),
        "begin": begin,
        "end": begin + draw(st.floats(0.0, 100.0)) if timed else math.inf,
    }


def traffic_of(group: list[dict[str, float]], windows: bool = True) -> Traffic:
    """Return the intruders of one ownship, ``[1, K]``."""
    field = {
        name: np.array([[one[name] for one in group]], dtype=bool if name == "mask" else float)
        for name in intruder_fields()
    }
    state = VehicleState(*(field[name] for name in VehicleState._fields))
    window = Window(field["begin"], field["end"]) if windows else None
    rest = {name: field[name] for name in Traffic._fields if name not in ("state", "window")}
    return Traffic(state=state, window=window, **rest)


def intruder_fields() -> tuple[str, ...]:
    """Return the names of what one intruder is drawn with."""
    return (*VehicleState._fields, *Traffic._fields[1:-1], "begin", "end")


def bands_of(traffic: Traffic) -> tuple[Bands, Bands]:
    """Return the bands of headings and of speeds of an ownship that flies east."""
    given = one(0.0, 0.0, 0.0, 75.0), traffic, REQUIREMENT, C208_PUBLISHED, LOOK_AHEAD
    return heading_bands(*given), speed_bands(*given)


@settings(max_examples=60, deadline=None)
@given(st.lists(intruders(), min_size=1, max_size=4))
def test_a_mixture_closes_what_one_of_its_intruders_closes(group: list[dict[str, float]]) -> None:
    together = bands_of(traffic_of(group))
    each = [bands_of(traffic_of([alone])) for alone in group]
    for kind, mixed in enumerate(together):
        alone = [bands[kind].clearance for bands in each]
        least = np.minimum.reduce(alone)
        np.testing.assert_allclose(
            np.minimum(mixed.clearance, INTEREST), np.minimum(least, INTEREST), atol=GOOD
        )
        clear = np.abs(least) > GOOD
        closed = np.logical_or.reduce([bands[kind].closed for bands in each])
        assert (mixed.closed == closed)[clear].all()
        # The time of a loss is told, and by whom.
        first = np.minimum.reduce([bands[kind].loss for bands in each])
        lost = closed & clear
        np.testing.assert_allclose(mixed.loss[lost], first[lost], atol=1.1)
        assert (mixed.intruder[lost] >= 0).all()

    losses = losses_on_course(one(0.0, 0.0, 0.0, 75.0), traffic_of(group), REQUIREMENT, LOOK_AHEAD)
    alone_losses = [
        losses_on_course(
            one(0.0, 0.0, 0.0, 75.0), traffic_of([alone]), REQUIREMENT, LOOK_AHEAD
        ).item()
        for alone in group
    ]
    assert losses.shape == (1, len(group))
    # A graze of less than a clearance's error may be a loss or none.
    both = np.isfinite(losses[0]) & np.isfinite(alone_losses)
    np.testing.assert_allclose(losses[0][both], np.array(alone_losses)[both], atol=1.1)


def test_bands_of_an_exact_intruder_beside_a_far_one_that_is_not() -> None:
    near = {**dict.fromkeys(intruder_fields(), 0.0), "x": 6_000.0, "heading": math.pi}
    near |= {"speed": 75.0, "mask": True, "separation": math.nan}
    near |= {"begin": -math.inf, "end": math.inf}
    far = near | {"x": -60_000.0, "velocity_std": 2.0}
    alone, both = bands_of(traffic_of([near], False)), bands_of(traffic_of([near, far], False))
    for kind in range(2):
        assert both[kind].closed.any()
        assert (both[kind].closed == alone[kind].closed).all()
