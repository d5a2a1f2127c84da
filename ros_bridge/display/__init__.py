"""The traffic display: a page in the browser, fed by ROS, live ADS-B or a recording.

What is known is one value, a :class:`ros_bridge.display.scene.DisplayScene`. A pure function makes
a :class:`~ros_bridge.display.picture.Picture` of it, :func:`ros_bridge.display.draw.draw`, and
another the JSON of that, :func:`ros_bridge.display.document.to_json`. A source only feeds scenes:
:mod:`~ros_bridge.display.graph`, :mod:`~ros_bridge.display.adsb` and
:mod:`~ros_bridge.display.recording`.
"""
