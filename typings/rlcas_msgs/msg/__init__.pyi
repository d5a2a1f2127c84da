# Written by typings/make.py.

from array import array
from collections.abc import Sequence
from typing import Any, ClassVar

import builtin_interfaces.msg
import geometry_msgs.msg
import std_msgs.msg
import unique_identifier_msgs.msg
from numpy.typing import NDArray

class Advisory:
    POLICY_UNSAFE: ClassVar[int]
    OUTSIDE_DOMAIN: ClassVar[int]
    ASSUMED: ClassVar[int]
    TIME_UNCERTAIN: ClassVar[int]
    WIND_UNKNOWN: ClassVar[int]
    POSSIBLE_COPY: ClassVar[int]
    PASSED_OVER: ClassVar[int]
    OWN_SEPARATION: ClassVar[int]
    SKIPPED: ClassVar[int]
    code: int
    field: str
    text: str
    def __init__(
        self,
        *,
        code: int = ...,
        field: str = ...,
        text: str = ...,
    ) -> None: ...

class AircraftState:
    ALTITUDE_UNKNOWN: ClassVar[int]
    ALTITUDE_WGS84: ClassVar[int]
    ALTITUDE_MSL: ClassVar[int]
    ALTITUDE_PRESSURE: ClassVar[int]
    VALID_POSITION: ClassVar[int]
    VALID_ALTITUDE: ClassVar[int]
    VALID_VELOCITY: ClassVar[int]
    VALID_VERTICAL_SPEED: ClassVar[int]
    VALID_TRUE_AIRSPEED: ClassVar[int]
    VALID_WIND: ClassVar[int]
    VALID_POSITION_STD: ClassVar[int]
    VALID_VELOCITY_STD: ClassVar[int]
    VALID_TIME_STD: ClassVar[int]
    header: std_msgs.msg.Header
    id: str
    valid: int
    latitude: float
    longitude: float
    altitude: float
    altitude_reference: int
    velocity: geometry_msgs.msg.Vector3
    true_airspeed: float
    wind: geometry_msgs.msg.Vector3
    position_std: float
    velocity_std: float
    time_std: float
    category: int
    callsign: str
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        id: str = ...,
        valid: int = ...,
        latitude: float = ...,
        longitude: float = ...,
        altitude: float = ...,
        altitude_reference: int = ...,
        velocity: geometry_msgs.msg.Vector3 = ...,
        true_airspeed: float = ...,
        wind: geometry_msgs.msg.Vector3 = ...,
        position_std: float = ...,
        velocity_std: float = ...,
        time_std: float = ...,
        category: int = ...,
        callsign: str = ...,
    ) -> None: ...

class Area:
    KEEP_OUT: ClassVar[int]
    KEEP_IN: ClassVar[int]
    VALID_FLOOR: ClassVar[int]
    VALID_CEILING: ClassVar[int]
    VALID_FROM: ClassVar[int]
    VALID_UNTIL: ClassVar[int]
    ALTITUDE_GROUND: ClassVar[int]
    id: str
    keep: int
    valid: int
    @property
    def rings(self) -> list[Ring]: ...
    @rings.setter
    def rings(self, value: Sequence[Ring]) -> None: ...
    latitude: float
    longitude: float
    radius: float
    velocity: geometry_msgs.msg.Vector3
    growth: float
    floor: float
    floor_reference: int
    ceiling: float
    ceiling_reference: int
    valid_from: builtin_interfaces.msg.Time
    valid_until: builtin_interfaces.msg.Time
    clearance: float
    def __init__(
        self,
        *,
        id: str = ...,
        keep: int = ...,
        valid: int = ...,
        rings: Sequence[Ring] = ...,
        latitude: float = ...,
        longitude: float = ...,
        radius: float = ...,
        velocity: geometry_msgs.msg.Vector3 = ...,
        growth: float = ...,
        floor: float = ...,
        floor_reference: int = ...,
        ceiling: float = ...,
        ceiling_reference: int = ...,
        valid_from: builtin_interfaces.msg.Time = ...,
        valid_until: builtin_interfaces.msg.Time = ...,
        clearance: float = ...,
    ) -> None: ...

class Areas:
    header: std_msgs.msg.Header
    @property
    def areas(self) -> list[Area]: ...
    @areas.setter
    def areas(self, value: Sequence[Area]) -> None: ...
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        areas: Sequence[Area] = ...,
    ) -> None: ...

class AssuranceStatus:
    STATE_IDLE: ClassVar[int]
    STATE_MONITORING: ClassVar[int]
    STATE_REPLAN_REQUESTED: ClassVar[int]
    STATE_DENIED: ClassVar[int]
    STATE_BACKUP: ClassVar[int]
    FLY_NOTHING: ClassVar[int]
    FLY_PLAN: ClassVar[int]
    FLY_BACKUP: ClassVar[int]
    header: std_msgs.msg.Header
    trajectory_id: unique_identifier_msgs.msg.UUID
    trajectory_revision: int
    state: int
    fly: int
    causes: int
    @property
    def reasons(self) -> list[str]: ...
    @reasons.setter
    def reasons(self, value: Sequence[str]) -> None: ...
    measured: bool
    cross_track: float
    cross_track_limit: float
    along_track: float
    along_track_limit: float
    time_error: float
    time_error_limit: float
    @property
    def accumulated(self) -> NDArray[Any]: ...
    @accumulated.setter
    def accumulated(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    separation: float
    time_to_loss: float
    runner_silence: float
    altitude_error: float
    altitude_error_limit: float
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        trajectory_id: unique_identifier_msgs.msg.UUID = ...,
        trajectory_revision: int = ...,
        state: int = ...,
        fly: int = ...,
        causes: int = ...,
        reasons: Sequence[str] = ...,
        measured: bool = ...,
        cross_track: float = ...,
        cross_track_limit: float = ...,
        along_track: float = ...,
        along_track_limit: float = ...,
        time_error: float = ...,
        time_error_limit: float = ...,
        accumulated: Sequence[float] | NDArray[Any] = ...,
        separation: float = ...,
        time_to_loss: float = ...,
        runner_silence: float = ...,
        altitude_error: float = ...,
        altitude_error_limit: float = ...,
    ) -> None: ...

class GeoReference:
    header: std_msgs.msg.Header
    latitude: float
    longitude: float
    geoid_undulation_valid: bool
    geoid_undulation: float
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        latitude: float = ...,
        longitude: float = ...,
        geoid_undulation_valid: bool = ...,
        geoid_undulation: float = ...,
    ) -> None: ...

class GuidanceBands:
    REGION_FREE: ClassVar[int]
    REGION_PREVENTIVE: ClassVar[int]
    REGION_CORRECTIVE: ClassVar[int]
    REGION_WARNING: ClassVar[int]
    REGION_RECOVERY: ClassVar[int]
    header: std_msgs.msg.Header
    look_ahead: float
    @property
    def track_deg(self) -> array[float]: ...
    @track_deg.setter
    def track_deg(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def track_region(self) -> array[int]: ...
    @track_region.setter
    def track_region(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def track_loss(self) -> array[float]: ...
    @track_loss.setter
    def track_loss(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def track_area(self) -> array[int]: ...
    @track_area.setter
    def track_area(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def speed(self) -> array[float]: ...
    @speed.setter
    def speed(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def speed_region(self) -> array[int]: ...
    @speed_region.setter
    def speed_region(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def speed_loss(self) -> array[float]: ...
    @speed_loss.setter
    def speed_loss(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def speed_area(self) -> array[int]: ...
    @speed_area.setter
    def speed_area(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    recovery: int
    recovery_time: float
    recovery_shortfall: float
    @property
    def intruder_ids(self) -> list[str]: ...
    @intruder_ids.setter
    def intruder_ids(self, value: Sequence[str]) -> None: ...
    @property
    def intruder_level(self) -> array[int]: ...
    @intruder_level.setter
    def intruder_level(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def intruder_loss(self) -> array[float]: ...
    @intruder_loss.setter
    def intruder_loss(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def area_ids(self) -> list[str]: ...
    @area_ids.setter
    def area_ids(self, value: Sequence[str]) -> None: ...
    @property
    def area_level(self) -> array[int]: ...
    @area_level.setter
    def area_level(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def area_loss(self) -> array[float]: ...
    @area_loss.setter
    def area_loss(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def vertical_speed(self) -> array[float]: ...
    @vertical_speed.setter
    def vertical_speed(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def vertical_speed_region(self) -> array[int]: ...
    @vertical_speed_region.setter
    def vertical_speed_region(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def vertical_speed_loss(self) -> array[float]: ...
    @vertical_speed_loss.setter
    def vertical_speed_loss(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def vertical_speed_area(self) -> array[int]: ...
    @vertical_speed_area.setter
    def vertical_speed_area(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    altitude_reference: int
    @property
    def altitude(self) -> array[float]: ...
    @altitude.setter
    def altitude(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def altitude_region(self) -> array[int]: ...
    @altitude_region.setter
    def altitude_region(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    @property
    def altitude_loss(self) -> array[float]: ...
    @altitude_loss.setter
    def altitude_loss(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def altitude_area(self) -> array[int]: ...
    @altitude_area.setter
    def altitude_area(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        look_ahead: float = ...,
        track_deg: Sequence[float] | NDArray[Any] = ...,
        track_region: Sequence[int] | NDArray[Any] = ...,
        track_loss: Sequence[float] | NDArray[Any] = ...,
        track_area: Sequence[int] | NDArray[Any] = ...,
        speed: Sequence[float] | NDArray[Any] = ...,
        speed_region: Sequence[int] | NDArray[Any] = ...,
        speed_loss: Sequence[float] | NDArray[Any] = ...,
        speed_area: Sequence[int] | NDArray[Any] = ...,
        recovery: int = ...,
        recovery_time: float = ...,
        recovery_shortfall: float = ...,
        intruder_ids: Sequence[str] = ...,
        intruder_level: Sequence[int] | NDArray[Any] = ...,
        intruder_loss: Sequence[float] | NDArray[Any] = ...,
        area_ids: Sequence[str] = ...,
        area_level: Sequence[int] | NDArray[Any] = ...,
        area_loss: Sequence[float] | NDArray[Any] = ...,
        vertical_speed: Sequence[float] | NDArray[Any] = ...,
        vertical_speed_region: Sequence[int] | NDArray[Any] = ...,
        vertical_speed_loss: Sequence[float] | NDArray[Any] = ...,
        vertical_speed_area: Sequence[int] | NDArray[Any] = ...,
        altitude_reference: int = ...,
        altitude: Sequence[float] | NDArray[Any] = ...,
        altitude_region: Sequence[int] | NDArray[Any] = ...,
        altitude_loss: Sequence[float] | NDArray[Any] = ...,
        altitude_area: Sequence[int] | NDArray[Any] = ...,
    ) -> None: ...

class Ring:
    @property
    def latitude(self) -> array[float]: ...
    @latitude.setter
    def latitude(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    @property
    def longitude(self) -> array[float]: ...
    @longitude.setter
    def longitude(self, value: Sequence[float] | NDArray[Any]) -> None: ...
    def __init__(
        self,
        *,
        latitude: Sequence[float] | NDArray[Any] = ...,
        longitude: Sequence[float] | NDArray[Any] = ...,
    ) -> None: ...

class TrafficAlert:
    LEVEL_NONE: ClassVar[int]
    LEVEL_PREVENTIVE: ClassVar[int]
    LEVEL_CORRECTIVE: ClassVar[int]
    LEVEL_WARNING: ClassVar[int]
    header: std_msgs.msg.Header
    level: int
    @property
    def intruder_ids(self) -> list[str]: ...
    @intruder_ids.setter
    def intruder_ids(self, value: Sequence[str]) -> None: ...
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        level: int = ...,
        intruder_ids: Sequence[str] = ...,
    ) -> None: ...

class TrafficArray:
    @property
    def states(self) -> list[AircraftState]: ...
    @states.setter
    def states(self, value: Sequence[AircraftState]) -> None: ...
    def __init__(
        self,
        *,
        states: Sequence[AircraftState] = ...,
    ) -> None: ...

class Trajectory:
    STATUS_UNKNOWN: ClassVar[int]
    STATUS_SAFE: ClassVar[int]
    STATUS_UNRESOLVED: ClassVar[int]
    STATUS_WITHDRAWN: ClassVar[int]
    STATUS_ROUTE: ClassVar[int]
    STATUS_BACKUP: ClassVar[int]
    SOURCE_NONE: ClassVar[int]
    SOURCE_POLICY: ClassVar[int]
    SOURCE_FALLBACK: ClassVar[int]
    SOURCE_VERTICAL: ClassVar[int]
    header: std_msgs.msg.Header
    id: unique_identifier_msgs.msg.UUID
    revision: int
    status: int
    source: int
    @property
    def intruder_ids(self) -> list[str]: ...
    @intruder_ids.setter
    def intruder_ids(self, value: Sequence[str]) -> None: ...
    min_separation: float
    time_of_min_separation: float
    rejoin_index: int
    start: Waypoint
    @property
    def waypoints(self) -> list[Waypoint]: ...
    @waypoints.setter
    def waypoints(self, value: Sequence[Waypoint]) -> None: ...
    wind: geometry_msgs.msg.Vector3
    wind_std: float
    @property
    def certificate(self) -> array[int]: ...
    @certificate.setter
    def certificate(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        id: unique_identifier_msgs.msg.UUID = ...,
        revision: int = ...,
        status: int = ...,
        source: int = ...,
        intruder_ids: Sequence[str] = ...,
        min_separation: float = ...,
        time_of_min_separation: float = ...,
        rejoin_index: int = ...,
        start: Waypoint = ...,
        waypoints: Sequence[Waypoint] = ...,
        wind: geometry_msgs.msg.Vector3 = ...,
        wind_std: float = ...,
        certificate: Sequence[int] | NDArray[Any] = ...,
    ) -> None: ...

class Waypoint:
    ORIGIN_ROUTE: ClassVar[int]
    ORIGIN_POLICY: ClassVar[int]
    VALID_ALTITUDE: ClassVar[int]
    VALID_TRACK: ClassVar[int]
    VALID_GROUND_SPEED: ClassVar[int]
    VALID_TIME_OF_ARRIVAL: ClassVar[int]
    VALID_CLIMB: ClassVar[int]
    index: int
    origin: int
    valid: int
    latitude: float
    longitude: float
    altitude: float
    altitude_reference: int
    climb: float
    track_deg: float
    ground_speed: float
    time_of_arrival: builtin_interfaces.msg.Time
    def __init__(
        self,
        *,
        index: int = ...,
        origin: int = ...,
        valid: int = ...,
        latitude: float = ...,
        longitude: float = ...,
        altitude: float = ...,
        altitude_reference: int = ...,
        climb: float = ...,
        track_deg: float = ...,
        ground_speed: float = ...,
        time_of_arrival: builtin_interfaces.msg.Time = ...,
    ) -> None: ...
