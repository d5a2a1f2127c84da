"""On which side of a fence of GeoJSON flight is allowed, in the words of those who draw them.

GeoJSON has no word for it. ``keep`` is ours; others write ``"Type": "Inclusive"``,
``"inclusion": true`` or ``"fence": "keep-in"``. What is said twice must agree.
"""

import re
from typing import Any

from envs.areas import AreaError, Keep

_IN = "in", "keepin", "stayin", "inclusion", "inclusive", "include", "included"
_OUT = "out", "keepout", "stayout", "exclusion", "exclusive", "exclude", "excluded"
_SIDES = dict.fromkeys(_IN, Keep.IN) | dict.fromkeys(_OUT, Keep.OUT)
_OTHER = {Keep.IN: Keep.OUT, Keep.OUT: Keep.IN}
_TRUTHS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
_NAMES = "name", "id", "identifier", "description"  # of an area: what they say is no side
_ABOUT = re.compile("fence|type|kind|side")  # names of properties whose "in" is no inch
_HINT = re.compile("inclusi|keepin|stayin")  # of what may mean a side to be kept in


def side_of(properties: dict[str, Any], where: str) -> Keep:
    """Return the side that the properties of a feature state; out where they state none.

    Raises:
        AreaError: they contradict each other, or say it in a way that is not understood.
    """
    sides: dict[str, Keep] = {}
    for key, value in properties.items():
        side = _side(key, value, where)
        if side is not None:
            sides[key] = side
    if len(set(sides.values())) > 1:
        stated = " and ".join(f"{key} {properties[key]!r:.60}" for key in sides)
        raise AreaError(f"{where}: states {stated}, expected one side to be kept on")
    return next(iter(sides.values()), Keep.OUT)


def _side(key: str, value: object, where: str) -> Keep | None:
    """Return the side that one property states; None: it is about something else."""
    name, word = _plain(key), _plain(value)
    if name == "keep":
        if word not in ("in", "out"):
            raise AreaError(f'{where}, {key}: is {value!r:.60}, expected "out" or "in"')
        return _SIDES[word]
    if name in _NAMES:
        return None
    flag = name.removeprefix("is")
    if flag in _SIDES and flag not in ("in", "out"):  # such as "inclusion": true
        if word not in _TRUTHS:
            raise AreaError(f"{where}, {key}: is {value!r:.60}, expected true or false")
        return _SIDES[flag] if _TRUTHS[word] else _OTHER[_SIDES[flag]]
    if word in _SIDES and (word not in ("in", "out") or _ABOUT.search(name)):
        return _SIDES[word]
    if _HINT.search(name) or _HINT.search(word):
        raise AreaError(f'{where}, {key}: is {value!r:.60}, expected "keep": "in" or "out"')
    return None


def _plain(text: object) -> str:
    """Return the letters and digits of a text, a number or a truth in lower case."""
    return re.sub(r"[^a-z0-9]", "", str(text).lower()) if isinstance(text, (str, int)) else ""
