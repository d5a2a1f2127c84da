"""The monitor beside the runner on a real graph: it watches, asks for new plans, and does without
the runner.
"""

import math
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

from tests.ros_bridge.graph import MISSING, NODE, PATIENCE, Client, Process, World, domain

pytest.importorskip("rclpy", reason=MISSING)

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rlcas_msgs.msg import AircraftState, AssuranceStatus, GuidanceBands, TrafficAlert, Trajectory
from rlcas_msgs.srv import GenerateTrajectory

from envs.waypoints import Legs, at, legs, plan_states
from ros_bridge.core.assurance import read_plan as plan_of
from ros_bridge.core.replies import to_frame
from ros_bridge.transport import qos
from tests.ros_bridge.scenes import EXACT, FRAME, THRESHOLDS

WATCHER = "/rlcas_monitor"


class Flight:
    """An ownship that flies its plan exactly, an intruder that flies straight, and what the monitor
    says of it.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.runner = Process("ros_bridge.runner", number)
        self.monitor = Process("ros_bridge.monitor", number)
        self.client = Client(number)
        self.world = World(self.client)
        self.says: list[AssuranceStatus] = self.client.hear(
            AssuranceStatus, f"{WATCHER}/output/status", qos.LATCHED
        )
        self.plans: list[Trajectory] = self.client.hear(
            Trajectory, f"{NODE}/output/trajectory", qos.LATCHED
        )
        self.backups: list[Trajectory] = self.client.hear(
            Trajectory, f"{WATCHER}/output/backup", qos.LATCHED
        )
        self.shown: list[GuidanceBands] = self.client.hear(
            GuidanceBands, f"{WATCHER}/output/guidance", qos.LATCHED
        )
        self.legs: Legs | None = None
        self.began = self.revision = 0
        self.zero = self.client.now()
        # Ahead and to the left, flying away to the north.
        self.intruder = (9_000.0, 8_000.0, 0.5 * math.pi, self.zero)
        self.other: tuple[float, float, float, int] | None = None
        self.own = True

    def close(self) -> None:
        self.client.close()
        self.monitor.stop()
        self.runner.stop()

    def tick(self) -> None:
        """Publish everybody's state, listen for a tenth of a second and fly the newest plan."""
        if self.own:
            now = self.client.now()
            if self.legs is None:
                state = (75.0 * (now - self.zero) / 1e9, 0.0, 0.0, 75.0)
            else:
                state = tuple(
                    float(value) for value in at(self.legs, np.float64((now - self.began) / 1e9))
                )
            # In a wind that it knows, so that it may turn as it can.
            self.world.ownship(*state, time=now, valid=EXACT | AircraftState.VALID_WIND)
        self.report()
        self.client.idle(0.1)
        if (
            self.plans
            and self.plans[-1].status == Trajectory.STATUS_SAFE
            and self.plans[-1].revision > self.revision
        ):
            published = plan_of(self.plans[-1], THRESHOLDS)
            own, waypoints = to_frame(FRAME, published)
            self.legs, self.began, self.revision = (
                legs(plan_states(own, waypoints)),
                published.began,
                published.revision,
            )

    def report(self) -> None:
        for identity, flying in (("4b1a2c", self.intruder), ("new001", self.other)):
            if flying is not None:
                x, y, heading, since = flying
                now = self.client.now()
                reach = 75.0 * (now - since) / 1e9
                place = (x + reach * math.cos(heading), y + reach * math.sin(heading))
                self.world.intruder(*place, heading, time=now, id=identity)

    def until(self, *, state: int) -> AssuranceStatus:
        """Fly until the monitor is in a state."""
        end = time.monotonic() + PATIENCE
        while not (self.says and self.says[-1].state == state):
            assert time.monotonic() < end, (
                f"the monitor is in {self.says[-1].state if self.says else None}"
            )
            self.tick()
        return self.says[-1]

    def plan(self) -> None:
        """Ask until there is a plan that takes account of the intruder."""
        while True:
            self.tick()
            request = GenerateTrajectory.Request(reason=GenerateTrajectory.Request.REASON_MANUAL)
            response = self.client.call(GenerateTrajectory, f"{NODE}/generate_trajectory", request)
            if response.status == response.STATUS_SAFE and list(response.trajectory.intruder_ids):
                return

    def turn(self, heading: float) -> None:
        """Let the intruder fly another way from here on."""
        x, y, before, since = self.intruder
        now = self.client.now()
        reach = 75.0 * (now - since) / 1e9
        self.intruder = (x + reach * math.cos(before), y + reach * math.sin(before), heading, now)

    def place(self, later: float = 0.0) -> tuple[float, float, float]:
        """Return where the plan is some seconds from now."""
        assert self.legs is not None
        state = at(self.legs, np.float64((self.client.now() - self.began) / 1e9 + later))
        return float(state.x), float(state.y), float(state.heading)


@pytest.fixture
def flight() -> Iterator[Flight]:
    with domain() as number:
        flight = Flight(number)
        try:
            flight.world.reference()
            flight.world.route()
            yield flight
        finally:
            flight.close()


def time_to_backup(flight: Flight) -> float:
    """Kill the runner, let an aircraft come head on, and return the time from its report to the
    backup, s.
    """
    flight.runner.stop(signal.SIGKILL)
    for _ in range(5):
        flight.tick()
    assert flight.says[-1].state == AssuranceStatus.STATE_MONITORING
    x, y, heading = flight.place()
    began = flight.client.now()
    ahead = (x + 1_600.0 * math.cos(heading), y + 1_600.0 * math.sin(heading))
    flight.world.intruder(*ahead, heading + math.pi, id="new001", time=began)
    flight.client.spin(lambda: flight.says[-1].fly == AssuranceStatus.FLY_BACKUP)
    stamp = flight.says[-1].header.stamp
    assert flight.says[-1].state == AssuranceStatus.STATE_BACKUP
    flight.client.spin(lambda: flight.backups)
    backup = flight.backups[-1]
    assert backup.status == Trajectory.STATUS_BACKUP and len(backup.waypoints) == 11
    start = FRAME.place(backup.start.latitude, backup.start.longitude)
    assert math.hypot(float(start.x) - x, float(start.y) - y) < 50.0
    return (stamp.sec * 1_000_000_000 + stamp.nanosec - began) / 1e9


@pytest.mark.slow
def test_monitored_flight_is_saved_without_the_runner(flight: Flight):
    idle = flight.until(state=AssuranceStatus.STATE_IDLE)
    assert (idle.fly, list(idle.reasons)) == (
        AssuranceStatus.FLY_NOTHING,
        ["there is no plan to monitor"],
    )
    # Bands and alerts need no plan.
    while not flight.shown:
        flight.tick()
    assert len(flight.shown[-1].track_region) == 72

    flight.plan()
    status = flight.until(state=AssuranceStatus.STATE_MONITORING)
    assert status.fly == AssuranceStatus.FLY_PLAN
    assert list(status.reasons) == []
    assert status.measured and abs(status.cross_track) < 1.0 and abs(status.along_track) < 5.0
    assert 0.0 <= status.runner_silence < 5.0
    flight.client.spin(lambda: flight.shown and flight.shown[-1].intruder_ids)
    bands = flight.shown[-1]
    assert len(bands.track_deg) == len(bands.track_region) == len(bands.track_loss) == 72
    assert list(bands.intruder_ids) == ["4b1a2c"]
    assert GuidanceBands.REGION_FREE in bands.track_region and bands.recovery == -1
    flight.tick()
    assert flight.says[-1].trajectory_revision == flight.revision

    # Nothing is known of the ownship: the plan is flown on, and not trusted.
    flight.own = False
    status = flight.until(state=AssuranceStatus.STATE_DENIED)
    assert any(reason.startswith("own.age is more than") for reason in status.reasons)
    assert status.fly == AssuranceStatus.FLY_PLAN
    assert not status.measured
    flight.own = True
    flight.until(state=AssuranceStatus.STATE_MONITORING)

    # How soon, the slow test says: other tests run beside this one.
    time_to_backup(flight)
    flight.client.spin(lambda: "new001" in flight.shown[-1].intruder_ids)
    bands = flight.shown[-1]
    level = dict(zip(bands.intruder_ids, bands.intruder_level, strict=True))
    assert level["new001"] == TrafficAlert.LEVEL_WARNING


@pytest.mark.slow
def test_the_backup_is_flown_within_a_fifth_of_a_second(flight: Flight):
    flight.plan()
    flight.until(state=AssuranceStatus.STATE_MONITORING)
    flight.tick()
    assert time_to_backup(flight) <= 0.2


@pytest.mark.slow
def test_monitor_requests_plans_and_finds_a_new_runner(flight: Flight):
    flight.plan()
    flight.until(state=AssuranceStatus.STATE_MONITORING)
    flight.tick()

    # The intruder turns back, towards the path; nobody but the monitor asks for a new plan.
    before, begun = flight.revision, time.monotonic()
    while flight.revision == before:
        turning = time.monotonic() - begun
        assert turning < PATIENCE, "no new plan was asked for"
        flight.turn(0.5 * math.pi - min(0.05 * turning, math.pi))
        flight.tick()
    assert AssuranceStatus.STATE_REPLAN_REQUESTED in {
        monitor_status.state for monitor_status in flight.says
    }
    flight.until(state=AssuranceStatus.STATE_MONITORING)
    flight.tick()
    assert flight.says[-1].trajectory_revision == flight.revision > before

    # The runner dies; against an aircraft that will be met in a minute nobody plans, until there is
    # a new one.
    flight.runner.stop(signal.SIGKILL)
    last, (x, y, heading) = flight.revision, flight.place(60.0)
    ahead = (x + 60.0 * 75.0 * math.cos(heading), y + 60.0 * 75.0 * math.sin(heading))
    flight.other = (*ahead, heading + math.pi, flight.client.now())
    flight.until(state=AssuranceStatus.STATE_BACKUP)
    assert any(
        "planner has not answered within 3 s" in monitor_status.reasons
        for monitor_status in flight.says
    )
    flight.runner = Process("ros_bridge.runner", flight.number)
    status = flight.until(state=AssuranceStatus.STATE_MONITORING)
    assert status.trajectory_revision > last


@pytest.mark.slow
def test_a_withdrawn_plan_is_not_flown(flight: Flight):
    flight.plan()
    flight.until(state=AssuranceStatus.STATE_MONITORING)
    change = ChangeState.Request()
    change.transition.id = Transition.TRANSITION_DEACTIVATE
    assert flight.client.call(ChangeState, f"{NODE}/change_state", change, once=True).success
    end = time.monotonic() + 3.0
    while flight.says[-1].fly != AssuranceStatus.FLY_BACKUP:
        assert time.monotonic() < end, "the plan is flown on"
        flight.tick()
    assert flight.says[-1].trajectory_revision == 0
