"""Why there is no plan: codes of the service GenerateTrajectory, with the field that is meant and a sentence."""

from enum import IntEnum

from ros_bridge.core.fields import FieldError


class Code(IntEnum):
    """Status codes of GenerateTrajectory."""

    UNKNOWN = 0
    SAFE = 1
    UNRESOLVED = 2
    NOT_ACTIVE = 10
    NO_CLOCK = 11
    NO_GEO_REFERENCE = 12
    NO_OWNSHIP = 13
    NO_ROUTE = 14
    NO_INTRUDER = 15
    STALE_OWNSHIP = 20
    STALE_INTRUDER = 21
    STALE_REQUEST = 22
    FUTURE_OWNSHIP = 30
    FUTURE_INTRUDER = 31
    FUTURE_REQUEST = 32
    INVALID_GEO_REFERENCE = 40
    INVALID_OWNSHIP = 41
    INVALID_INTRUDER = 42
    INVALID_ALERT = 43
    INVALID_ROUTE = 44
    INVALID_REQUEST = 45
    SUPERSEDED = 46
    INVALID_TASK = 47
    INTERNAL_ERROR = 255


class Refusal(FieldError):  # noqa: N818 - an answer, not a failure
    """Why there is no plan: the status of the answer, which input is meant, and a sentence."""

    def __init__(self, code: Code, field: str, problem: str) -> None:
        super().__init__(field, problem)
        self.code = code
