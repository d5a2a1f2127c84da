# Written by typings/make.py.

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

class UUID:
    @property
    def uuid(self) -> NDArray[Any]: ...
    @uuid.setter
    def uuid(self, value: Sequence[int] | NDArray[Any]) -> None: ...
    def __init__(
        self,
        *,
        uuid: Sequence[int] | NDArray[Any] = ...,
    ) -> None: ...
