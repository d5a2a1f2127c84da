"""Closed-loop properties that were stated for ACAS Xu's networks, on the policy and its plans.

    python -m benchmarks.closed_loop [--samples 100] [--networks DIR] [--only NAME] [--policy FILE]

*Properties*: ten encounters of Lopez, Johnson, Bak, Tran and Hobbs, "Evaluation of Neural Network
Verification Methods for Air-to-Air Collision Avoidance", Journal of Air Transportation 31(1), 2023
(states: ``main/ReachTestPoints_JATrevs.m`` and ``ReachTestPoint2.m`` of github.com/mldiego/AcasXu
at a22c1d6; speeds: its ``dyns_tp*.m``). The ownship's place is uncertain by 100 ft to either side
on both axes; the intruder must never be nearer than 500 ft.

*Counterexamples*: six starts from which the networks come nearer than 500 ft: Bak and Tran,
"Neural Network Compression of ACAS Xu Early Prototype is Unsafe", NASA Formal Methods 2022
(``replay.py`` of github.com/stanleybak/quantized_nn_backreach at 502eddb); nothing is uncertain.

Our aircraft turns at up to 3 deg/s, as ACAS Xu's advisories do, and may change its speed a little.
It keeps 4000 ft, or more where so fast an aircraft of the policy's family needs more: a separation
that holds implies the property. Every start is flown to a goal straight ahead:

- *policy*: the network alone, from every corner of the box and from random places in it;
- *plan*: one plan, made with the whole box as the intruder's error. Where it is SAFE, the
  separation is proven for every place in the box, and ``agents.check`` accepts its certificate;
- *assured*: the run-time monitor and its plans, from the same places;
- *acas_xu*: the networks themselves, where ``--networks`` names a folder with them (files
  ``*run2a_1_1*.nnet`` to ``*run2a_5_1*.nnet``), once a second as in the sources. Unlike there they
  begin *clear of conflict*, and turn back to the goal where that is clear.

The last line is one JSON object.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.acas_nnet import load_logic
from agents.baselines.baselines import StepResolver
from agents.check import RefusedError, accept
from agents.kernel.traffic import Requirement
from agents.planner import Intruder, Options, plan
from agents.planner.request.encounters import route_of
from agents.policy.inference import Policy
from benchmarks.measure import report
from commands.command import InputError, Parser, run_cli, whole
from commands.json_text import parse_json
from envs.aircraft import Aircraft, new_aircraft
from envs.encounters import Encounter
from envs.frames import Air, Ground
from envs.intruder import Intent
from envs.kinematics import Limits, VehicleState
from envs.perception import Sensor
from envs.trees import map_leaves
from envs.waypoints import RoutePoint
from eval.flights.chunks import Conditioned, Evaluation, ReadyEvaluation
from eval.flights.recorded import fly_in_mode
from eval.flights.simulate import ByPolicy, fly

FOOT = 0.3048  # m
COLLISION = 500.0 * FOOT
"""Distance that must not be undercut, m."""

_SEPARATION = 4000.0 * FOOT  # that is kept at least: DO-365's horizontal distance of well clear
_BOX = 100.0 * FOOT  # half a side, of the properties
_CRUISE = 0.9  # own speed of a start, in the aircraft's greatest
_SLOWEST = 0.5  # in the greatest
_ACCELERATION = 0.03  # V^2/D, the least of the policy's family
_WIDEST_TURN = 2.5  # D, the greatest radius of the family
_TURN_RATE = math.radians(3.0)
_GOAL = 15.0  # D ahead
_SIGMAS = 2.0
_NETWORKS_DT = 1.0  # s between two decisions of the networks


class Start(NamedTuple):
    """One encounter, in the sources' units: ft, ft/s, rad counter-clockwise from east."""

    name: str
    own: tuple[float, float, float]  # x, y, heading
    intruder: tuple[float, float, float]
    own_speed: float
    intruder_speed: float
    box: float = 0.0  # half a side of the ownship's places, m


def _property(number: int, own: Any, intruder: Any, speeds: tuple[float, float]) -> Start:
    return Start(f"property {number}", own, intruder, *speeds, _BOX)


def _counterexample(name: str, state: tuple[float, float, float, float, float, float]) -> Start:
    """Return a start from own place and velocity, and an intruder that flies east along y = 0."""
    x, y, vx, vy, intruder_x, intruder_speed = state
    own = x, y, math.atan2(vy, vx)
    return Start(name, own, (intruder_x, 0.0, 0.0), math.hypot(vx, vy), intruder_speed)


_NORTH = math.pi / 2.0
STARTS = (
    _property(1, (0.0, 43020.0, _NORTH), (-24493.37, 42001.92, 1.141196), (954.6, 1050.0)),
    _property(2, (0.0, 10186.0, _NORTH), (0.0, -23936.0, _NORTH), (462.6, 900.0)),
    _property(3, (0.0, 27000.0, _NORTH), (11817.30, 19580.02, 1.932496), (100.0, 200.0)),
    _property(4, (0.0, 2457.12, _NORTH), (-27214.96, -24756.06, 1.029296), (204.9, 600.0)),
    _property(5, (0.0, 126066.48, _NORTH), (-6322.86, 132385.57, 1.332896), (362.3, 300.0)),
    _property(6, (0.0, 15834.0, _NORTH), (32364.59, 15841.12, 2.193396), (609.3, 750.0)),
    _property(7, (0.0, 48090.0, _NORTH), (46873.84, 67543.25, 2.354296), (1145.9, 1145.0)),
    _property(8, (0.0, 21630.8, _NORTH), (20411.04, 42040.20, 2.328496), (636.2, 450.0)),
    _property(9, (0.0, 12936.56, _NORTH), (0.0, 45296.0, _NORTH), (497.4, 60.0)),
    _property(10, (0.0, 25200.0, _NORTH), (0.0, 94800.0, -_NORTH), (600.0, 600.0)),
    _counterexample(
        "slow intruder",
        (-5360.83116819, 7007.87669426, -65.21523383, -89.63417501, -40570.74242582, 390.10329256),
    ),
    _counterexample(
        "fast ownship",
        (
            -27057.6501092,
            -12592.0447243,
            603.16465115,
            642.90403234,
            -43196.89512824,
            1199.91375356,
        ),
    ),
    _counterexample(
        "first found",
        (-2902.79886, -6471.59328, -49.5421358, 131.385216, -64565.3252, 1113.19526),
    ),
    _counterexample(
        "networks cause it",
        (-5149.45097, 2351.45935, 109.259575, 33.4857199, -61617.5354, 1100.31313),
    ),
    _counterexample(
        "left turn",
        (-705.16444772, -6179.58516646, -64.9755391, 107.38901002, -61684.98415307, 1163.86762553),
    ),
    _counterexample(
        "vertical time 75 s",
        (-45046.6117, -41389.4837, -23.674116, 963.767938, -89882.8125, 1198.4375),
    ),
)
"""Encounters of both sources."""


def aircraft_of(start: Start, dt: float | None = None) -> Aircraft:
    """Return the aircraft that flies a start, of the policy's family; time step in s, None: that
    of the family.
    """
    top = start.own_speed * FOOT / _CRUISE
    separation = max(_SEPARATION, top / _TURN_RATE / _WIDEST_TURN)
    acceleration = _ACCELERATION * top * top / separation
    limits = Limits(_SLOWEST * top, top, -acceleration, acceleration, _TURN_RATE)
    return new_aircraft(limits, separation, dt=dt)


def places(start: Start, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Return offsets of the ownship's place, m, ``[N, 2]``: none, the corners of the box, and
    random ones; without a box the one that is none.
    """
    if start.box == 0.0:
        return np.zeros((1, 2))
    corners = np.array([(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    drawn = rng.uniform(-1.0, 1.0, (samples, 2))
    return start.box * np.concatenate([np.zeros((1, 2)), corners, drawn])


def encounters_of(start: Start, offsets: np.ndarray, aircraft: Aircraft) -> Encounter:
    """Return the encounters of a start with offsets of the ownship's place, ``[N, 2]``, m."""
    count = len(offsets)
    x, y, heading = start.own
    own = VehicleState[Air](
        x * FOOT + offsets[:, 0],
        y * FOOT + offsets[:, 1],
        np.full(count, heading),
        np.full(count, start.own_speed * FOOT),
    )
    ahead = _GOAL * aircraft.separation
    x, y, heading = start.intruder
    values = x * FOOT, y * FOOT, heading, start.intruder_speed * FOOT
    intruders = VehicleState[Air](*(np.full((count, 1), value) for value in values))
    never = np.zeros((count, 1))
    return Encounter(
        own=own,
        goal_x=own.x + ahead * np.cos(own.heading),
        goal_y=own.y + ahead * np.sin(own.heading),
        intruders=intruders,
        mask=np.ones((count, 1), dtype=bool),
        intent=Intent(never, never, never + aircraft.limits.yaw_rate_max),
        sensor=map_leaves(lambda value: np.full((count, 1), value), Sensor()),
    )


class Loop(NamedTuple):
    """What became of the flights of a start."""

    nearest: float  # m, to the intruder
    lost: int  # flights below the separation kept
    collisions: int  # flights below 500 ft
    arrived: int


def judge(min_separation: np.ndarray, reached: np.ndarray, aircraft: Aircraft) -> Loop:
    """Return what became of flights from their smallest separations, m, ``[N]``."""
    return Loop(
        float(min_separation.min()),
        int((min_separation < aircraft.separation).sum()),
        int((min_separation < COLLISION).sum()),
        int(reached.sum()),
    )


def fly_resolver(encounters: Encounter, resolver: StepResolver, aircraft: Aircraft) -> Loop:
    """Fly encounters by what decides once a time step; flights go on after a loss."""
    flown = fly(encounters, resolver, aircraft, endless=True)
    return judge(flown.min_separation, flown.outcome == 0, aircraft)


def fly_assured(encounters: Encounter, policy: Policy, aircraft: Aircraft) -> Loop:
    """Fly encounters by the monitor and its plans."""
    evaluation = Evaluation(None, encounters, None, 0, aircraft, mode="assured")
    ready = ReadyEvaluation(evaluation, policy)
    _, flown = fly_in_mode(ready, Conditioned(encounters, None), None, endless=True)
    return judge(flown.min_separation, flown.outcome == 0, aircraft)


class Proof(NamedTuple):
    """One plan for the whole box."""

    status: str
    certificate: bool | None  # whether the checker accepts it; None: there is none


def prove(start: Start, policy: Policy, aircraft: Aircraft) -> Proof:
    """Plan with the box as the error of the intruder's place: seen from the aircraft, wherever it
    is in the box, the intruder is somewhere in a box about its place.
    """
    encounter = encounters_of(start, np.zeros((1, 2)), aircraft)
    own = VehicleState[Ground](*(float(field[0]) for field in encounter.own))  # the air is still
    state = VehicleState[Ground](*(float(field[0, 0]) for field in encounter.intruders))
    reach = math.hypot(start.box, start.box)
    intruder = Intruder(state, position_std=reach / _SIGMAS)
    requirement = Requirement(aircraft.separation, 2e-5 * aircraft.separation, _SIGMAS)
    options = Options.for_aircraft(aircraft, requirement=requirement, deadline_s=5.0)
    x, y, _ = route_of(encounter.own, encounter.goal_x, encounter.goal_y, aircraft)
    ahead = zip(x[0, 1:].tolist(), y[0, 1:].tolist(), strict=True)  # without the start
    route = [RoutePoint(n, *place) for n, place in enumerate(ahead)]
    answer = plan(own, [intruder], route, policy, options)
    text = answer.certificate
    if text is None:
        return Proof(answer.status.name, None)
    try:
        accept(parse_json(text))
    except RefusedError:
        return Proof(answer.status.name, False)
    return Proof(answer.status.name, True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all starts and print the table."""
    parser = Parser(prog="python -m benchmarks.closed_loop", description=__doc__)
    add = parser.add_argument
    add(
        "--samples",
        type=whole(1),
        default=100,
        help="random places of the ownship in each property's box (default 100)",
    )
    add("--seed", type=whole(0), default=0, help="seed of the places (default 0)")
    add("--policy", type=Path, help="policy file (default: the one that ships)")
    add("--networks", type=Path, help="folder of ACAS Xu's networks, .nnet, which are flown too")
    names = [start.name for start in STARTS]
    add("--only", metavar="NAME", choices=names, help=f"one of {', '.join(names)}")
    options = parser.parse_args(arguments)
    shipped, rng = Policy.load(options.policy), np.random.default_rng(options.seed)
    network = None if options.networks is None else first_network(options.networks)
    rows = []
    for start in STARTS:
        if options.only not in (None, start.name):
            continue
        aircraft = aircraft_of(start)
        policy = shipped.for_aircraft(aircraft)
        encounters = encounters_of(start, places(start, options.samples, rng), aircraft)
        row: dict[str, Any] = {
            "start": start.name,
            "separation_m": round(aircraft.separation),
            "flights": len(encounters.goal_x),
            "policy": fly_resolver(encounters, ByPolicy(policy), aircraft)._asdict(),
            "plan": prove(start, policy, aircraft)._asdict(),
            "assured": fly_assured(encounters, shipped, aircraft)._asdict(),
        }
        if network is not None:
            each_second = aircraft_of(start, _NETWORKS_DT)
            logic = load_logic(network, each_second)
            row["acas_xu"] = fly_resolver(encounters, logic, each_second)._asdict()
        rows.append(row)
        print(text_of(row))
    report({"benchmark": "closed_loop", "policy": shipped.sha256, "rows": rows}, ("numpy",))
    return 0


def text_of(row: dict[str, Any]) -> str:
    """Return a row of the table: smallest distances over the separation kept."""
    separation = row["separation_m"]
    loops = [name for name in ("policy", "assured", "acas_xu") if name in row]
    parts = [
        f"{name} {row[name]['nearest']:7.0f} m, {row[name]['lost']:4} lost, "
        f"{row[name]['collisions']:4} below 500 ft"
        for name in loops
    ]
    proof = row["plan"]
    proven = "proven" if proof["certificate"] else proof["status"].lower()
    return f"{row['start']:18} keeps {separation:5} m  {'  '.join(parts)}  plan {proven}"


def first_network(folder: Path) -> Path:
    """Return the file of the network that follows *clear of conflict*; InputError: none, or
    several.
    """
    files = sorted(folder.glob("*run2a_1_1*.nnet"))
    if len(files) != 1:
        raise InputError(
            f"--networks: {folder} has {len(files)} files *run2a_1_1*.nnet; expected one"
        )
    return files[0]


if __name__ == "__main__":
    run_cli(main)
