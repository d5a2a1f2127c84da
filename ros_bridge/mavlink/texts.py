"""What the program says: lines on its output, and texts to the ground station."""

import math
from dataclasses import replace
from types import MappingProxyType

from ros_bridge.core.fields import SECOND
from ros_bridge.mavlink.effects import Log, Say
from ros_bridge.mavlink.state import Advance, State

AGAIN = 5.0
"""Between two texts of the same kind, s."""


def say(text: str) -> Say:
    """Return what sends a text to the ground station."""
    return Say(f"RLCAS: {text}")


def log_and_say(state: State, text: str, time: int) -> Advance:
    """Log and send a text; ``time`` is the autopilot's, ns."""
    return Advance(state, (Log(text, time), say(text)))


def tell(
    state: State,
    kind: str,
    text: str,
    time: int,
    *,
    send: bool,
    more: str = "",
    again: float = AGAIN,
) -> Advance:
    """Log a text, and send it, unless one of its kind has just been: then nothing is to be done.

    Args:
        state: with what was said before.
        kind: of the text.
        text: that is told.
        time: the autopilot's, ns.
        send: whether the ground station is told too.
        more: that is only logged.
        again: after which one of the kind is told again, s.
    """
    seconds, texts = time / SECOND, state.texts
    if 0.0 <= seconds - texts.at.get(kind, -math.inf) < again:
        return Advance(state)
    at = MappingProxyType({**texts.at, kind: seconds})
    line = Log(f"{text} ({more})" if more else text, time)
    effects = (line, say(text)) if send else (line,)
    return Advance(replace(state, texts=replace(texts, at=at)), effects)


def tell_once(state: State, text: str, time: int) -> Advance:
    """Log and send a text that has not been told yet."""
    if text in state.texts.once:
        return Advance(state)
    return Advance(_mark(state, text)).then(tell, text, text, time, send=True)


def log_once(state: State, text: str, time: int, *, kind: str = "") -> Advance:
    """Log a text unless it, or one of its kind, has been logged."""
    if (kind or text) in state.texts.once:
        return Advance(state)
    return Advance(_mark(state, kind or text), (Log(text, time),))


def _mark(state: State, kind: str) -> State:
    return replace(state, texts=replace(state.texts, once=state.texts.once | {kind}))
