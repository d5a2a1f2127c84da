"""ROS 2 itself: qualities of service, parameters, messages, processes and recordings."""
