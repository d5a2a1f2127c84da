"""The runner: takes in ownship, traffic, alerts, route and geo-reference, and answers with plans.

    python -m ros_bridge.runner [--ros-args -r __ns:=/n123 --params-file FILE -p intruder_max_age:=3.0 ...]

A lifecycle node that configures and activates itself (``--manual`` leaves that to others). It subscribes from the
configuration on, and answers and publishes while it is active:

    in    ~/input/ownship, ~/input/traffic    rlcas_msgs/AircraftState   best effort
          ~/input/alerts                      rlcas_msgs/TrafficAlert    reliable
          ~/input/route                       rlcas_msgs/Trajectory      latched (parameter route_durability)
          ~/input/geo_reference               rlcas_msgs/GeoReference    latched
    out   ~/output/trajectory                 rlcas_msgs/Trajectory      latched; SAFE plans and withdrawals only
          ~/output/advisory                   rlcas_msgs/Trajectory      reliable; plans that are not safe
          ~/output/path, ~/output/markers     nav_msgs/Path, visualization_msgs/MarkerArray   latched
          /diagnostics                        diagnostic_msgs/DiagnosticArray
    srv   ~/generate_trajectory               rlcas_msgs/GenerateTrajectory

Parameters:
"""

import gc
from collections.abc import Sequence

from envs.edge.command import run_cli


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    # Whatever is imported stays; looking for what does not takes an eighth of the time.
    gc.disable()
    from ros_bridge.nodes.runner import Runner
    from ros_bridge.transport import process

    return process.main(Runner, "runner", __doc__, arguments)


if __name__ == "__main__":
    run_cli("ros_bridge.runner:main")
