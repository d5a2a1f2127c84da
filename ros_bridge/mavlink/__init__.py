"""Autopilots that speak MAVLink, beside ROS: the same core, without rclpy.

:mod:`messages`, :mod:`mission` and :mod:`vehicle` say what messages mean, :mod:`judging` watches
and plans, :mod:`steering` and :mod:`control` decide what the autopilot is told, and :mod:`advance`
puts them together: what happens (:mod:`events`) changes a state (:mod:`state`) and asks for effects
(:mod:`effects`). All of them are pure; :mod:`link` and :mod:`program` connect, receive and send.
"""
