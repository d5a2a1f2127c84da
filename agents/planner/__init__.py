"""From states and route to a validated plan, or the reasons why there is none."""

from agents.kernel.traffic import Requirement, Traffic
from agents.planner.answer import Advisory, AdvisoryCode, Plan, Reason, RequestError, Source, Status
from agents.planner.planner import Plans, plan, plan_many
from agents.planner.request.options import Options
from agents.planner.request.reports import Intruder
from agents.planner.request.request import Request
from envs.compiled import prepare

__all__ = [
    "Advisory",
    "AdvisoryCode",
    "Intruder",
    "Options",
    "Plan",
    "Plans",
    "Reason",
    "Request",
    "RequestError",
    "Requirement",
    "Source",
    "Status",
    "Traffic",
    "plan",
    "plan_many",
    "prepare",
]
