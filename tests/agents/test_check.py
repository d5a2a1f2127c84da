"""The certificate of a plan proves it to a checker that knows nothing of the planner; an edited one
is refused.
"""

import ast
import cmath
import copy
import json
import math
import os
import pickle
import random
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from agents import check
from agents.check.aircraft import check_aircraft, read_aircraft
from agents.check.summary import summary
from agents.config.load import load
from agents.config.world import AircraftConfig
from agents.inference import Policy
from agents.planner import Intruder, Status, plan
from agents.planner.publish.certificate import FORMAT
from agents.planner.request.request import Altitude
from envs.areas import Area, Circle, Level, Polygon
from envs.kinematics import VehicleState
from envs.wind import Wind
from tests.agents.certificates import (
    HEIGHT,
    INTRUDERS,
    OWN,
    ROUTE,
    certificate,
    is_accepted,
    refusal,
)
from tests.agents.check.certificates import area, climbing, intruder
from tests.agents.scenes import PATIENT

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    return certificate()


@pytest.fixture(scope="module")
def among_areas() -> dict[str, Any]:
    """A certificate in which every field is filled."""
    column = Area(
        Circle(4_000.0, -6_000.0, 1_500.0), floor=Level(1_000.0, "msl"), valid_until=200.0
    )
    corners = ((8_000.0, 5_000.0), (9_000.0, 5_000.0), (9_000.0, 7_000.0))
    areas = [column, Area(Polygon(corners), velocity=(1.0, 0.0), growth=1.0)]
    answer = plan(
        OWN,
        INTRUDERS,
        ROUTE,
        Policy.load(),
        PATIENT,
        own_altitude=HEIGHT,
        wind=Wind(5.0, 3.0, 0.5),
        areas=areas,
    )
    named = answer.certificate_with(time_ns=17, origin=(47.5, 8.25))
    assert answer.safe and named is not None
    return json.loads(named)


def test_safe_plan_is_accepted_within_a_second(data: dict[str, Any]) -> None:
    begun = time.process_time()
    assert min(check.accept(data).bounds) == min(data["bounds"]) > 1_000.0
    assert time.process_time() - begun < 1.0
    assert data["format"] == FORMAT == check.FORMAT
    assert len(json.dumps(data)) < 20_000


@pytest.mark.parametrize(
    ("path", "change"),
    [
        (("own", 0), 1.0),
        (("own", 3), 0.1),
        (("waypoints", 3, 0), 0.01),
        (("waypoints", 3, 2), 1e-4),
        (("waypoints", 7, 3), 1e-3),
        (("waypoints", 7, 4), 1e-3),
        (("waypoints", 19, 1), 0.01),
        (("controls", 0, 4), 1e-7),
        (("controls", 5, 15), 1e-6),
        (("bounds", 0), 0.01),
        (("bounds", 1), 0.01),
        (("excluded", 0, 2), -2_900.0),
        (("limits", "yaw_rate_max"), -0.08),
        (("limits", "speed_max"), -40.0),
        (("limits", "acceleration_max"), -0.7),
    ],
)
def test_an_edit_that_matters_is_refused(
    data: dict[str, Any], path: tuple[Any, ...], change: float
) -> None:
    edited = copy.deepcopy(data)
    place = edited
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] += change
    assert refusal(edited)


@pytest.mark.parametrize("name", ["separation", "margin"])
def test_a_requirement_above_the_least_distance_is_refused(data: dict[str, Any], name: str) -> None:
    edited = copy.deepcopy(data)
    more = data["bounds"][0] - data["intruders"][0][9] + 1.0
    if name == "separation":
        edited["intruders"][0][9] += more
    else:
        edited["requirement"][name] += more
    assert "intruder 0" in refusal(edited)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("format", "another"),
        ("parts", 3),
        ("parts", 1.0),
        ("own", [0.0, 0.0, 0.0]),
        ("waypoints", []),
        ("waypoints", [["1"] * 5]),
        ("controls", [[float("nan")] * 20] * 20),
        ("limits", {}),
        ("requirement", None),
        ("intruders", {}),
        ("bounds", [True, True]),
        ("more", 1),
    ],
)
def test_what_is_no_certificate_is_refused(data: dict[str, Any], field: str, value: Any) -> None:
    assert refusal(data | {field: value})
    assert refusal(
        {key: entry for key, entry in data.items() if key != field} if field in data else []
    )


def test_only_a_safe_plan_has_a_certificate() -> None:
    answer = plan(OWN, [VehicleState(500.0, 0.0, 0.0, 80.0)], ROUTE, Policy.load(), PATIENT)
    assert not answer.safe and answer.certificate is None
    safe = plan(OWN, [], ROUTE, Policy.load(), PATIENT)
    assert safe.certificate == pickle.loads(pickle.dumps(safe)).certificate
    assert replace(safe, status=Status.UNRESOLVED).certificate is None


def test_intruder_on_the_plan_is_refused(data: dict[str, Any]) -> None:
    edited = copy.deepcopy(data)
    x, y, heading, speed, at = edited["waypoints"][8]
    row = [x - speed * at * math.cos(heading), y - speed * at * math.sin(heading), heading, speed]
    edited["intruders"].append([*row, 0.0, 0.0, 0.0, 0.0, 0.0, 1_000.0])
    edited["bounds"].append(1_000.0)
    assert "intruder 2" in refusal(edited)


@pytest.mark.parametrize(("far", "passes"), [(900.0, False), (1_100.0, True)])
def test_fast_intruder_that_crosses_between_waypoints(
    data: dict[str, Any], far: float, passes: bool
) -> None:
    x, y, heading, speed, at = data["waypoints"][8]
    place = complex(x, y) + (far - 10.0 * speed) * cmath.exp(1j * heading)
    begin = place - 390.0 * (at - 10.0) * cmath.exp(1j * (heading + 0.5 * math.pi))
    edited = copy.deepcopy(data)
    edited["intruders"].append(
        [begin.real, begin.imag, heading + 0.5 * math.pi, 390.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1_000.0]
    )
    edited["bounds"].append(1_000.0)
    if passes:
        assert check.accept(edited).bounds[-1] == 1_000.0
    else:
        assert "intruder 2" in refusal(edited)


def test_checker_imports_python_and_itself_alone() -> None:
    for path in sorted(Path(check.__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level <= 1, f"{path.name} imports from above its folder"
                names = {node.module or ""} if node.level == 0 else set[str]()
            else:
                continue
            roots = {name.partition(".")[0] for name in names}
            assert roots <= set(sys.stdlib_module_names), path.name


def test_command_says_what_it_found(data: dict[str, Any], tmp_path: Path) -> None:
    names = ("good.json", "bad.json", "torn.json", "twice.json")
    good, bad, torn, twice = (tmp_path / name for name in names)
    good.write_text(json.dumps(data))
    bad.write_text(json.dumps(data | {"bounds": [1e5, 1e5]}))
    torn.write_text(json.dumps(data)[:-5])
    # Alone in a directory, without the rest of the project.
    alone = tmp_path / "alone"
    shutil.copytree(Path(check.__file__).parent, alone / "check")
    os.mkfifo(pipe := tmp_path / "pipe")
    twice.write_text(json.dumps(data)[:-1] + ',"intruders":[],"bounds":[]}')
    slow, fast = tmp_path / "slow.yaml", ROOT / "configs" / "aircraft" / "paper.yaml"
    slow.write_text(fast.read_text().replace("speed_max_mps: 100.0", "speed_max_mps: 60.0"))
    half = tmp_path / "half.yaml"
    half.write_text(re.sub(r"  yaw_rate_max_deg_s: .*\n", "", fast.read_text()))
    wrong_file = tmp_path / "wrong.yaml"
    wrong_file.write_text("speed_min_mps: fifty\n")
    for arguments, status, line in (
        ([good], 0, "intruders: 2; none comes closer than"),
        ([good, "--aircraft", fast], 0, "limits: 31 to 100 m/s"),
        ([good, "--aircraft", slow], 1, "its speed_max is 100, beyond the aircraft's"),
        ([good, "--aircraft", half], 2, "vehicle.yaw_rate_max_deg_s is missing"),
        ([good, "--aircraft", wrong_file], 2, "'fifty' is no number"),
        ([bad], 1, "intruder 0"),
        ([torn], 2, "cannot be read"),
        ([twice], 2, "the key 'intruders' stands twice"),
        ([pipe], 2, "not a regular file"),
        ([tmp_path / "none"], 2, "there is no such file"),
        ([], 2, "usage"),
    ):
        process = subprocess.run(
            # Without the packages that are installed.
            [sys.executable, "-E", "-S", "-m", "check", *arguments],
            cwd=alone,
            capture_output=True,
            text=True,
            check=False,
        )
        assert process.returncode == status, process.stderr
        assert "Traceback" not in process.stderr
        assert line in (process.stdout if status == 0 else process.stderr)


def test_what_is_accepted_is_said_with_limits_requirement_and_flight(data: dict[str, Any]) -> None:
    lines = "\n".join(summary(check.accept(data)))
    assert "intruders: 2; " in lines and "left out: 1, 600 m or more" in lines
    assert "required: 1000 m and a margin of 0.02 m" in lines
    assert "31 to 100 m/s, -0.8 to 0.5 m/s^2, 5 deg/s" in lines
    assert Policy.load().sha256 in lines and "time: unknown" in lines
    wide = copy.deepcopy(data)
    wide["limits"]["speed_max"] = 1e7
    assert "31 to 1e+07 m/s" in "\n".join(summary(check.accept(wide)))
    aircraft = read_aircraft((ROOT / "configs/aircraft/paper.yaml").read_text())
    with pytest.raises(check.RefusedError, match="speed_max is 1e\\+07, beyond the aircraft's"):
        check_aircraft(check.accept(wide), aircraft)
    close = copy.deepcopy(data)
    close["intruders"][1][9] = 999.0
    lines = "\n".join(summary(check.accept(close)))
    assert "separations of their own: intruders 1: 999 m" in lines
    with pytest.raises(check.RefusedError, match="from intruder 1 is 999 m, below the aircraft's"):
        check_aircraft(check.accept(close), aircraft)
    close["requirement"]["separation"] = 1.0
    with pytest.raises(check.RefusedError, match="separation is 1 m, below the aircraft's"):
        check_aircraft(check.accept(close), aircraft)


@pytest.fixture(scope="module")
def at_all_heights() -> dict[str, Any]:
    """A certificate with intruders left out above and below, and one that climbs past the
    ownship.
    """
    own = Altitude(2_500.0, "msl", 1.0, error=20.0, climb_error=0.5)
    state = VehicleState(5_000.0, 3_000.0, -2.0, 70.0)
    intruders = [
        Intruder(state, 1.0, altitude=Altitude(9_500.0, "msl", 1.0, 10.0, 0.5)),
        Intruder(state, 1.0, altitude=Altitude(100.0, "msl", -1.0, 10.0, 0.5)),
        Intruder(
            VehicleState(60_000.0, 30_000.0, -2.0, 70.0),
            1.0,
            altitude=Altitude(1_000.0, "msl", 18.0, 10.0, 0.5),
        ),
    ]
    answer = plan(OWN, intruders, ROUTE, Policy.load(), PATIENT, own_altitude=own)
    assert answer.safe and len(answer.excluded) == 2 and answer.certificate is not None
    stated = json.loads(answer.certificate)
    assert len(stated["apart"]) == 2 and is_accepted(stated)
    return stated


TWICE = [
    *((("levels", n), ("excluded", 0, n - 2)) for n in (2, 3)),  # the first is above
    *((("levels", n), ("excluded", 1, n)) for n in (0, 1)),
    *((("levels", n), ("apart", 0, 3 + n)) for n in (0, 1)),  # first below, then above
    *((("levels", n), ("apart", 1, 1 + n)) for n in (2, 3)),
    *((("intruders", 0, 4), ("apart", n, 7)) for n in (0, 1)),
    (("apart", 0, 8), ("apart", 1, 8)),
]
"""Places of a certificate at all heights that state the same."""


@pytest.mark.parametrize("paths", TWICE)
def test_a_certificate_that_contradicts_itself_is_refused(
    at_all_heights: dict[str, Any], paths: tuple[tuple[Any, ...], tuple[Any, ...]]
) -> None:
    values = [value_at(at_all_heights, path) for path in paths]
    assert values[0] == values[1]
    for path in paths:
        for change in (-1e-3, 1e-3, -300.0, 300.0):
            edited = copy.deepcopy(at_all_heights)
            place = value_at(edited, path[:-1])
            place[path[-1]] += change
            assert refusal(edited), (path, change)
    assert refusal(at_all_heights | {"levels": None})


def value_at(data: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("levels",), [9_000.0, 0.0, 0.0, 0.0]),  # no area counts for it
        (("levels",), [2_500.0, 1.0, 2_500.0, 0.0]),
        (("areas", 0, "valid"), [300.0, 200.0]),
        (("areas", 0, "heights"), [4_000.0, 3_000.0]),
        (("limits", "speed_min"), 200.0),  # a plan that begins beyond a limit may stay there
        (("request", "latitude"), None),
        (("bounds", 0), 0.0),  # which says that the intruder never counts
    ],
)
def test_what_holds_nothing_is_refused(
    among_areas: dict[str, Any], path: tuple[Any, ...], value: Any
) -> None:
    edited = copy.deepcopy(among_areas) | {"excluded": []}
    assert is_accepted(edited)
    value_at(edited, path[:-1])[path[-1]] = value
    assert refusal(edited)


def test_an_intruder_at_two_altitudes_in_apart_is_refused(at_all_heights: dict[str, Any]) -> None:
    edited = copy.deepcopy(at_all_heights)
    edited["apart"][1][5] = edited["apart"][0][5] + 1_000.0
    assert "more than one altitude" in refusal(edited)


def test_a_proof_takes_no_more_work_than_there_is(data: dict[str, Any]) -> None:
    parallel = [0.0, 2_000.0, 0.0, 80.0, *[0.0] * 5, 1_000.0]
    far = [0.0, 3e5, *[0.0] * 7, 1_000.0]
    usual = {"apart": [], "excluded": []}
    for row, count, enough in ((far, 1_000, 3_000), (parallel, 50, 300_000)):
        crowded = data | usual | {"intruders": [row] * count, "bounds": [1.0] * count}
        check.accept(crowded, check.Work(enough))
    with pytest.raises(check.RefusedError, match="takes more than 3000 parts"):
        check.accept(crowded, check.Work(3_000))


ODD = (
    *(None, True, "x", "\ud800", "a\nb\x1b[31m", [], {}, [[]], {"a": 1}),
    *(math.nan, math.inf, -1e300, 1e300, 10**400, 1e8, -1.0, 0, 5e-324, 2**70),
)
CLIMBS = climbing(
    *(1_087.5, 1_087.5, 1_007.5),
    profile={"floor": 900.0, "ceiling": 1_200.0},
    intruders=[intruder(1_600.0, 500.0)],
    apart=[
        [0, 2.5, 20.0, 1_002.5, 5.0, 2_000.0, 0.0, 0.0, 600.0],
        [0, 20.0, 40.0, 1_102.5, 0.0, 2_000.0, 0.0, 0.0, 600.0],
    ],
    areas=[area(circle=[880.0, 0.0, 5.0], heights=[1_100.0, 1_150.0])],
)
EDITS = int(os.environ.get("FUZZ_CERTIFICATES", "100"))


def places_in(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths to everything in an object of JSON."""
    keys = value if isinstance(value, dict) else range(len(value) if isinstance(value, list) else 0)
    for key in keys:
        yield (*path, key)
        yield from places_in(value[key], (*path, key))


def edit(data: Any, rng: random.Random) -> None:
    """Remove something of an object of JSON, at any depth, put something odd in its place, or
    double it.
    """
    *way, last = rng.choice(list(places_in(data)))
    inside = data
    for key in way:
        inside = inside[key]
    kind = rng.randrange(10)
    if kind == 0:
        del inside[last]
    elif kind == 1 and isinstance(inside, list):
        inside.insert(last, inside[last])
    else:
        inside[last] = rng.choice(ODD)


def test_an_edit_of_anything_is_answered_in_a_sentence(
    among_areas: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(51)
    path = tmp_path / "edited.json"
    assert is_accepted(CLIMBS)
    for number in range(EDITS):
        changed = copy.deepcopy(among_areas if number % 2 else CLIMBS)
        edit(changed, rng)
        path.write_text(json.dumps(changed))
        status = check.main([str(path)])
        printed, refused = capsys.readouterr()
        assert status in (0, 1)
        assert refused.count("\n") == (status == 1)
        assert printed.count("\n") <= 10 and "\x1b" not in printed


def test_a_certificate_that_is_no_object_is_refused() -> None:
    for data in ODD:
        assert refusal(data)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_what_cannot_be_said_is_not_accepted(data: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "good.json"
    path.write_text(json.dumps(data))
    with Path("/dev/full").open("w") as full:
        process = subprocess.run(
            [sys.executable, "-m", "agents.check", path],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert process.returncode == 2
    assert process.stderr == "the output cannot be written: No space left on device\n"


def test_a_name_that_the_output_cannot_hold_is_said_by_its_code(
    data: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "höhe.json"
    path.write_text(json.dumps(data))
    process = subprocess.run(
        [sys.executable, "-m", "agents.check", path],
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stderr) == (
        0,
        "",
    ) and "h\\xf6he.json: accepted" in process.stdout


@pytest.mark.parametrize("path", sorted((ROOT / "configs/aircraft").glob("*.yaml")))
def test_aircraft_files_are_read_as_the_toolkit_reads_them(path: Path) -> None:
    read, config = read_aircraft(path.read_text()), load(AircraftConfig, path)
    stated = config.model_dump(exclude_unset=True)
    vehicle = stated.pop("vehicle", None) or {}
    assert read == stated | {f"vehicle.{name}": value for name, value in vehicle.items()}


@pytest.mark.parametrize("text", ["speed_min_mps: 1\nspeed_min_mps: 2\n", "- 1\n", "a: {b: 1}\n"])
def test_other_aircraft_files_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"line|missing"):
        read_aircraft(text)


def test_an_aircraft_that_ships_is_named_alone(
    data: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    certificate = tmp_path / "certificate.json"
    certificate.write_text(json.dumps(data))
    assert check.main([str(certificate), "--aircraft", "paper"]) == 0
    assert check.main([str(certificate), "--aircraft", "papier"]) == 2
    assert "papier: cannot be read: there is no such file" in capsys.readouterr().err


def test_a_certificate_says_which_flight_it_belongs_to(data: dict[str, Any]) -> None:
    answer = plan(OWN, INTRUDERS, ROUTE, Policy.load(), PATIENT, own_altitude=HEIGHT)
    named = json.loads(answer.certificate_with(time_ns=17, origin=(47.5, 8.25)) or b"")
    assert named["request"] == {
        "policy": Policy.load().sha256,
        "time_ns": 17,
        "latitude": 47.5,
        "longitude": 8.25,
    }
    assert "47.500000, 8.250000" in "\n".join(summary(check.accept(named)))
    assert refusal(data | {"request": named["request"] | {"time_ns": "now"}})
