# Written by typings/make.py.

import builtin_interfaces.msg

class ColorRGBA:
    r: float
    g: float
    b: float
    a: float
    def __init__(
        self,
        *,
        r: float = ...,
        g: float = ...,
        b: float = ...,
        a: float = ...,
    ) -> None: ...

class Header:
    stamp: builtin_interfaces.msg.Time
    frame_id: str
    def __init__(
        self,
        *,
        stamp: builtin_interfaces.msg.Time = ...,
        frame_id: str = ...,
    ) -> None: ...
