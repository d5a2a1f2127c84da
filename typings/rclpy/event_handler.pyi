from collections.abc import Callable
from typing import Any

class SubscriptionEventCallbacks:
    def __init__(
        self,
        *,
        deadline: Callable[[Any], None] | None = ...,
        incompatible_qos: Callable[[Any], None] | None = ...,
        liveliness: Callable[[Any], None] | None = ...,
        message_lost: Callable[[Any], None] | None = ...,
    ) -> None: ...

class PublisherEventCallbacks:
    def __init__(
        self,
        *,
        deadline: Callable[[Any], None] | None = ...,
        liveliness: Callable[[Any], None] | None = ...,
        incompatible_qos: Callable[[Any], None] | None = ...,
    ) -> None: ...
