"""The policy in BlueSky and in BlueSky-Gym, both real and headless, in the environment that ``make
bluesky`` makes.
"""

import json
import math
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".bluesky" / "bin" / "python"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not PYTHON.exists(), reason="there is no .bluesky: make bluesky"),
]

PLUGIN = """
import json
from pathlib import Path

import bluesky as bs
import numpy as np

Path("plugins").mkdir()
Path("plugins/rlcas.py").symlink_to(SOURCE)
bs.init(mode="sim", detached=True, workdir=".")
said = []
bs.stack.echo = said.append


def fly(method, kind, seconds=700, more="OP", crowd=0, crossing=0.9, wind=None):
    bs.sim.reset()
    said.clear()
    for command in ("DT 1", "PLUGIN LOAD RLCAS", "ASAS ON", f"RESO {method}", more):
        bs.stack.stack(command)
    if wind is not None:
        bs.traf.wind.addpoint(0.0, 0.0, *wind)  # where it comes from, degrees, and m/s
    # Two aircraft meet head on, a third crosses; a fourth flies far below. In an exactly mirrored scene those that meet
    # would decide in mirrored ways, so that neither could pass first.
    starts = (0, 0, 90, 0), (0, 1.9, 270, 0), (-0.95, crossing, 0, 0), (0, 0, 90, 9_000)
    for i, (lat, lon, heading, low) in enumerate(starts):
        bs.traf.cre(f"A{i}", kind, float(lat), float(lon), float(heading), (30_000 - low) * 0.3048, 0.75)
    for angle in np.linspace(0.3, 5.3, crowd):  # more that meet in the same place
        place = float(np.sin(angle)), float(0.95 + np.cos(angle))
        bs.traf.cre(f"B{angle:.1f}", kind, *place, float(-90 - np.degrees(angle)) % 360, 30_000 * 0.3048, 0.75)
    least, turned, level_off, resolving, planned, path = 1e9, 0.0, 0.0, 0, 0, []
    for _ in range(seconds):
        bs.sim.step()
        path.append((float(bs.traf.lat[0]), float(bs.traf.lon[0])))
        y, x = (np.radians(each[:3]) * 6_371_000 for each in (bs.traf.lat, bs.traf.lon))
        least = min(least, np.hypot(x[:, None] - x, y[:, None] - y)[np.triu_indices(3, 1)].min() / 1852)
        resolving = max(resolving, int(bs.traf.cr.active.sum()))
        planned = max(planned, sum(one.legs is not None for one in getattr(bs.traf.cr, "plans", {}).values()))
        turned = max(turned, abs(bs.traf.hdg[3] - 90.0))
        level_off = max(level_off, np.abs(bs.traf.vs).max())
    return {"least": float(least), "turned_below": float(turned), "climb": float(level_off), "said": list(said),
            "course": float(bs.traf.hdg[0]), "resolving": resolving, "planned": planned,
            "path": path, "track": float(bs.traf.trk[0]), "blown": float(np.hypot(bs.traf.windeast[0], bs.traf.windnorth[0]))}


found = {"OFF": fly("OFF", "A320", 500), "RLCAS": fly("RLCAS", "A320")}
found["plans"] = fly("RLCAS", "A320", more="RLCASPLAN ON")
lat, lon = max(found["plans"]["path"], key=lambda place: abs(place[0]))
areas = f"RLCASPLAN ON;RLCASAREAS ON;CIRCLE LAKE {lat} {lon} 4;POLYALT LOW 1000 0 -0.1 0.8 0.1 0.8 0.1 1.1 -0.1 1.1;LINE L 0 0 1 1"
found["areas"] = fly("RLCAS", "A320", more=areas) | {"lake": (lat, lon)}
found["wide area"] = fly("RLCAS", "A320", 200, f"{areas};BOX STATE -1 -1 1 1")
found["policy in wind"] = fly("RLCAS", "A320", wind=(60.0, 42.0))
found["plans in wind"] = fly("RLCAS", "A320", more="RLCASPLAN ON", wind=(60.0, 42.0))
found["unknown"] = fly("RLCAS", "XQ99", 200)
found["outside"] = fly("RLCAS", "A320", 200, "ZONER 1")
found["allowed"] = fly("RLCAS", "A320", 200, "ZONER 1;RLCASOUTSIDE ON", crossing=0.95)
found["crowd"] = fly("RLCAS", "A320", 120, crowd=7)
found["off_for_all"] = fly("RLCAS", "A320", 500, "RESOOFF A0 A1 A2")
print(json.dumps(found))
"""

ROTORCRAFT = """
import json
from pathlib import Path

import bluesky as bs
import numpy as np
from bluesky.stack import simstack

Path("plugins").mkdir()
Path("plugins/rlcas.py").symlink_to(SOURCE)
bs.init(mode="sim", detached=True, workdir=".")
said = []
bs.stack.echo = simstack.echo = lambda text="", flags=0: said.append(text)


def switch(line):
    said.clear()
    bs.stack.stack(line)
    bs.sim.step()
    return [text for text in said if "RLCAS" in text], bs.traf.cr.planning, bs.traf.cr.outside


def meet(kind, speed, apart, seconds, *commands):
    bs.sim.reset()
    said.clear()
    for command in ("DT 1", "PLUGIN LOAD RLCAS", "ASAS ON", "RESO RLCAS", "ZONER 1", *commands):
        bs.stack.stack(command)
    bs.traf.cre("H0", kind, 0.0, 0.0, 90.0, 600.0, speed)
    bs.traf.cre("H1", kind, 0.002, apart, 270.0, 600.0, speed)
    least, fastest, slowest = 1e9, 0.0, 1e9
    for _ in range(seconds):
        bs.sim.step()
        x, y = (np.radians(each) * 6_371_000 for each in (bs.traf.lon, bs.traf.lat))
        least = min(least, float(np.hypot(x[1] - x[0], y[1] - y[0])))
        fastest, slowest = max(fastest, float(bs.traf.tas.max())), min(slowest, float(bs.traf.tas.min()))
    return {"least": least, "fastest": fastest, "slowest": slowest, "said": list(said)}


found = {
    kind: [meet(kind, speed, apart, 900), meet(kind, speed, apart, 900, "RLCASOUTSIDE ON")]
    for kind, speed, apart in (("EC35", 60.0, 0.4), ("M600", 15.0, 0.12))
}
bs.sim.reset()
for command in ("PLUGIN LOAD RLCAS", "ASAS ON", "RESO RLCAS"):
    bs.stack.stack(command)
bs.sim.step()
lines = ("RLCASPLAN", "RLCASPLAN ON", "RLCASPLAN", "RLCASPLAN OFF", "RLCASPLAN maybe",
         "RLCASOUTSIDE ON", "RLCASOUTSIDE OFF", "RLCASOUTSIDE", "RLCASPLAN 1", "RLCASPLAN 0")
found["switches"] = [(line, *switch(line)) for line in lines]
found["areas"] = []
for word in ("", " ON", "", " maybe", " OFF", ""):
    texts, *_ = switch(f"RLCASAREAS{word}")
    found["areas"].append((texts[0] if texts else "", bs.traf.cr.among_areas))
print(json.dumps(found))
"""

CLIMBS = """
import json
from pathlib import Path

import bluesky as bs
import numpy as np
from bluesky.stack import simstack

Path("plugins").mkdir()
Path("plugins/rlcas.py").symlink_to(SOURCE)
bs.init(mode="sim", detached=True, workdir=".")
said = []
bs.stack.echo = simstack.echo = lambda text="", flags=0: said.append(text)
BEGIN = "DT 1", "PLUGIN LOAD RLCAS", "ASAS ON", "RESO RLCAS", "RLCASPLAN ON"


def meet(*commands, seconds=700, low=0.0, after=()):
    bs.sim.reset()
    said.clear()
    for command in (*BEGIN, *commands):
        bs.stack.stack(command)
    bs.traf.cre("WEST", "A320", 0.0, 0.0, 90.0, 30_000 * 0.3048, 0.75)
    bs.traf.cre("EAST", "A320", 0.0, 1.9, 270.0, (30_000 - low) * 0.3048, 0.75)
    for command in after:
        bs.stack.stack(command)
    rows = []
    for _ in range(seconds):
        bs.sim.step()
        x, y = (np.radians(each) * 6_371_000 / 1852 for each in (bs.traf.lon, bs.traf.lat))
        rows.append((float(np.hypot(x[1] - x[0], y[1] - y[0])), *(bs.traf.alt / 0.3048).tolist(), *y.tolist(),
                     *bs.traf.vs.tolist()))
    return {"rows": rows, "course": bs.traf.hdg.tolist(), "said": list(said)}


found = {
    "both": meet("RLCASMANEUVERS BOTH"),
    "levels": meet("RLCASMANEUVERS VERTICAL", "RLCASLEVELS FL250 FL302"),
    "climber": meet("RLCASMANEUVERS BOTH", low=4_000.0, after=("ALT EAST FL330 800", "RESOOFF EAST")),
}
found["switches"] = []
for line in ("RLCASMANEUVERS", "RLCASMANEUVERS UP", "RLCASLEVELS", "RLCASLEVELS FL300 FL200", "RLCASMANEUVERS both"):
    said.clear()
    bs.stack.stack(line)
    bs.sim.step()
    found["switches"].append((line, " ".join(said), bs.traf.cr.maneuvers.name))
print(json.dumps(found))
"""

GYM = """
import json, random

import bluesky as bs
import bluesky_gym
import gymnasium
import numpy as np

from eval.bluesky.gym import ENVIRONMENT, Pilot, observe

bluesky_gym.register_envs()
environment, pilot, free, drift, wrong = gymnasium.make(ENVIRONMENT), Pilot(), [], [], 0.0
for seed in range(4):
    np.random.seed(seed)
    random.seed(seed)
    observation, over = environment.reset(seed=seed)[0], False
    while not over:
        speed, traffic, goal = observe(observation)
        heading, lat, lon = (np.radians(each) for each in (bs.traf.hdg, bs.traf.lat, bs.traf.lon))
        x, y = 6_371_000 * (lon - lon[0]) * np.cos(lat[0]), 6_371_000 * (lat - lat[0])
        sine, cosine = np.sin(heading[0]), np.cos(heading[0])
        ahead, left = np.array([sine, cosine]), np.array([-cosine, sine])
        for one, i in zip(traffic, range(1, 6), strict=True):
            place = np.array([x[i], y[i]])
            wrong = max(wrong, np.hypot(one.x - place @ ahead, one.y - place @ left) / np.hypot(*place))
            wrong = max(wrong, abs((one.heading - heading[0] + heading[i] + np.pi) % (2 * np.pi) - np.pi))
        wrong = max(wrong, abs(speed - min(bs.traf.gs[0], 89.0)) / speed)
        action = pilot(observation)
        assert environment.action_space.contains(action)
        observation, _, reached, late, info = environment.step(action)
        over = reached or late
    free.append(info["total_intrusions"] == 0 and bool(reached))
    drift.append(info["average_drift"])
print(json.dumps({"free": free, "drift": float(np.mean(drift)), "wrong": float(wrong)}))
"""


def run(program: str, folder: Path) -> dict:
    process = subprocess.run(
        [
            PYTHON,
            "-c",
            program.replace("SOURCE", repr(str(ROOT / "eval" / "bluesky" / "plugin.py"))),
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
    )
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout.splitlines()[-1])


def from_lake(path: list[list[float]], lake: list[float]) -> float:
    """Return how near a path about the equator comes to a place, NM."""
    return min(60.0 * math.hypot(lat - lake[0], lon - lake[1]) for lat, lon in path)


def test_aircraft_in_bluesky_keep_the_separation_by_the_policy(tmp_path: Path):
    results = run(PLUGIN, tmp_path)
    assert results["OFF"]["least"] < 1.0
    flown = results["RLCAS"]
    assert flown["least"] >= 5.0
    assert flown["climb"] == 0.0
    assert flown["turned_below"] < 1.0, "an aircraft 9000 ft below is in no conflict"
    assert abs(flown["course"] - 90.0) < 5.0, (
        "past the conflict the aircraft flies its course again"
    )
    assert not [text for text in flown["said"] if text.startswith("RLCAS")]
    assert results["off_for_all"]["least"] < 1.0, "RESOOFF holds"

    assert flown["planned"] == 0
    by_plan = results["plans"]
    assert by_plan["planned"] >= 2
    assert by_plan["least"] >= 5.0
    assert abs(by_plan["course"] - 90.0) < 5.0

    amid, lake = results["areas"], results["areas"]["lake"]
    assert from_lake(by_plan["path"], lake) < 0.1, "without the command plans take no account"
    assert from_lake(amid["path"], lake) >= 4.0
    assert amid["least"] >= 5.0
    assert not [text for text in amid["said"] if text.startswith("RLCAS:")]
    says = [text for text in results["wide area"]["said"] if text.startswith("RLCAS:")]
    assert len(says) == 1
    assert "has 1 of its 2 points where areas or their clearances forbid flight" in says[0]

    for method in ("policy in wind", "plans in wind"):
        flown = results[method]
        assert flown["blown"] > 40.0
        assert flown["least"] >= 5.0, method
        assert abs(flown["course"] - 90.0) < 5.0
        assert abs(flown["course"] - flown["track"]) > 5.0, "the wind carries it"
    assert results["plans in wind"]["planned"] >= 2

    unknown = [text for text in results["unknown"]["said"] if text.startswith("RLCAS")]
    assert len(unknown) == 1
    assert "XQ99" in unknown[0]
    assert "B744" in unknown[0]

    outside = [text for text in results["outside"]["said"] if text.startswith("RLCAS")]
    assert len(outside) == 1, "what is not flown is said once"
    assert "outside_domain" in outside[0], "for a zone of 1 NM an A320 is too sluggish"
    assert results["outside"]["resolving"] == 0
    assert results["allowed"]["resolving"] == 2


def both_lost(rows: list[list[float]]) -> list[list[float]]:
    """Return the rows in which two aircraft are nearer than 5 NM and 1000 ft."""
    return [row for row in rows if row[0] < 5.0 and abs(row[1] - row[2]) < 1_000.0]


def test_aircraft_in_bluesky_climb_and_descend_out_of_a_conflict(tmp_path: Path):
    results = run(CLIMBS, tmp_path)
    for name in ("both", "levels", "climber"):
        rows = results[name]["rows"]
        assert not both_lost(rows), name
        assert not [text for text in results[name]["said"] if text.startswith("RLCAS:")]
        # They come back to their altitudes and courses.
        assert abs(rows[-1][1] - 30_000.0) < 1.0
        assert results[name]["course"] == pytest.approx([90.0, 270.0], abs=1.0)
    rows_of_both = results["both"]["rows"]
    assert max(abs(row[3]) + abs(row[4]) for row in rows_of_both) < 0.1, "they stay on their routes"
    assert min(row[0] for row in rows_of_both) < 0.1
    assert 1_000.0 < max(abs(row[1] - row[2]) for row in rows_of_both) < 5_000.0
    assert max(row[1] for row in rows_of_both) > 30_300.0, "of two the first one climbs"
    assert max(row[1] for row in results["levels"]["rows"]) <= 30_200.0, "not above the ceiling"
    assert abs(results["climber"]["rows"][-1][2] - 33_000.0) < 1.0, "it does not avoid anybody"

    by_line = {line: (text, state) for line, text, state in results["switches"]}
    assert by_line["RLCASMANEUVERS"] == ("RLCASMANEUVERS is BOTH", "BOTH")
    text, state = by_line["RLCASMANEUVERS UP"]
    assert "expected HORIZONTAL, VERTICAL, BOTH" in text and state == "BOTH"
    assert by_line["RLCASLEVELS"][0] == "RLCASLEVELS are -inf to inf m"
    assert "expected less than 6096 m" in by_line["RLCASLEVELS FL300 FL200"][0]
    assert by_line["RLCASMANEUVERS both"][1] == "BOTH"


def test_the_pilot_flies_the_environment_of_bluesky_gym(tmp_path: Path):
    results = run(GYM, tmp_path)
    assert results["wrong"] < 0.02, "what is read from an observation is the state of the simulator"
    assert sum(results["free"]) >= 3
    assert results["drift"] < 0.36, "less than in the environment's authors' log of their DDPG, rad"


def test_rotorcraft_and_switches_in_bluesky(tmp_path: Path):
    results = run(ROTORCRAFT, tmp_path)
    separation = 1.05 * 1852.0
    for kind, fastest in (("EC35", 71.95), ("M600", 18.0)):
        refused, allowed = results[kind]
        reasons = [text for text in refused["said"] if "flies on without" in text]
        assert reasons and f"({kind})" in reasons[0]
        assert "outside_domain: " in reasons[0], "the reason is the family, not limits of 0 m/s"
        assert refused["least"] < 0.5 * separation
        assert allowed["least"] >= 0.97 * separation, kind
        assert allowed["fastest"] <= fastest + 0.01 and allowed["slowest"] >= 0.0

    by_line = [
        (line, texts[0] if texts else "", *state) for line, texts, *state in results["switches"]
    ]
    assert by_line == [
        ("RLCASPLAN", by_line[0][1], False, "refuse"),
        ("RLCASPLAN ON", by_line[1][1], True, "refuse"),
        ("RLCASPLAN", by_line[2][1], True, "refuse"),
        ("RLCASPLAN OFF", by_line[3][1], False, "refuse"),
        ("RLCASPLAN maybe", by_line[4][1], False, "refuse"),
        ("RLCASOUTSIDE ON", by_line[5][1], False, "allow"),
        ("RLCASOUTSIDE OFF", by_line[6][1], False, "refuse"),
        ("RLCASOUTSIDE", by_line[7][1], False, "refuse"),
        ("RLCASPLAN 1", by_line[8][1], True, "refuse"),
        ("RLCASPLAN 0", by_line[9][1], False, "refuse"),
    ]
    assert "RLCASPLAN is OFF" in by_line[0][1] and "RLCASPLAN is ON" in by_line[2][1]
    assert "RLCASOUTSIDE is OFF" in by_line[7][1]
    assert "RLCASPLAN is" not in by_line[4][1], "a wrong word is refused"

    echoed, states = zip(*results["areas"], strict=True)
    assert states == (False, True, True, True, False, False)
    assert "RLCASAREAS is OFF" in echoed[0] and "RLCASAREAS is ON" in echoed[2]
    assert "RLCASAREAS is" not in echoed[3], "a wrong word is refused"


def test_the_window_s_scenario_is_the_encounter_of_the_headless_one():
    def encounter(name: str) -> list[str]:
        lines = (ROOT / "eval" / "bluesky" / name).read_text(encoding="utf-8").splitlines()
        return [line for line in lines if line.startswith("00:00:00.00>")][:7]

    scenarios = encounter("head_on.scn"), encounter("head_on_headless.scn")
    assert scenarios[0] == scenarios[1]
    assert sum(">CRE " in line for line in scenarios[0]) == 3


def test_the_page_s_scenario_flies_in_a_new_home(tmp_path: Path):
    """The commands of docs/howto/bluesky.md, on a machine on which BlueSky was never started."""
    page = (ROOT / "docs" / "howto" / "bluesky.md").read_text(encoding="utf-8")
    block = page.split("```sh\n")[1].split("```")[0]
    commands = "\n".join(line for line in block.splitlines() if "make bluesky" not in line)
    process = subprocess.run(
        ["bash", "-ec", commands],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=os.environ | {"HOME": str(tmp_path), "PYTHONPATH": str(ROOT)},
    )
    assert process.returncode == 0, process.stderr
    (log,) = (tmp_path / "bluesky" / "output").glob("PLACES_*.log")
    rows = [line.split(",") for line in log.read_text().splitlines() if not line.startswith("#")]
    names = {row[1].strip() for row in rows}
    assert names == {"WEST", "EAST", "SOUTH"}
    places: dict[str, dict[str, complex]] = {}
    for time, name, latitude, longitude, *_ in rows:
        places.setdefault(time, {})[name.strip()] = (
            complex(float(longitude), float(latitude)) * 60.0
        )
    pairs = [("WEST", "EAST"), ("WEST", "SOUTH"), ("EAST", "SOUTH")]
    together = [at for at in places.values() if len(at) == 3]
    assert len(together) > 60
    assert min(abs(at[a] - at[b]) for at in together for a, b in pairs) >= 5.0  # NM
