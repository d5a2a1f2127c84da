# Written by typings/make.py.

from collections.abc import Sequence
from typing import ClassVar

import rlcas_msgs.msg
import std_msgs.msg
import unique_identifier_msgs.msg

class GenerateTrajectory:
    class Request:
        REASON_ALERT: ClassVar[int]
        REASON_REPLAN: ClassVar[int]
        REASON_MANUAL: ClassVar[int]
        header: std_msgs.msg.Header
        reason: int
        previous_id: unique_identifier_msgs.msg.UUID
        @property
        def route(self) -> list[rlcas_msgs.msg.Waypoint]: ...
        @route.setter
        def route(self, value: Sequence[rlcas_msgs.msg.Waypoint]) -> None: ...
        def __init__(
            self,
            *,
            header: std_msgs.msg.Header = ...,
            reason: int = ...,
            previous_id: unique_identifier_msgs.msg.UUID = ...,
            route: Sequence[rlcas_msgs.msg.Waypoint] = ...,
        ) -> None: ...

    class Response:
        STATUS_UNKNOWN: ClassVar[int]
        STATUS_SAFE: ClassVar[int]
        STATUS_UNRESOLVED: ClassVar[int]
        STATUS_NOT_ACTIVE: ClassVar[int]
        STATUS_NO_CLOCK: ClassVar[int]
        STATUS_NO_GEO_REFERENCE: ClassVar[int]
        STATUS_NO_OWNSHIP: ClassVar[int]
        STATUS_NO_ROUTE: ClassVar[int]
        STATUS_NO_INTRUDER: ClassVar[int]
        STATUS_STALE_OWNSHIP: ClassVar[int]
        STATUS_STALE_INTRUDER: ClassVar[int]
        STATUS_STALE_REQUEST: ClassVar[int]
        STATUS_FUTURE_OWNSHIP: ClassVar[int]
        STATUS_FUTURE_INTRUDER: ClassVar[int]
        STATUS_FUTURE_REQUEST: ClassVar[int]
        STATUS_INVALID_GEO_REFERENCE: ClassVar[int]
        STATUS_INVALID_OWNSHIP: ClassVar[int]
        STATUS_INVALID_INTRUDER: ClassVar[int]
        STATUS_INVALID_ALERT: ClassVar[int]
        STATUS_INVALID_ROUTE: ClassVar[int]
        STATUS_INVALID_REQUEST: ClassVar[int]
        STATUS_SUPERSEDED: ClassVar[int]
        STATUS_INVALID_TASK: ClassVar[int]
        STATUS_CANCELLED: ClassVar[int]
        STATUS_INTERNAL_ERROR: ClassVar[int]
        status: int
        field: str
        message: str
        @property
        def advisories(self) -> list[rlcas_msgs.msg.Advisory]: ...
        @advisories.setter
        def advisories(self, value: Sequence[rlcas_msgs.msg.Advisory]) -> None: ...
        advisory: str
        trajectory: rlcas_msgs.msg.Trajectory
        @property
        def excluded_ids(self) -> list[str]: ...
        @excluded_ids.setter
        def excluded_ids(self, value: Sequence[str]) -> None: ...
        @property
        def excluded_reasons(self) -> list[str]: ...
        @excluded_reasons.setter
        def excluded_reasons(self, value: Sequence[str]) -> None: ...
        computation_time: float
        def __init__(
            self,
            *,
            status: int = ...,
            field: str = ...,
            message: str = ...,
            advisories: Sequence[rlcas_msgs.msg.Advisory] = ...,
            advisory: str = ...,
            trajectory: rlcas_msgs.msg.Trajectory = ...,
            excluded_ids: Sequence[str] = ...,
            excluded_reasons: Sequence[str] = ...,
            computation_time: float = ...,
        ) -> None: ...
