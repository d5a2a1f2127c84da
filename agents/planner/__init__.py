"""From states and route to a validated plan, or the reasons why there is none."""

from agents.planner.answer import Advisory, AdvisoryCode, Plan, Reason, RequestError, Source, Status
from agents.planner.options import Options
from agents.planner.planner import Plans, plan, plan_many
from agents.planner.reports import Intruder
from agents.planner.request import Request
from agents.planner.traffic import Requirement, Traffic

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
]
