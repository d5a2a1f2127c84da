"""The traffic display: a page in the browser, fed by ROS, live ADS-B or a recording.

What is shown is one value, a :class:`ros_bridge.display.scene.Scene`; what the page draws follows
from it by one pure function, :func:`ros_bridge.display.picture.picture`. A source only feeds
scenes: :mod:`~ros_bridge.display.graph`, :mod:`~ros_bridge.display.adsb` and
:mod:`~ros_bridge.display.recording`.
"""
