"""What is said of a judgement: the advice, why the monitor is not content, what is assumed and left
out.
"""

import math
from dataclasses import replace

from agents.assurance.backup import Sense
from agents.assurance.state import FlyMode
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.assurance import fly_mode
from ros_bridge.core.conversions import Published
from ros_bridge.core.feeds.traffic import OWN_TRACES
from ros_bridge.core.fields import readable
from ros_bridge.mavlink.clocks import Moment
from ros_bridge.mavlink.conflict import Conflict
from ros_bridge.mavlink.effects import Log, WritePlan
from ros_bridge.mavlink.link import RACING
from ros_bridge.mavlink.state import Advance, State
from ros_bridge.mavlink.texts import log_once, tell, tell_once

_LEVEL = 5.0  # m by which a plan that is told as level may climb
_DOES = {Sense.LEVEL_OFF: "level", Sense.CLIMB: "climbing", Sense.DESCEND: "descending"}


def advise(state: State, time: int, engage: float) -> Advance:
    """Tell of a conflict that is nearer than ``engage``, s, and of the plan round it."""
    judgement = state.judgement
    conflict, problem = judgement.conflict, judgement.problem
    if conflict is None or conflict.time > engage:
        return tell(state, "problem", problem, time, send=True) if problem else Advance(state)
    return _advise_on(state, conflict, time)


def _advise_on(state: State, conflict: Conflict, time: int) -> Advance:
    plan, safe = state.judgement.plan, state.is_safe(time)
    kind = f"conflict {conflict.name} {safe}"
    text = f"{conflict.name} in {conflict.time:.0f} s: "
    if plan is None:
        return tell(state, kind, f"{text}no plan, {state.judgement.problem}", time, send=True)
    if not safe:
        reasons = "; ".join(reason.message for reason in plan.reasons)
        more = reasons or "the program has been late"
        return tell(state, kind, f"{text}no plan is safe", time, send=True, more=more)
    first = plan.waypoints[0]
    turn = f"{math.degrees(0.5 * math.pi - first.heading) % 360.0:.0f} deg"
    text += (
        f"plan by {turn}, {first.speed:.0f} m/s"
        f"{_climb_of(state.judgement.supervision.published_plan)}"
    )
    announced = tell(state, kind, text, time, send=True, more=f"rejoins {plan.goal_index}")
    return announced.then(write_plan) if announced.effects else announced


def _climb_of(plan: Published | None) -> str:
    """Return what is told of a plan's altitude: the one that it climbs or descends to first."""
    if plan is None or plan.start.altitude is None or not plan.climbs:
        return ""
    begin = plan.start.altitude.value
    heights = [point.altitude.value for point in plan.points if point.altitude is not None]
    farthest = max(heights, key=lambda height: abs(height - begin))
    if abs(farthest - begin) < _LEVEL:
        return ""
    return f", {'climb' if farthest > begin else 'descend'} to {farthest:.0f} m"


def write_plan(state: State) -> Advance:
    """Write what is flown or advised."""
    plan = state.judgement.supervision.published_plan
    return Advance(state, () if plan is None else (WritePlan(plan),))


def explain(state: State, time: int) -> Advance:
    """Log why the monitor is not content, where that changes, and say that a backup is flown."""
    judged, problem = state.judgement.supervision, state.judgement.problem
    assessment = judged.assessment
    reasons = () if assessment is None else assessment.reasons
    monitor = "" if assessment is None else assessment.state.name
    causes = frozenset(reason.cause for reason in reasons)
    after = Advance(state)
    if causes != state.texts.causes:
        text = "; ".join(reason.message for reason in reasons) or "no remark"
        texts = replace(state.texts, causes=causes)
        after = Advance(replace(state, texts=texts), (Log(f"{monitor}: {text}", time),))
    if problem:
        after = after.then(tell, f"replan {monitor}", f"no plan: {problem}", time, send=False)
    return after.then(_tell_backup, time) if fly_mode(judged) is FlyMode.BACKUP else after


def _tell_backup(state: State, time: int) -> Advance:
    """Say what a backup does up and down, and whether it keeps the separation."""
    judged = state.judgement.supervision
    text, backup = "backup", judged.monitor.backup
    if judged.thresholds.options.climbs:
        text += f", {_DOES[Sense(int(backup.sense[0]))]}"
    if not backup.safe[0]:
        text += ": separation not assured"
    return tell(state, text, text, time, send=True)


def remark(state: State, time: int) -> Advance:
    """Log what is assumed, such as an accuracy that nobody sends: each once."""
    after = Advance(state)
    for text in state.judgement.remarks:
        after = after.then(log_once, text, time)
    return after.then(_remark_fence, time)


def _remark_fence(state: State, time: int) -> Advance:
    """Tell what of another fence lies too far away to count, or was clipped or thinned."""
    situation = state.received.situation
    fence, own = situation.fixed_areas, situation.own.last
    if own is None or fence == state.texts.fence:
        return Advance(state)
    state = replace(state, texts=replace(state.texts, fence=fence))
    frame = LocalFrame(own.latitude, own.longitude)
    placed = readable(lambda: situation.fixed_in(frame, time))
    if placed is None:  # plans are refused, and say why
        return Advance(state)
    after = Advance(state, tuple(Log(f"warning: {change}", time) for change in placed.changes))
    if placed.far:
        text = "fence: areas far away do not count"
        after = after.then(tell, "fence far", text, time, send=True, more=placed.far)
    return after


def tell_left_out(state: State, time: int, *, foreign: bool) -> Advance:
    """Say, once for each reason, that something is not taken as traffic, or is although a field
    forbids it; and that somebody else sends under the autopilot's numbers.
    """
    view = state.view(time)
    texts = [
        f"left out of traffic: {reason}" for reason in view.left_out if reason not in OWN_TRACES
    ]
    texts += [f"traffic: {reason}" for reason in view.doubted]
    if foreign:
        texts.append("another sender has the autopilot's numbers, and is not listened to")
    after = Advance(state)
    for text in texts:
        after = after.then(tell_once, text, time)
    return after


def tell_speed(state: State, moment: Moment, deadline: float) -> Advance:
    """Say, once, that a simulation runs too fast for what is promised; ``deadline`` in s."""
    if not moment.races:
        return Advance(state)
    text = (
        f"warning: the simulation runs {moment.speed:.1f} times as fast as real time, and so "
        f"{deadline:g} s of computing take {moment.speed * deadline:.1f} s of its time; expected "
        f"{RACING:g} times at most"
    )
    return log_once(state, text, moment.time, kind="speed")
