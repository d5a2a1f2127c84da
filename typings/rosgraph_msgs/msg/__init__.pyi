# Written by typings/make.py.

import builtin_interfaces.msg

class Clock:
    clock: builtin_interfaces.msg.Time
    def __init__(
        self,
        *,
        clock: builtin_interfaces.msg.Time = ...,
    ) -> None: ...
