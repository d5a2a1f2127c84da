# Written by typings/make.py.

from collections.abc import Sequence
from typing import Any

import std_msgs.msg
from numpy.typing import NDArray

class Point:
    x: float
    y: float
    z: float
    def __init__(
        self,
        *,
        x: float = ...,
        y: float = ...,
        z: float = ...,
    ) -> None: ...

class Pose:
    position: Point
    orientation: Quaternion
    def __init__(
        self,
        *,
        position: Point = ...,
        orientation: Quaternion = ...,
    ) -> None: ...

class PoseStamped:
    header: std_msgs.msg.Header
    pose: Pose
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        pose: Pose = ...,
    ) -> None: ...

class PoseWithCovariance:
    pose: Pose
    @property
    def covariance(self) -> NDArray[Any]: ...
    @covariance.setter
    def covariance(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    def __init__(
        self,
        *,
        pose: Pose = ...,
        covariance: Sequence[float] | NDArray[Any] = ...,
    ) -> None: ...

class Quaternion:
    x: float
    y: float
    z: float
    w: float
    def __init__(
        self,
        *,
        x: float = ...,
        y: float = ...,
        z: float = ...,
        w: float = ...,
    ) -> None: ...

class Twist:
    linear: Vector3
    angular: Vector3
    def __init__(
        self,
        *,
        linear: Vector3 = ...,
        angular: Vector3 = ...,
    ) -> None: ...

class TwistStamped:
    header: std_msgs.msg.Header
    twist: Twist
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        twist: Twist = ...,
    ) -> None: ...

class TwistWithCovariance:
    twist: Twist
    @property
    def covariance(self) -> NDArray[Any]: ...
    @covariance.setter
    def covariance(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    def __init__(
        self,
        *,
        twist: Twist = ...,
        covariance: Sequence[float] | NDArray[Any] = ...,
    ) -> None: ...

class Vector3:
    x: float
    y: float
    z: float
    def __init__(
        self,
        *,
        x: float = ...,
        y: float = ...,
        z: float = ...,
    ) -> None: ...
