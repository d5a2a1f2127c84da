"""Requests for a plan: what is refused before anything is planned."""

from rlcas_msgs.srv import GenerateTrajectory

from ros_bridge.core.fields import SECOND, Code, FieldError, Refusal, stamp
from ros_bridge.core.tasks import REQUEST_AGE, Settings, check_age

NO_PLAN = bytes(16)
"""In a request: no plan in particular."""


def check(
    request: GenerateTrajectory.Request, moment: int, settings: Settings, holding: bytes
) -> None:
    """Raise :class:`Refusal` for a request of an unknown reason, time or plan, at a moment, ns."""
    reasons = (request.REASON_ALERT, request.REASON_REPLAN, request.REASON_MANUAL)
    if request.reason not in reasons:
        raise Refusal(
            Code.INVALID_REQUEST,
            "request.reason",
            f"is {request.reason}, expected one of {list(reasons)}",
        )
    field, stamped = "request.header.stamp", request.header.stamp
    if moment > 0 and (stamped.sec or stamped.nanosec):
        try:
            age = (moment - stamp(field, stamped)) / SECOND
        except FieldError as error:
            raise Refusal(Code.INVALID_REQUEST, error.field, error.problem) from error
        fresh = settings.freshness
        check_age(REQUEST_AGE, field, age, fresh.request, fresh.future)
    previous = bytes(request.previous_id.uuid)
    if previous not in (NO_PLAN, holding):
        problem = (
            f"is {previous.hex()}, but the plan that holds is "
            f"{'none' if holding == NO_PLAN else holding.hex()}"
        )
        raise Refusal(Code.SUPERSEDED, "request.previous_id", problem)
