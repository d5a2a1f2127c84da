"""ROS 2 nodes and the conversions between messages and the domain."""
