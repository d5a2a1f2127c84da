"""The simulated world around runner and monitor, without ROS: aircraft, receivers, what is flown,
and its log.
"""

from ros_bridge.sim.flight_log import FlightLog
from ros_bridge.sim.guidance import Guidance
from ros_bridge.sim.receivers import Quality, Received, Receiver
from ros_bridge.sim.world import EncounterFlight, SimulationError

__all__ = [
    "EncounterFlight",
    "FlightLog",
    "Guidance",
    "Quality",
    "Received",
    "Receiver",
    "SimulationError",
]
