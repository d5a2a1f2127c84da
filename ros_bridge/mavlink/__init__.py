"""The door to autopilots that speak MAVLink, beside the one to ROS: the same core, without rclpy.

:mod:`messages`, :mod:`mission` and :mod:`vehicle` say what messages mean, :mod:`judging` watches
and plans, :mod:`steering` and :mod:`control` decide what the autopilot is told, all of them pure;
:mod:`link` and :mod:`program` connect, receive and send.
"""
