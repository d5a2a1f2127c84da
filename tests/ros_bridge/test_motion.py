"""How a report is carried to now."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.wind import NO_WIND, Wind
from ros_bridge.core.motion import all_to_local, carry_on, to_local
from ros_bridge.core.reports import Report


@given(
    heading=st.floats(-3.1, 3.1),
    rate=st.floats(-0.2, 0.2),
    turn_time=st.floats(0.0, 20.0),
    seconds=st.floats(0.0, 30.0),
    east=st.floats(-15.0, 15.0),
)
def test_a_report_goes_on_in_its_turn_and_then_straight(
    heading: float, rate: float, turn_time: float, seconds: float, east: float
):
    """As the sum of short steps through an air that drifts."""
    start: VehicleState[Ground] = VehicleState(100.0, -50.0, heading, 80.0)
    wind = Wind(east, 5.0)
    after = carry_on(start, rate, turn_time, seconds, wind)
    steps = 4_000
    times = (np.arange(steps) + 0.5) * seconds / steps
    air = complex(80.0 * math.cos(heading) - east, 80.0 * math.sin(heading) - 5.0)
    velocity = air * np.exp(1j * rate * np.minimum(times, turn_time)) + complex(east, 5.0)
    place = complex(100.0, -50.0) + velocity.sum() * seconds / steps
    assert abs(complex(float(after.x), float(after.y)) - place) < 0.05
    last = air * np.exp(1j * rate * min(seconds, turn_time)) + complex(east, 5.0)
    turned = math.remainder(float(after.heading) - float(np.angle(last)), 2.0 * math.pi)
    assert abs(turned) < 1e-6 and float(after.speed) == pytest.approx(abs(last))


def test_many_reports_are_carried_on_as_each_of_them():
    rows = np.linspace(-1.0, 1.0, 5)
    states: VehicleState[Ground] = VehicleState(1e3 * rows, 0.0 * rows, 3.0 * rows, 80.0 + rows)
    rates, ages = 0.1 * rows, np.array([-0.4, 0.0, 2.0, 10.0, 40.0])
    together = carry_on(states, rates, 15.0, ages, NO_WIND)
    for number in range(5):
        alone = carry_on(
            VehicleState(*(float(field[number]) for field in states)),
            float(rates[number]),
            15.0,
            float(ages[number]),
            NO_WIND,
        )
        assert [float(field[number]) for field in together] == pytest.approx(
            [float(value) for value in alone]
        )


def test_reports_together_stand_in_a_frame_as_each_of_them():
    frame = LocalFrame(47.0, 179.9)  # beside the antimeridian
    reports = [
        Report(str(number), 0, 47.0 + 0.1 * number, longitude, 60.0 - 30.0 * number, -20.0)
        for number, longitude in enumerate((179.9, -179.8, 180.3))
    ]
    assert all_to_local(frame, reports) == [to_local(frame, report) for report in reports]
    assert all_to_local(frame, []) == []
    there = all_to_local(frame, reports)[1]
    place = frame.place(47.1, -179.8)
    assert (there.x, there.y) == (float(place.x), float(place.y))
