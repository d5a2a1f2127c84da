"""A scene's values as messages of ``rlcas_msgs``: the inverse of
:func:`ros_bridge.display.scene.take`.

A message is a mapping of its fields; those of plans and reports are in
:mod:`ros_bridge.core.message_fields`.
"""

from collections.abc import Mapping
from pathlib import Path

from ros_bridge.core.categories import BY_CATEGORY, text_of
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.guidance import Guidance
from ros_bridge.core.message_fields import Fields, header, time_fields
from ros_bridge.display.scene import Health, MonitorStatus

_FOLDER = Path(__file__).parents[1] / "rlcas_msgs" / "msg"
_OTHERS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "unique_identifier_msgs/UUID": "uint8[16] uuid",
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\nDiagnosticStatus[] status",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value",
}
"""The fields of ROS's own messages that stand in ours."""


def definition(kind: str) -> str:
    """Return the definition of a message (``rlcas_msgs/msg/Areas``) and its parts."""
    first = kind.replace("/msg/", "/")
    texts: dict[str, str] = {}
    waiting = [first]
    while waiting:
        definition_name = waiting.pop(0)
        if definition_name in texts:
            continue
        package, _, name = definition_name.partition("/")
        file = _FOLDER / f"{name}.msg"
        texts[definition_name] = (
            file.read_text("utf-8") if package == "rlcas_msgs" else _OTHERS[definition_name]
        )
        waiting += _parts(package, texts[definition_name])
    parts = [
        f"MSG: {definition_name}\n{text}"
        for definition_name, text in texts.items()
        if definition_name != first
    ]
    return f"\n{'=' * 80}\n".join([texts[first], *parts])


def _parts(package: str, text: str) -> list[str]:
    """Return the messages that a definition's fields are of."""
    lines = (line.partition("#")[0].split() for line in text.splitlines())
    kinds = {words[0].partition("[")[0] for words in lines if words}
    names = {kind if "/" in kind else f"{package}/{kind}" for kind in kinds}
    return sorted(full_name for full_name in names if full_name in _OTHERS or _is_ours(full_name))


def _is_ours(kind: str) -> bool:
    package, _, name = kind.partition("/")
    return package == "rlcas_msgs" and (_FOLDER / f"{name}.msg").is_file()


def clock(moment: int) -> Fields:
    """Return a Clock."""
    return {"clock": time_fields(moment)}


def status(monitor: MonitorStatus, revision: int) -> Fields:
    """Return an AssuranceStatus of the plan of a revision."""
    return {
        **header(monitor.time),
        **monitor.status.fields(),
        "trajectory_revision": revision,
        "runner_silence": -1.0,
    }


def guidance(bands: Guidance) -> Fields:
    """Return a GuidanceBands."""
    return {**header(bands.time), **bands.fields()}


def diagnostics(
    nodes: Mapping[str, Health],
    separation: float | None,
    by_category: Mapping[int, float],
    fresh: Freshness,
    moment: int,
) -> Fields:
    """Return a DiagnosticArray; the separation, m, those by category, and for how long things count
    stand beside each state of health.
    """
    texts = {BY_CATEGORY: text_of(by_category), **fresh.texts()}
    values = [{"key": key, "value": text} for key, text in texts.items()]
    if separation is not None:
        values.append({"key": "separation, m", "value": f"{separation:g}"})
    statuses = [
        {"level": health.level, "name": name, "message": health.text, "values": values}
        for name, health in nodes.items()
    ]
    return {**header(moment), "status": statuses}
