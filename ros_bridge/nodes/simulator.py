"""The simulator: an ownship and intruders, their reports as receivers have them, the clock, and the
flight of plans.

    python -m ros_bridge.simulator [--ros-args -p scenario:=head_on -p vehicle:=c208
        -p rate:=50.0 ...]

It stands for everything around runner and monitor, which must run with use_sim_time, in the same
namespace:

    out   /clock                               rosgraph_msgs/Clock         a tick is 0.1 s
          rlcas_runner/input/ownship           rlcas_msgs/AircraftState    at its receiver's rate
          rlcas_runner/input/traffic           rlcas_msgs/AircraftState    at its receiver's rate
          rlcas_runner/input/alerts            rlcas_msgs/TrafficAlert     every second of an alert
          rlcas_runner/input/route             rlcas_msgs/Trajectory       latched
          rlcas_runner/input/geo_reference     rlcas_msgs/GeoReference     latched
          rlcas_runner/input/areas             rlcas_msgs/Areas            latched, where there are
    in    rlcas_runner/output/trajectory       rlcas_msgs/Trajectory
          rlcas_monitor/output/status          rlcas_msgs/AssuranceStatus
          rlcas_monitor/output/backup          rlcas_msgs/Trajectory
          /diagnostics                         of the runner: that it has noticed a new clock
    calls rlcas_runner/generate_trajectory     when the alert begins, and again without a plan

Each encounter begins with a clock that steps back, which makes both nodes forget the one before.
The clock never runs ahead of the monitor's status by more than two ticks, and while a plan is asked
for it keeps to deciding_rate: what answers cost in time, they cost in flight. Without --ros-args -p
encounters:=N one encounter is flown; then the table is printed, and the exit code is 0 if plans
called SAFE were flown and every one kept the separation, else 1. Parameters:
"""

import math
import time
from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock as WallClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rlcas_msgs.msg import AssuranceStatus, GeoReference, TrafficAlert, Trajectory
from rlcas_msgs.srv import GenerateTrajectory
from rosgraph_msgs.msg import Clock

from envs.areas import Area
from envs.encounters import Encounter
from envs.follower import PERIOD
from envs.formats.local_frame import LocalFrame
from envs.wind import Wind
from ros_bridge.core.fields import SECOND, Code, FieldError, nanoseconds
from ros_bridge.nodes.simulator_messages import route_of, state_message
from ros_bridge.sim.flight_log import FlightLog
from ros_bridge.sim.guidance import Guidance, curve
from ros_bridge.sim.receivers import Quality, Receiver
from ros_bridge.sim.world import OWN, EncounterFlight, SimulationError, Truth, check_installed
from ros_bridge.transport import topics
from ros_bridge.transport.messages import areas_message, header, time_message
from ros_bridge.transport.settings import declare, limits_of

if TYPE_CHECKING:
    from rclpy.task import Future

    from envs.c208.flightgear import FlightGear

_START = 1_000 * SECOND  # at which every clock begins
_TICK = round(PERIOD * SECOND)
_AHEAD = 2 * _TICK  # by which the clock may run ahead of the monitor
_PATIENCE = 1.0  # s of real time without the monitor, after which it is waited for no longer
_COME_UP = 30.0  # s of real time in which both nodes must have come up
_ALERT_AGAIN = 1.0  # s
_SOURCES = {
    Trajectory.SOURCE_POLICY: "policy",
    Trajectory.SOURCE_FALLBACK: "fallback",
    Trajectory.SOURCE_VERTICAL: "vertical",
}


class _Phase(Enum):
    IDLE = 0
    SETTLING = 1  # the clock has stepped back, and the nodes have not noticed yet
    FLYING = 2


class Simulator(Node):
    """The node; the world is :mod:`ros_bridge.sim.world`, its receivers
    :mod:`ros_bridge.sim.receivers`.
    """

    def __init__(self, **more: Any) -> None:
        super().__init__("rlcas_simulator", **more)
        aircraft = declare(self, "simulator")
        assert aircraft is not None
        self.aircraft = aircraft  # the ownship and its task
        self._frame = LocalFrame(self._value("origin_latitude"), self._value("origin_longitude"))
        self._monitored = bool(self._value("monitor"))
        check_installed(self._value("vehicle"))
        self._viewer = self._make_viewer()
        self.logs: list[FlightLog] = []  # of the encounters flown so far
        self._phase = _Phase.IDLE
        self._flight: EncounterFlight | None = None
        self._clock = _START
        self._since = self._last = time.perf_counter()
        self._forget()

        self._clocks = self.create_publisher(*topics.CLOCK)
        self._own = self.create_publisher(*topics.OWNSHIP)
        self._traffic = self.create_publisher(*topics.TRAFFIC)
        self._alerts = self.create_publisher(*topics.ALERTS)
        self._routes = self.create_publisher(*topics.ROUTE)
        self._origins = self.create_publisher(*topics.GEO_REFERENCE)
        self._area_lists = self.create_publisher(*topics.AREAS)
        self._client = self.create_client(GenerateTrajectory, topics.SERVICE)
        topics.PLAN.subscribe(self, self._on_trajectory)
        topics.STATUS.subscribe(self, self._on_status)
        topics.BACKUP.subscribe(self, self._on_backup)
        topics.DIAGNOSTICS.subscribe(self, self._on_diagnostics)
        # The wall's clock: the simulated one does not go on by itself.
        self.create_timer(
            PERIOD / max(self._value("rate"), self._value("deciding_rate")),
            self._on_timer,
            clock=WallClock(clock_type=ClockType.STEADY_TIME),
        )

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _make_viewer(self) -> "FlightGear | None":
        """Return the FlightGear that shows the flight; None: none is asked for."""
        address, kind = self._value("flightgear"), self._value("vehicle")
        if not address:
            return None
        if kind != "c208":
            raise ValueError(f"flightgear: vehicle is {kind}, expected c208, which JSBSim flies")
        from envs.c208.flightgear import flightgear_at

        return flightgear_at(address, paced=False)  # the timer is the pace

    def _forget(self) -> None:
        """Forget what belongs to the encounter before."""
        self._guidance = Guidance(monitored=self._monitored)
        self._following = b""
        self._runner_heard = 0
        self._asking: Future[GenerateTrajectory.Response] | None = None
        self._asked_at = -math.inf
        self._alert_at = -math.inf

    # Encounters.

    @property
    def flying(self) -> bool:
        """Whether an encounter is being flown."""
        return self._phase is not _Phase.IDLE

    @property
    def now(self) -> int:
        """The simulated time, ns."""
        return self._clock

    def begin(
        self,
        encounter: Encounter,
        name: str,
        seed: int = 0,
        areas: Sequence[Area] | None = None,
    ) -> None:
        """Begin an encounter, one with own fields ``[1]``; :attr:`flying` becomes false when it is
        over.

        Areas are those of its local frame at its beginning; None: what was sent before stays.
        One that cannot be flown is over at once, and its log holds the reason.
        """
        try:
            kind, limits = self._value("vehicle"), limits_of(self._value)
            wind = Wind(self._value("wind_east"), self._value("wind_north"))
            self._flight = EncounterFlight(
                encounter, self.aircraft, limits, kind, self._viewer, wind, areas or ()
            )
        except SimulationError as error:
            self.logs.append(FlightLog(name, self._value("separation"), failure=str(error)))
            return
        self._sends_areas = areas is not None
        own, traffic = self._qualities(encounter)
        self._receivers = Receiver(own, 2 * seed), Receiver(traffic, 2 * seed + 1)
        self._log = FlightLog(name, self._value("separation"))
        self._forget()
        self._clock = _START
        self._phase, self._since = _Phase.SETTLING, time.perf_counter()
        self._routes.publish(route_of(self._flight, self._frame, self.aircraft.separation))
        self._origins.publish(
            GeoReference(latitude=self._frame.latitude, longitude=self._frame.longitude)
        )

    def _qualities(self, encounter: Encounter) -> tuple[Quality, Quality]:
        """Return those of the ownship's reports and of the traffic's."""
        own, traffic = (
            Quality(*(self._value(f"{kind}_{name}") for name in Quality._fields))
            for kind in ("own", "traffic")
        )
        # A scenario with sensors of its own is not flown with better ones.
        sensor = encounter.sensor
        worse = traffic._replace(
            latency=max(traffic.latency, float(sensor.latency[0, 0])),
            position_std=max(traffic.position_std, float(sensor.position_std[0, 0])),
            velocity_std=max(traffic.velocity_std, float(sensor.velocity_std[0, 0])),
        )
        return own, worse

    def _on_timer(self) -> None:
        if self._phase is _Phase.IDLE:
            return
        wall = time.perf_counter()
        rate = self._value("deciding_rate" if self._is_deciding() else "rate")
        rate = rate if self._viewer is None else min(rate, 1.0)
        # Timers beat a little early or late; the mean rate is what counts.
        if wall - self._last < 0.9 * PERIOD / rate:
            return
        if self._phase is _Phase.SETTLING:
            self._settle(wall)
        elif self._may_go_on(wall):
            self._fly()
        else:
            return
        self._last = wall

    def _settle(self, wall: float) -> None:
        """Let the clock run until both nodes have noticed that it began anew."""
        # Alerts and the route are the runner's alone.
        connected = self._client.service_is_ready()
        connected &= all(
            publisher.get_subscription_count() >= 1 for publisher in (self._alerts, self._routes)
        )
        shared = (self._own, self._traffic, self._origins)
        connected &= all(
            publisher.get_subscription_count() >= 1 + self._monitored for publisher in shared
        )
        status = self._guidance.status
        idle = not self._monitored or (
            status is not None and status.fly == AssuranceStatus.FLY_NOTHING
        )
        if connected and idle and self._runner_heard:
            self._zero, self._phase = self._clock, _Phase.FLYING
            self._send_areas()
            self._fly()
            return
        if wall - self._since > _COME_UP:
            missing = "runner and monitor have" if self._monitored else "the runner has"
            self._end(
                f"{missing} not answered within {_COME_UP:g} s (are they there, with use_sim_time?)"
            )
            return
        self._show(self._clock + _TICK)

    def _send_areas(self) -> None:
        assert self._flight is not None
        if self._sends_areas:
            message = areas_message(
                self._flight.areas, self._zero, self._frame, self._value("map_frame")
            )
            self._area_lists.publish(message)

    def _show(self, clock: int) -> None:
        self._clock = clock
        self._clocks.publish(Clock(clock=time_message(clock)))

    def _may_go_on(self, wall: float) -> bool:
        """Return whether the clock may go on: the monitor has followed it, or is not waited for."""
        if not self._monitored or wall - self._last > _PATIENCE:
            return True
        status = self._guidance.status
        return status is not None and self._clock - nanoseconds(status.header.stamp) <= _AHEAD

    def _is_deciding(self) -> bool:
        status = self._guidance.status
        waiting = (
            AssuranceStatus.STATE_REPLAN_REQUESTED,
            AssuranceStatus.STATE_DENIED,
            AssuranceStatus.STATE_BACKUP,
        )
        searching = self._asking is not None or (status is not None and status.state in waiting)
        return self._phase is _Phase.FLYING and searching

    def _fly(self) -> None:
        """Go on by one tick: the clock, what is received, alert and request, and then the
        flight.
        """
        flight = self._flight
        assert flight is not None
        self._show(self._zero + round(flight.time * SECOND))
        sides = (self._own, {OWN: flight.own}), (self._traffic, flight.traffic)
        for receiver, (publisher, truth) in zip(self._receivers, sides, strict=True):
            for received in receiver.receive(flight.time, truth):
                publisher.publish(
                    state_message(received, receiver.quality, self._frame, self._zero, flight)
                )
        self._act(flight)
        try:
            flight.step()
        except RuntimeError as error:
            # It is envs.c208.vehicle.FlightError, whose module is not always there.
            self._end(str(error))
            return
        status = self._guidance.status
        if status is not None and status.fly == AssuranceStatus.FLY_BACKUP:
            self._log.backup += PERIOD
        if flight.over() or flight.time >= self._value("longest"):
            self._end("")

    def _end(self, failure: str) -> None:
        flight, log = self._flight, self._log
        assert flight is not None
        log.failure, log.duration = failure, flight.time
        log.wall = time.perf_counter() - self._since
        truth = flight.truth
        log.separation, log.when, log.error = truth.separation, truth.when, truth.error
        log.clear, log.height = truth.clear, truth.height
        log.flown = flight.plans
        if self._asking is not None:
            self._client.remove_pending_request(self._asking)
        self.logs.append(log)
        self._phase, self._flight = _Phase.IDLE, None

    # Alert, request, and what is flown.

    def _act(self, flight: EncounterFlight) -> None:
        near = flight.closest() < self._value("alert_distance") and flight.time >= 1.0
        if near and flight.time - self._alert_at >= _ALERT_AGAIN:
            self._alert_at = flight.time
            alert = TrafficAlert(
                level=TrafficAlert.LEVEL_CORRECTIVE, intruder_ids=list(flight.names)
            )
            alert.header.stamp = time_message(self._clock)
            self._alerts.publish(alert)
        due = flight.time - self._asked_at >= self._value("ask_again") and self._log.safe_at is None
        # A tick after the alert, so that it is known.
        if near and due and self._asking is None and flight.time > self._alert_at:
            self._ask(flight)
        self._choose(flight)

    def _ask(self, flight: EncounterFlight) -> None:
        self._asked_at = flight.time
        request = GenerateTrajectory.Request(reason=GenerateTrajectory.Request.REASON_ALERT)
        request.header = header(self._clock, self._value("map_frame"))
        began = time.perf_counter()
        self._asking = asking = self._client.call_async(request)
        asking.add_done_callback(lambda future: self._on_answer(future, began))

    def _on_answer(self, future: "Future[GenerateTrajectory.Response]", began: float) -> None:
        if future is not self._asking:
            return
        self._asking = None
        response, log = future.result(), self._log
        assert response is not None, "the future is done"
        log.latency.append(time.perf_counter() - began)
        name = Code(response.status).name
        if len(log.latency) == 1:
            log.first = name
        if response.status != response.STATUS_SAFE:
            self.get_logger().info(f"{log.name}: {name} {response.message}")

    def _choose(self, flight: EncounterFlight) -> None:
        """Fly the trajectory that the monitor names, or the newest plan without a monitor; straight
        on where the monitor has fallen silent.
        """
        trajectory = self._guidance.select(self._clock)
        unwatched = self._guidance.problem(self._clock)
        if unwatched and self._following:
            self._following = b""
            self.get_logger().error(f"{unwatched}: course and speed are held")
            flight.hold()
        if trajectory is None or bytes(trajectory.id.uuid) == self._following:
            return
        self._following = bytes(trajectory.id.uuid)
        plan = trajectory.status == Trajectory.STATUS_SAFE
        try:
            line = curve(self._frame, trajectory)
            profile = line.profile(self.aircraft.vertical)
            began = (line.began - self._zero) / SECOND
            flight.fly(line.legs_after(began), began, plan=plan, profile=profile)
        except (FieldError, SimulationError) as error:
            self.get_logger().error(f"cannot be flown: {error}")
            return
        if plan and self._log.safe_at is None:
            self._log.safe_at, self._log.source = (
                flight.time,
                _SOURCES.get(trajectory.source, "none"),
            )
            flight.truth = Truth()  # what counts from here on is what the plan promises

    def _of_now(self, message: Any) -> bool:
        return (
            self._phase is _Phase.FLYING
            and self._zero <= nanoseconds(message.header.stamp) <= self._clock + SECOND
        )

    def _on_trajectory(self, message: Trajectory) -> None:
        if self._of_now(message):
            self._log.plans += self._guidance.add_plan(message)

    def _on_backup(self, message: Trajectory) -> None:
        if self._of_now(message):
            self._guidance.backup = message

    def _on_status(self, message: AssuranceStatus) -> None:
        if _START < nanoseconds(message.header.stamp) <= self._clock:
            self._guidance.hear(message, self._clock)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        name = self.resolve_topic_name(topics.RUNNER)
        stamp = nanoseconds(message.header.stamp)
        if any(status.name == name for status in message.status) and _START < stamp <= self._clock:
            self._runner_heard = stamp
