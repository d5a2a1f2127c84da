"""A mutant: one change of the code that some test must notice."""

from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]


class Mutant(NamedTuple):
    """One change of the code."""

    file: str
    text: str  # that stands once in the file
    replacement: str
    tests: tuple[str, ...]  # to run: files, the quickest first


def mutants_of(
    file: str, changes: tuple[tuple[str, str], ...], tests: tuple[str, ...]
) -> tuple[Mutant, ...]:
    """Return the mutants of a file: texts and replacements."""
    return tuple(Mutant(file, text, replacement, tests) for text, replacement in changes)


def mutated(mutant: Mutant, source: str) -> str:
    """Return the text of a file with a mutant's change.

    Raises ValueError where the changed text does not stand in it once.
    """
    times = source.count(mutant.text)
    if times != 1:
        raise ValueError(f"{mutant.file}: {mutant.text!r} stands there {times} times; expected 1")
    return source.replace(mutant.text, mutant.replacement)
