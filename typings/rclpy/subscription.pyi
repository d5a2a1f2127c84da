from typing import Generic, TypeVar

_Message = TypeVar("_Message")

class Subscription(Generic[_Message]):
    def get_publisher_count(self) -> int: ...
    @property
    def topic_name(self) -> str: ...
