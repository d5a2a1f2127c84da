"""The ROS 2 bridge: latency and a long run."""
