"""Qualities of service of the topics."""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from ros_bridge.core.freshness import USUAL_FRESHNESS

_RELIABLE = ReliabilityPolicy.RELIABLE

SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of the ownship: takes every publisher; a lost report is followed by another."""

TRAFFIC = QoSProfile(depth=4096, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of single intruders: room for the reports of many that arrive together."""

TRAFFIC_ARRAY = QoSProfile(depth=20, reliability=_RELIABLE)
"""Of many intruders in one message, which is sent again until it has arrived; a node that is too
slow for them rather loses some, and says so, than works on old ones.
"""

EVENTS = QoSProfile(depth=10, reliability=_RELIABLE)
"""Of alerts and advice: each counts, an old one does not."""

LATCHED = QoSProfile(depth=1, reliability=_RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of what holds until it is replaced: a late subscriber gets the last one."""

REQUESTS = QoSProfile(depth=1000, reliability=_RELIABLE)
"""Of the service: requests wait for their answers, however many come at once."""

STATUS = QoSProfile(
    depth=1,
    reliability=_RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    deadline=Duration(seconds=0.5),
    liveliness=LivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=Duration(seconds=USUAL_FRESHNESS.monitor),
)
"""Of the monitor's status: latched, and a subscriber learns of the monitor's silence by the
wall's clock, and of its end.
"""

CLOCK = QoSProfile(depth=1, reliability=_RELIABLE)
"""Of /clock: the last time is the only one that counts; reliable serves subscribers that ask for
less, too.
"""

ROUTE = {"transient_local": LATCHED, "volatile": CLOCK}
"""Of the route's input, by its durability."""
