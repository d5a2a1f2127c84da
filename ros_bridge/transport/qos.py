# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Qualities of service of the topics, and callbacks for two sides that do not fit together."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

SENSOR = QoSProfile(depth=5, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of the ownship: takes every publisher; a lost report is followed by another."""

TRAFFIC = QoSProfile(depth=200, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of the intruders: room for the reports of many that arrive together."""

EVENTS = QoSProfile(depth=10, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
"""Of alerts and advice: each counts, an old one does not."""

LATCHED = QoSProfile(
    depth=1,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of what holds until it is replaced: a late subscriber gets the last one."""

CLOCK = QoSProfile(depth=1, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
"""Of /clock: the last time is the only one that counts; reliable serves subscribers that ask for less, too."""

_POLICIES = {1 << 1: "durability", 1 << 2: "deadline", 1 << 3: "liveliness", 1 << 4: "reliability", 1 << 5: "history"}


def route_input(durability: str) -> QoSProfile:
    """Return the quality of the route's input.

    Raises:
        ValueError: ``durability`` is neither ``transient_local`` nor ``volatile``.
    """
    if durability == "transient_local":
        return LATCHED
    if durability == "volatile":
        return QoSProfile(depth=1, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
    raise ValueError(f"route_durability is {durability!r}, expected transient_local or volatile")


def subscription_events(topic: str, report: Callable[[str, str], None]) -> SubscriptionEventCallbacks:
    """Return callbacks that call ``report(topic, sentence)`` when a publisher does not fit."""

    def misfit(event: Any) -> None:
        report(topic, f"{topic}: a publisher offers less {_policy(event)} than asked for; nothing of it is received")

    return SubscriptionEventCallbacks(incompatible_qos=misfit)


def publisher_events(topic: str, report: Callable[[str, str], None]) -> PublisherEventCallbacks:
    """Return callbacks that call ``report(topic, sentence)`` when a subscriber does not fit."""

    def misfit(event: Any) -> None:
        report(topic, f"{topic}: a subscriber asks for more {_policy(event)} than offered; it receives nothing")

    return PublisherEventCallbacks(incompatible_qos=misfit)


def _policy(event: Any) -> str:
    kind = int(event.last_policy_kind)
    return _POLICIES.get(kind, f"(policy {kind})")
