"""Which of several names a wrong one may mean, for the sentence that refuses it."""

import difflib
from collections.abc import Iterable


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Return the one of the words that is most like the given one, None if none is."""
    return next(iter(difflib.get_close_matches(word, list(words), n=1, cutoff=0.5)), None)


def one_of(word: str, words: Iterable[str], more: str = "") -> str:
    """Return the end of a refusal of a word: which ones are expected, what else (``more``), and
    which of them may be meant.
    """
    words = list(words)
    choices = [f"one of {', '.join(words)}"] if words else []
    expected = ", or ".join(choices + ([more] if more else []))
    close = nearest(word, words)
    return f"expected {expected}" + (f"; did you mean {close}?" if close else "")
