"""The topics between the nodes: what they carry, their names, and their qualities of service."""

from collections.abc import Callable
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rlcas_msgs.msg import (
    AircraftState,
    Areas,
    AssuranceStatus,
    GeoReference,
    GuidanceBands,
    TrafficAlert,
    TrafficArray,
    Trajectory,
)
from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import MarkerArray

from ros_bridge.transport import qos

RUNNER, MONITOR = "rlcas_runner", "rlcas_monitor"
SERVICE = f"{RUNNER}/generate_trajectory"


class Topic(NamedTuple):
    """A topic; ``node.create_publisher(*topic)`` publishes it."""

    kind: Any
    name: str
    quality: QoSProfile

    @property
    def private(self) -> "Topic":
        """The topic as the node calls it that it belongs to, whatever that node's name is."""
        return self._replace(name=f"~/{self.name.partition('/')[2]}")

    @property
    def undemanding(self) -> "Topic":
        """The topic for who only looks: what offers no deadline or liveliness is taken, too."""
        quality = QoSProfile(
            depth=self.quality.depth,
            reliability=self.quality.reliability,
            durability=self.quality.durability,
        )
        return self._replace(quality=quality)

    def subscribe(
        self, node: Node, callback: Callable[..., Any], **more: Any
    ) -> "Subscription[Any]":
        """Return a node's subscription; ``more`` as its ``create_subscription`` has it."""
        return node.create_subscription(self.kind, self.name, callback, self.quality, **more)


CLOCK = Topic(Clock, "/clock", qos.CLOCK)
OWNSHIP = Topic(AircraftState, f"{RUNNER}/input/ownship", qos.SENSOR)
TRAFFIC = Topic(AircraftState, f"{RUNNER}/input/traffic", qos.TRAFFIC)
TRAFFIC_ARRAY = Topic(TrafficArray, f"{RUNNER}/input/traffic_array", qos.TRAFFIC_ARRAY)
ALERTS = Topic(TrafficAlert, f"{RUNNER}/input/alerts", qos.EVENTS)
ROUTE = Topic(Trajectory, f"{RUNNER}/input/route", qos.LATCHED)
GEO_REFERENCE = Topic(GeoReference, f"{RUNNER}/input/geo_reference", qos.LATCHED)
AREAS = Topic(Areas, f"{RUNNER}/input/areas", qos.LATCHED)
PLAN = Topic(Trajectory, f"{RUNNER}/output/trajectory", qos.LATCHED)
ADVISORY = Topic(Trajectory, f"{RUNNER}/output/advisory", qos.EVENTS)
PATH = Topic(Path, f"{RUNNER}/output/path", qos.LATCHED)
MARKERS = Topic(MarkerArray, f"{RUNNER}/output/markers", qos.LATCHED)
ODOMETRY = Topic(Odometry, f"{RUNNER}/output/odometry", qos.EVENTS)
STATUS = Topic(AssuranceStatus, f"{MONITOR}/output/status", qos.STATUS)
BACKUP = Topic(Trajectory, f"{MONITOR}/output/backup", qos.LATCHED)
GUIDANCE = Topic(GuidanceBands, f"{MONITOR}/output/guidance", qos.LATCHED)
DIAGNOSTICS = Topic(DiagnosticArray, "/diagnostics", qos.EVENTS)

INPUTS = (OWNSHIP, TRAFFIC, TRAFFIC_ARRAY, ALERTS, ROUTE, GEO_REFERENCE)
EVERY = (
    CLOCK,
    *INPUTS,
    AREAS,
    PLAN,
    ADVISORY,
    PATH,
    MARKERS,
    STATUS,
    BACKUP,
    GUIDANCE,
    DIAGNOSTICS,
)
