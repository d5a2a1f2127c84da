# Written by typings/make.py.

from collections.abc import Sequence

import geometry_msgs.msg
import std_msgs.msg

class Odometry:
    header: std_msgs.msg.Header
    child_frame_id: str
    pose: geometry_msgs.msg.PoseWithCovariance
    twist: geometry_msgs.msg.TwistWithCovariance
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        child_frame_id: str = ...,
        pose: geometry_msgs.msg.PoseWithCovariance = ...,
        twist: geometry_msgs.msg.TwistWithCovariance = ...,
    ) -> None: ...

class Path:
    header: std_msgs.msg.Header
    @property
    def poses(self) -> list[geometry_msgs.msg.PoseStamped]: ...
    @poses.setter
    def poses(self, value: Sequence[geometry_msgs.msg.PoseStamped]) -> None: ...
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        poses: Sequence[geometry_msgs.msg.PoseStamped] = ...,
    ) -> None: ...
