"""The aircraft is made of sourced facts alone, its files are what the facts give, and JSBSim does what they say."""

import math
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.c208.aerodynamics import lift_curve
from envs.c208.conditions import Loading
from envs.c208.facts import FACTS, POINTS, VARIANTS
from envs.c208.fdm import Fdm, FdmError
from envs.c208.model import DATA, aircraft, current, engine
from envs.c208.propulsion import idle_thrust, maximum_thrust, thrust
from envs.c208.trim import TrimError, level_table, read, solve, stored


def test_the_files_that_ship_are_what_the_facts_give() -> None:
    assert current(), "run python -m envs.c208.model"


def test_every_fact_and_point_names_its_source() -> None:
    assert all(fact.source and math.isfinite(fact.value) for fact in FACTS.values())
    assert all(point.source and point.use in ("fit", "check") for point in POINTS)
    fits = sum("fit:" in fact.source for fact in FACTS.values())
    # As many points to fit as facts fitted to them: none is free, none is fitted twice.
    assert fits == sum(point.use == "fit" for point in POINTS)
    assert sum(point.use == "check" for point in POINTS) >= 5


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=lambda variant: variant.name)
def test_the_text_is_xml_for_any_loading(variant) -> None:
    loading = Loading(6500.0, 0.38, 1.3, 0.92, 1.05, pod=True)
    for text in (aircraft(variant), aircraft(variant, loading), engine(variant)):
        ElementTree.fromstring(text)


@pytest.mark.parametrize(
    ("field", "number"),
    [
        ("weight", 3000.0),
        ("weight", math.nan),
        ("centre_of_gravity", 0.5),
        ("inertia_factor", 0.0),
        ("drag_factor", -1.0),
    ],
)
def test_a_loading_out_of_range_is_refused_by_name(field: str, number: float) -> None:
    with pytest.raises(ValueError, match=f"loading.{field} is .*expected"):
        Fdm("ex", Loading()._replace(**{field: number}))


def test_a_loading_reaches_jsbsim() -> None:
    fdm = Fdm("675", Loading(weight=7000.0, centre_of_gravity=0.35))
    solve(fdm, 70.0)
    assert fdm.get("inertia/weight-lbs") == pytest.approx(7000.0)
    assert fdm.get("inertia/cg-x-in") == pytest.approx(177.57 + 0.35 * 66.4, abs=1e-3)


def test_lift_is_continuous_with_one_maximum() -> None:
    alpha, lift = lift_curve()
    assert (np.diff(alpha) > 0.0).all()
    low, top = int(np.argmin(lift[:-1])), int(np.argmax(lift))
    assert (np.diff(lift[low : top + 1]) > 0.0).all() and (np.diff(lift[top:]) < 0.0).all()


@given(st.floats(1e4, 7e5), st.floats(0.0, 120.0), st.floats(0.5, 1.3))
def test_thrust_never_gives_more_power_than_the_shaft(power: float, speed: float, density: float) -> None:
    force = float(thrust(power, speed, density))
    assert math.isfinite(force)
    assert force * speed < 0.80 * power
    assert force > float(thrust(power, speed + 5.0, density))


def test_jsbsim_gives_the_thrust_of_the_propulsion_model() -> None:
    fdm = Fdm()
    for speed, altitude in ((52.0, 2500.0), (83.0, 2500.0), (66.0, 500.0), (90.0, 5000.0)):
        for throttle, curve in ((0.0, idle_thrust), (1.0, maximum_thrust)):
            found = solve(fdm, speed, altitude, throttle=throttle)
            density = fdm.get("atmosphere/rho-slugs_ft3") * 515.378819
            expected = float(curve(fdm.variant, speed, density))
            # Linear interpolation between the tables' points.
            assert found.thrust == pytest.approx(expected, rel=0.015, abs=15.0)


def test_the_stored_equilibria_are_the_aircrafts() -> None:
    for name, kept, found in zip(stored()._fields, stored(), level_table(Fdm()), strict=True):
        np.testing.assert_allclose(kept, found, rtol=1e-5, atol=1e-7, err_msg=f"{name}: python -m envs.c208.trim")


def test_an_equilibrium_lasts_when_flown_open_loop() -> None:
    fdm = Fdm()
    found = solve(fdm, 70.0)
    for _ in range(600):
        fdm.exec.run()
    # Ten seconds in which nobody steers: the phugoid has nothing to start from.
    assert fdm.get("velocities/vt-fps") * 0.3048 == pytest.approx(70.0, abs=0.05)
    assert fdm.get("aero/alpha-rad") == pytest.approx(found.alpha, abs=2e-4)
    assert abs(fdm.get("velocities/h-dot-fps")) < 0.5


def test_no_equilibrium_below_the_stall_or_beyond_the_power() -> None:
    fdm = Fdm()
    for speed in (35.0, 118.0):
        with pytest.raises(TrimError, match=f"{speed:.2f} m/s"):
            solve(fdm, speed)
    assert solve(fdm, 70.0).speed == 70.0


@pytest.mark.parametrize(
    "text", ["speed,alpha\n1,2\n2,3\n", "", "speed,alpha,elevator,thrust\n50,0.1,x,3\n60,0.1,0,3\n"]
)
def test_a_damaged_table_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="column"):
        read(text)


def test_unknown_names_and_missing_files_are_errors(tmp_path) -> None:
    fdm = Fdm()
    with pytest.raises(FdmError, match="velocities/typo"):
        fdm.get("velocities/typo")
    with pytest.raises(FdmError, match="expected one of ex, 675"):
        Fdm("172")
    with pytest.raises(FdmError, match="missing"):
        Fdm("ex", root=tmp_path)
    (tmp_path / "engine").mkdir()
    for file in (DATA / "engine").iterdir():
        (tmp_path / "engine" / file.name).write_text(file.read_text())
    with pytest.raises(FdmError, match="does not load"):
        Fdm("ex", root=tmp_path)


def test_jsbsim_says_nothing() -> None:
    program = "from envs.c208.fdm import Fdm; from envs.c208.trim import solve; solve(Fdm(), 70.0)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout == "" and result.stderr == ""
