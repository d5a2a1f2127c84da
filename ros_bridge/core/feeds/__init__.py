"""Feeds of receivers as reports of traffic: one file a format, without ROS and without connections.

Which address has which format: :mod:`ros_bridge.transport.receivers`.
"""
