"""The independent checker accepts the certificates of plans that climb and descend, and refuses
those in which a number is changed that the plan needs.
"""

import copy
import json
import math
import random
from typing import Any

import numpy as np
import pytest

from agents import check
from agents.inference import Policy
from agents.kernel.levels import Altitude
from agents.planner import Intruder, Options, plan
from agents.planner.answer import RequestError
from agents.planner.request.options import Maneuvers
from envs.aircraft import PAPER, Vertical
from envs.areas import Area, Circle, Keep, Level
from envs.kinematics import VehicleState
from envs.profile import Profile, climbing
from envs.waypoints import RoutePoint
from envs.wind import Wind
from tests.agents.certificates import is_accepted, refusal

REQUESTS = 18
LEVEL = 2_500.0  # m, near which all fly


def random_intruder(rng: random.Random, speed: float) -> Intruder:
    """Return an intruder that is near the route at a time, and near its level."""
    time, age = rng.uniform(30.0, 150.0), rng.choice([0.0, rng.uniform(0.0, 3.0)])
    course, fast = rng.uniform(-math.pi, math.pi), rng.uniform(50.0, 120.0)
    rise, flown = rng.choice([0.0, rng.uniform(-4.0, 4.0)]), fast * (time + age)
    x = speed * time - flown * math.cos(course)
    y = rng.uniform(-600.0, 600.0) - flown * math.sin(course)
    level = LEVEL + rng.uniform(-150.0, 150.0) - rise * (time + age)
    errors = rng.choice([0.0, 10.0]), rng.choice([0.0, 0.2])
    return Intruder(
        VehicleState(x, y, course, fast),
        age,
        position_std=rng.choice([0.0, 20.0]),
        velocity_std=rng.choice([0.0, 1.0]),
        altitude=Altitude(level, "msl", rise, *errors) if rng.random() < 0.9 else None,
    )


def random_areas(rng: random.Random) -> list[Area]:
    """Return areas in the way at some heights, and some not to be left."""
    areas = list[Area]()
    if rng.random() < 0.5:
        shape = Circle(rng.uniform(3e3, 15e3), rng.uniform(-800.0, 800.0), rng.uniform(200.0, 1e3))
        floor = rng.choice([None, Level(LEVEL + rng.uniform(-100.0, 150.0), "msl")])
        ceiling = rng.choice([None, Level(LEVEL + rng.uniform(160.0, 300.0), "msl")])
        areas.append(Area(shape, floor=floor, ceiling=ceiling))
    if rng.random() < 0.3:
        levels = Level(LEVEL - 200.0, "msl"), Level(LEVEL + 400.0, "msl")
        areas.append(Area(Circle(22e3, 0.0, 3e4), Keep.IN, floor=levels[0], ceiling=levels[1]))
    return areas


def random_certificate(rng: random.Random) -> dict[str, Any] | None:
    """Return the certificate of the plan of a random request; None: it is not SAFE."""
    vertical = Vertical(
        climb_max=rng.uniform(1.5, 8.0),
        descent_max=rng.uniform(1.5, 8.0),
        acceleration=rng.uniform(0.3, 2.0),
        separation=rng.choice([76.2, 137.2, 304.8]),
    )
    options = Options.for_aircraft(
        PAPER._replace(vertical=vertical),
        maneuvers=rng.choice([Maneuvers.VERTICAL, Maneuvers.BOTH]),
        extend_route=True,
        deadline_s=math.inf,
        vertical_margin=rng.uniform(5.0, 30.0),
        floor=rng.choice([None, Level(LEVEL - 100.0, "msl")]),
        ceiling=rng.choice([None, Level(LEVEL + 300.0, "msl")]),
    )
    climb = rng.choice([0.0, rng.uniform(-vertical.descent_max, vertical.climb_max)])
    begins = LEVEL + rng.choice([0.0, rng.uniform(-60.0, 100.0)])
    own_altitude = Altitude(begins, "msl", climb, rng.choice([0.0, 12.0]), rng.choice([0.0, 0.3]))
    own = VehicleState(0.0, 0.0, 0.0, rng.uniform(60.0, 92.0))
    target = rng.choice([None, LEVEL, LEVEL + 80.0])
    route = [RoutePoint(n, 5_000.0 * n, 0.0, altitude=target) for n in range(1, 11)]
    intruders = [random_intruder(rng, own.speed) for _ in range(rng.randint(1, 4))]
    wind = rng.choice([None, Wind(rng.uniform(-8.0, 8.0), 5.0), Wind(3.0, 4.0, 0.5)])
    areas = random_areas(rng)
    try:
        answer = plan(
            own,
            intruders,
            route,
            Policy.load(),
            options,
            own_altitude=own_altitude,
            wind=wind,
            areas=areas,
        )
    except RequestError:
        return None  # an altitude that cannot be regained
    return json.loads(answer.certificate) if answer.certificate is not None else None


@pytest.fixture(scope="module")
def certificates() -> list[dict[str, Any]]:
    drawn = [random_certificate(random.Random(seed)) for seed in range(REQUESTS)]
    return [data for data in drawn if data is not None]


def profile_in(data: dict[str, Any]) -> Profile:
    """Return the profile of a certificate."""
    stated, levels = data["profile"], data["levels"]
    return climbing(
        0.5 * (levels[0] + levels[2]),
        stated["climb"],
        [row[4] for row in data["waypoints"]],
        stated["altitudes"],
        acceleration=stated["acceleration"],
    )


def is_right(data: dict[str, Any], row: list[float]) -> bool | None:
    """Return whether an intruder is apart by samples; None: they leave it open."""
    profile, levels = profile_in(data), data["levels"]
    spread = data["profile"]["margin"] + 0.5 * (levels[2] - levels[0])
    times = np.linspace(row[1], row[2], 2_001)
    intruder_height = row[5] + row[6] * (row[7] + times)
    side = 1.0 if intruder_height[0] > row[3] + row[4] * times[0] else -1.0
    near = profile.at(times) + side * spread
    stated = row[3] + row[4] * times
    off, gap = float(np.abs(stated - near).max()), float((side * (intruder_height - near)).min())
    if off > 1e-5 or gap < row[8] - 1e-5:
        return False
    return True if off < 1e-6 and gap > row[8] + 1e-7 else None


def test_plans_that_climb_are_accepted(certificates: list[dict[str, Any]]) -> None:
    for data in certificates:
        assert data["profile"] is not None and data["excluded"] == []
        check.accept(data)
        assert all(is_right(data, row) is not False for row in data["apart"])
    altitudes = [np.ptp(data["profile"]["altitudes"]) for data in certificates]
    assert len(certificates) >= REQUESTS / 3 and np.count_nonzero(altitudes) >= REQUESTS / 4
    assert any(data["profile"]["climb"] != 0.0 for data in certificates)
    assert sum(len(data["apart"]) for data in certificates) > REQUESTS
    for side in ("in", "out"):
        assert any(area["keep"] == side for data in certificates for area in data["areas"])
    assert {data["wind"]["std"] for data in certificates} == {0.0, 0.5}


def test_rows_that_are_changed_and_wrong_are_refused(certificates: list[dict[str, Any]]) -> None:
    rng, verdicts = random.Random(3), {True: 0, False: 0}
    for data in certificates:
        for field in (1, 2, 3, 4, 5, 6, 8) if data["apart"] else ():
            changed = copy.deepcopy(data)
            row = rng.choice(changed["apart"])
            row[field] += rng.choice([-1.0, 1.0]) * rng.choice([0.01, 0.5, 10.0, 100.0])
            if not row[1] < row[2]:
                continue
            # All of an intruder are of one altitude and vertical separation.
            for other_row in changed["apart"]:
                if field > 4 and other_row[0] == row[0]:
                    other_row[field] = row[field]
            accepted = is_accepted(changed)
            if any(is_right(changed, other_row) is False for other_row in changed["apart"]):
                assert not accepted, field
            verdicts[accepted] += 1
    assert min(verdicts.values()) > 3


def test_a_profile_that_is_changed_is_refused(certificates: list[dict[str, Any]]) -> None:
    """Whatever others lie above or below: the limits are then those that the profile has."""
    for data in certificates:
        profile = profile_in(data)
        climbs, stated = profile.climbs[1:], data["profile"]  # the first is the ownship's own
        spread = stated["margin"] + 0.5 * (data["levels"][2] - data["levels"][0])
        highest, lowest = profile.altitude.max(), profile.altitude.min()
        begins = profile.altitude[0]
        corners = max((0.125 * corner.change**2 for corner in profile.corners()), default=0.0)
        corners /= stated["acceleration"]
        changes: list[tuple[str, Any]] = [("climb", stated["climb"] + 0.01)]
        if climbs.max() > 0.01:
            changes.append(("climb_max", float(climbs.max()) - 0.005))
        if climbs.min() < -0.01:
            changes.append(("descent_max", -float(climbs.min()) - 0.005))
        if corners > 0.01:
            changes.append(("margin", corners - 0.005))
        if highest > begins + 0.01:
            changes.append(("ceiling", float(highest) + spread - 0.005))
        if lowest < begins - 0.01:
            changes.append(("floor", float(lowest) - spread + 0.005))
        for name, value in changes:
            assert refusal(data | {"profile": stated | {name: value}}), name


def test_what_others_are_apart_from_cannot_be_changed(certificates: list[dict[str, Any]]) -> None:
    for data in certificates:
        rows = [row for row in data["apart"] if row[2] - row[1] > 0.1 and row[2] < 300.0]
        if not rows:
            continue
        stated = data["profile"]
        for more in (-0.01, 0.01):
            assert refusal(data | {"profile": stated | {"margin": stated["margin"] + more}})
        levels = list(data["levels"])
        levels[0] -= 0.01
        levels[2] += 0.01
        assert refusal(data | {"levels": levels})
        leg = next(n for n, row in enumerate(data["waypoints"]) if rows[0][1] < row[4])
        altitudes = list(stated["altitudes"])
        altitudes[leg] += 0.1
        assert refusal(data | {"profile": stated | {"altitudes": altitudes}})


def test_levels_of_areas_to_be_kept_in_are_floor_and_ceiling(
    certificates: list[dict[str, Any]],
) -> None:
    count = 0
    for data in certificates:
        for number, area in enumerate(data["areas"]):
            if area["keep"] == "in":
                assert data["profile"]["floor"] >= area["heights"][0]
                assert data["profile"]["ceiling"] <= area["heights"][1]
                for name in ("floor", "ceiling"):
                    without = data | {"profile": data["profile"] | {name: None}}
                    assert f"area {number} is to be kept in" in refusal(without)
                count += 1
    assert count > 0


def test_an_area_at_the_heights_of_the_plan_is_refused(certificates: list[dict[str, Any]]) -> None:
    """It lies round a waypoint, at its altitude or beyond all others."""
    for data in certificates[:6]:
        profile, (x, y, _, _, time) = profile_in(data), data["waypoints"][4]
        spread = data["profile"]["margin"] + 0.5 * (data["levels"][2] - data["levels"][0])
        level = float(profile.at(np.array([time]))[0])
        shape = {
            "keep": "out",
            "circle": [x, y, 50.0],
            "rings": [],
            "velocity": [0.0, 0.0],
            "growth": 0.0,
            "clearance": 0.0,
            "valid": [None, None],
        }
        for heights, passes in (
            ([level - 1.0, None], False),
            ([level + spread - 1.0, None], False),
            ([None, level - spread + 1.0], False),
            ([float(profile.altitude.max()) + spread + 20.0, None], True),
            ([None, float(profile.altitude.min()) - spread - 20.0], True),
        ):
            changed = data | {"areas": [*data["areas"], shape | {"heights": heights}]}
            assert is_accepted(changed) == passes
