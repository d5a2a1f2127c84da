"""Text from files on its way to a reader."""

import unicodedata

_HIDDEN = {"Cc", "Cf", "Zl", "Zp"}


def visible(text: str) -> str:
    """Return a text with its control and format characters, which may reverse what follows, as their codes.

    Line feeds stay.
    """
    return "".join(
        f"\\u{ord(each):04x}" if each != "\n" and unicodedata.category(each) in _HIDDEN else each for each in text
    )
