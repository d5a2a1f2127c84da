from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import Executor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo

_Message = TypeVar("_Message")

class Node:
    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = ...,
        cli_args: list[str] | None = ...,
        namespace: str | None = ...,
        use_global_arguments: bool = ...,
        enable_rosout: bool = ...,
        start_parameter_services: bool = ...,
        parameter_overrides: Sequence[Parameter] | None = ...,
    ) -> None: ...
    @property
    def context(self) -> Context: ...
    @property
    def executor(self) -> Executor | None: ...
    def add_on_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], SetParametersResult]
    ) -> None: ...
    def create_publisher(
        self,
        msg_type: type[_Message],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = ...,
        event_callbacks: PublisherEventCallbacks | None = ...,
    ) -> Publisher[_Message]: ...
    def create_subscription(
        self,
        msg_type: type[_Message],
        topic: str,
        callback: Callable[[_Message], object] | Callable[[_Message, Any], object],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = ...,
        event_callbacks: SubscriptionEventCallbacks | None = ...,
        raw: bool = ...,
    ) -> Subscription[_Message]: ...
    def create_client(
        self,
        srv_type: type[Any],
        srv_name: str,
        *,
        qos_profile: QoSProfile = ...,
        callback_group: CallbackGroup | None = ...,
    ) -> Client[Any, Any]: ...
    def create_service(
        self,
        srv_type: type[Any],
        srv_name: str,
        callback: Callable[[Any, Any], object],
        *,
        qos_profile: QoSProfile = ...,
        callback_group: CallbackGroup | None = ...,
    ) -> Service: ...
    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], object] | None,
        callback_group: CallbackGroup | None = ...,
        clock: Clock | None = ...,
        autostart: bool = ...,
    ) -> Timer: ...
    def declare_parameter(
        self,
        name: str,
        value: Any = ...,
        descriptor: ParameterDescriptor | None = ...,
        ignore_override: bool = ...,
    ) -> Parameter: ...
    def destroy_client(self, client: Client[Any, Any]) -> bool: ...
    def destroy_node(self) -> None: ...
    def destroy_publisher(self, publisher: Publisher[Any]) -> bool: ...
    def destroy_service(self, service: Service) -> bool: ...
    def destroy_subscription(self, subscription: Subscription[Any]) -> bool: ...
    def destroy_timer(self, timer: Timer) -> bool: ...
    def count_publishers(self, topic_name: str) -> int: ...
    def count_subscribers(self, topic_name: str) -> int: ...
    def get_clock(self) -> Clock: ...
    def get_fully_qualified_name(self) -> str: ...
    def get_logger(self) -> RcutilsLogger: ...
    def get_name(self) -> str: ...
    def get_namespace(self) -> str: ...
    def get_node_names(self) -> list[str]: ...
    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = ...
    ) -> list[TopicEndpointInfo]: ...
    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = ...
    ) -> list[TopicEndpointInfo]: ...
    def get_parameter(self, name: str) -> Parameter: ...
    def has_parameter(self, name: str) -> bool: ...
    def resolve_topic_name(self, topic: str, *, only_expand: bool = ...) -> str: ...
    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]: ...
