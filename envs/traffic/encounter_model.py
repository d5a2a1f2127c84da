"""Public Bayesian models of uncorrelated air traffic: the files of MIT Lincoln Laboratory's
encounter models.

A model is a dynamic Bayesian network. The initial network draws airspace class, altitude layer,
airspeed, acceleration, vertical rate and turn rate; the transition network draws the last three
anew each second. A file is a text of blocks, each with a line ``# name``:

``labels_initial``, ``labels_transition``
    names of the variables, in quotes, between commas

``G_initial``, ``G_transition``
    a row a variable: 1 under each variable that it is a parent of

``r_initial``, ``r_transition``
    how many bins each variable has

``N_initial``, ``N_transition``
    counts, variable after variable, bin after bin, the first parent fastest; of the transition
    network only the variables at t+1

``boundaries``
    a line an initial variable: edges of its bins, or ``*`` for a category

``resample_rates``
    chance a second that a value is drawn anew inside its bin

A model without airspeed, acceleration and turn rate is of what drifts, such as balloons: it stands
still in the air mass, and climbs and descends.

The units stand nowhere in the file, they are those of the form: kt, kt/s, ft/min, deg/s clockwise,
ft above ground. (Kochenderfer et al., Uncorrelated encounter model of the National Airspace System,
ATC-345, 2008.)
"""

import math
import os
import re
from graphlib import CycleError, TopologicalSorter
from typing import NamedTuple

import numpy as np

from commands.text_file import lines_of, number_of
from envs.encounters import EncounterError

SPEED, ACCELERATION, CLIMB, TURN = "v", r"\dot v", r"\dot h", r"\dot \psi"
"""Names of the variables that make a track."""

LAYER = "L"
"""Name of the altitude layer, ft above ground."""

_BLOCKS = (
    "labels_initial",
    "G_initial",
    "r_initial",
    "N_initial",
    "labels_transition",
    "G_transition",
    "r_transition",
    "N_transition",
    "boundaries",
    "resample_rates",
)
_FLYING = (SPEED, ACCELERATION, TURN)
_RANGES = {
    SPEED: (0.0, 2_000.0),
    ACCELERATION: (-500.0, 500.0),
    CLIMB: (-50_000.0, 50_000.0),
    TURN: (-180.0, 180.0),
}
"""Of the edges of bins, in the form's units; of other variables -1e6 to 1e6."""

_MOST_BINS = 1_000
_LARGEST = 1e15
_MOST_COUNTS = 5_000_000


class Variable(NamedTuple):
    """A variable of a network."""

    name: str  # without the time
    bins: int
    parents: tuple[int, ...]  # places in the network, ascending
    counts: np.ndarray
    """``[C, bins]``: how often each bin was seen under each configuration of the parents, the first
    parent fastest.
    """


class EncounterModel(NamedTuple):
    """A dynamic Bayesian network of one aircraft."""

    initial: tuple[Variable, ...]
    transition: tuple[Variable, ...]
    """Variables at t + 1; their parents are places in the initial network's variables at t,
    followed by these.
    """
    moving: tuple[int, ...]  # place in the initial network of each variable of the transition
    boundaries: tuple[np.ndarray | None, ...]
    """Edges of the bins of each initial variable, ``[bins + 1]``, in the form's units; None for a
    category.
    """
    rates: np.ndarray
    """Chance a second that a value of each initial variable is drawn anew inside its bin."""

    def place(self, name: str) -> int:
        """Return the place of an initial variable; a ValueError where there is none of this
        name.
        """
        return [variable.name for variable in self.initial].index(name)


def read_model(path: str | os.PathLike[str]) -> EncounterModel:
    """Read a model.

    Raises:
        EncounterError: the file cannot be read or is not as documented; the message names file,
            line and block.
    """
    file = _File(os.fspath(path))
    names = [_bare(name) for name in file.labels("labels_initial")]
    later = file.labels("labels_transition")
    drifts = CLIMB in names and not {*_FLYING} & {*names}
    needed = (CLIMB,) if drifts else _FLYING
    for name in needed:
        if name not in names:
            raise file.error("labels_initial", f": no variable {name!r}, expected one")
    moving = _moving(file, names, later, [name for name in needed if name != SPEED])
    bins, all_bins = _bins(file, names, later, moving)
    parents = _parents(file, "G_initial", names)
    all_parents = _parents(file, "G_transition", later)
    for label, label_parents in zip(later, all_parents[: len(names)], strict=False):
        if label_parents:
            raise file.error("G_transition", f": {label!r} at time t has a parent, expected none")
    initial = _variables(file, "N_initial", names, bins, parents)
    changing = [names[i] for i in moving]
    transition = _variables(
        file, "N_transition", changing, all_bins, all_parents[len(names) :], len(names)
    )
    edges = _boundaries(file, names, bins)
    for name in {*needed, *changing}:
        if edges[names.index(name)] is None:
            raise file.error("boundaries", f", variable {name!r}: '*', expected edges")
    rates = file.numbers("resample_rates", len(names), low=0.0, high=1.0)
    return EncounterModel(initial, transition, moving, edges, rates)


class _File:
    """The blocks of a file; raises an EncounterError where one is missing, empty or twice there."""

    def __init__(self, source: str) -> None:
        self._source = source
        self.blocks: dict[str, list[tuple[int, str]]] = {}
        """Lines of each block, with their numbers from 1."""
        name, begins = "", {}
        for number, line in enumerate(lines_of(source, EncounterError), start=1):
            line = line.strip()  # noqa: PLW2901
            where = f"{source} line {number}"
            if line.startswith("#"):
                name = line[1:].strip()
                if name not in _BLOCKS:
                    raise EncounterError(
                        f"{where}: block {name!r}, expected one of {', '.join(_BLOCKS)}"
                    )
                if name in self.blocks:
                    raise EncounterError(f"{where}: block {name} stands twice, expected it once")
                self.blocks[name], begins[name] = [], number
            elif line and not name:
                raise EncounterError(
                    f"{where}: {line[:20]!r}, expected a line with # and a block's name"
                )
            elif line:
                self.blocks[name].append((number, line))
        for block in _BLOCKS:
            if block not in self.blocks:
                raise EncounterError(
                    f"{source}: no block {block}, expected one (a file that is cut off?)"
                )
            if not self.blocks[block]:
                raise EncounterError(
                    f"{source} line {begins[block]}: block {block} is empty, expected values"
                )

    def error(self, block: str, problem: str, row: int = 0) -> EncounterError:
        """Return an error about a row of a block."""
        return EncounterError(
            f"{self._source} line {self.blocks[block][row][0]}, block {block}{problem}"
        )

    def rows(self, block: str, count: int) -> list[str]:
        """Return the lines of a block that has so many."""
        lines = [line for _, line in self.blocks[block]]
        if len(lines) != count:
            raise self.error(block, f": {len(lines)} lines, expected {count}")
        return lines

    def labels(self, block: str) -> list[str]:
        """Return the names of variables."""
        (line,) = self.rows(block, 1)
        labels = [label.strip() for label in re.findall(r'"([^"]*)"', line)]
        leftover = re.sub(r'"[^"]*"', "", line).replace(",", "").strip()
        if not labels or leftover or len(set(labels)) != len(labels) or not all(labels):
            raise self.error(block, ": expected different names in quotes between commas")
        return labels

    def numbers(
        self, block: str, count: int, row: int | None = None, *,
        of: str = "", low: float = -_LARGEST, high: float = _LARGEST, whole: bool = False,
    ) -> np.ndarray:  # fmt: skip
        """Return so many numbers within a range, of a block's only line or of a row of it."""
        text = self.rows(block, 1)[0] if row is None else self.blocks[block][row][1]
        kind, row = "whole numbers" if whole else "numbers", row or 0
        word, values = "", []
        try:
            for word in text.split(maxsplit=_MOST_COUNTS):
                values.append(number_of(word))
        except ValueError:
            raise self.error(block, f"{of}: {word[:40]!r}, expected {kind}", row) from None
        parsed = np.array(values)
        if len(parsed) != count:
            cut = f"{len(parsed)} numbers, expected {count} (a file that is cut off?)"
            raise self.error(block, f"{of}: {cut}", row)
        valid = (parsed >= low) & (parsed <= high) & ((parsed == np.round(parsed)) | (not whole))
        if not valid.all():
            bounds = f"expected {kind} from {low:g} to {high:g}"
            raise self.error(block, f"{of}: {parsed[~valid][0]:g}, {bounds}", row)
        return parsed


def _bare(label: str) -> str:
    """Return a variable's name without its time."""
    return re.sub(r"\(t(\+1)?\)$", "", label).strip()


def _moving(file: _File, names: list[str], later: list[str], needed: list[str]) -> tuple[int, ...]:
    """Return the place in the initial network of each variable at t + 1, among which are those that
    are needed.
    """
    block, current = "labels_transition", later[: len(names)]
    if [_bare(label) for label in current] != names or any(
        label.endswith("(t+1)") for label in current
    ):
        raise file.error(block, ": expected first the variables of labels_initial, at time t")
    places = []
    for label in later[len(names) :]:
        if not label.endswith("(t+1)") or _bare(label) not in names:
            raise file.error(
                block, f": {label!r}, expected a variable of labels_initial with (t+1)"
            )
        places.append(names.index(_bare(label)))
    for name in needed:
        if names.index(name) not in places:
            raise file.error(block, f": no variable {name + '(t+1)'!r}, expected one")
    return tuple(places)


def _bins(
    file: _File, names: list[str], later: list[str], moving: tuple[int, ...]
) -> tuple[list[int], list[int]]:
    """Return how many bins the variables of the initial and of the transition network have; a
    variable has as many in both.
    """
    bins, all_bins = (
        file.numbers(block, len(labels), low=1, high=_MOST_BINS, whole=True).astype(int).tolist()
        for block, labels in (("r_initial", names), ("r_transition", later))
    )
    for i, place in enumerate([*range(len(names)), *moving]):
        if all_bins[i] != bins[place]:
            expected = f"expected {bins[place]} as of {names[place]!r} in r_initial"
            raise file.error(
                "r_transition", f", variable {later[i]!r}: {all_bins[i]} bins, {expected}"
            )
    return bins, all_bins


def _parents(file: _File, block: str, labels: list[str]) -> list[tuple[int, ...]]:
    """Return the parents of each variable; a graph with a circle is refused."""
    count = len(labels)
    file.rows(block, count)
    graph = np.array(
        [file.numbers(block, count, i, low=0, high=1, whole=True) for i in range(count)]
    )
    parents = [tuple(np.flatnonzero(graph[:, i]).tolist()) for i in range(count)]
    try:
        TopologicalSorter(dict(enumerate(parents))).prepare()
    except CycleError as error:
        raise file.error(
            block, f": {labels[error.args[1][0]]!r} is its own ancestor, expected none"
        ) from None
    return parents


def _variables(
    file: _File,
    block: str,
    names: list[str],
    bins: list[int],
    parents: list[tuple[int, ...]],
    skipped: int = 0,
) -> tuple[Variable, ...]:
    """Return the last variables of a network, ``skipped`` of whose sizes come first, with their
    counts.
    """
    shapes = [
        (math.prod(bins[j] for j in places), bins[skipped + i]) for i, places in enumerate(parents)
    ]
    ends = np.cumsum([math.prod(shape) for shape in shapes], dtype=object)
    total = ends[-1]
    if total > _MOST_COUNTS:
        raise file.error(
            block, f": the graph asks for {total} counts, expected at most {_MOST_COUNTS}"
        )
    values = file.numbers(block, total, low=0.0)
    variables = []
    for name, places, shape, part in zip(
        names, parents, shapes, np.split(values, ends[:-1].astype(int)), strict=True
    ):
        if not places and not part.any():
            raise file.error(
                block, f", variable {name!r}: all counts are 0, expected some that are not"
            )
        variables.append(Variable(name, shape[1], places, part.reshape(shape)))
    return tuple(variables)


def _boundaries(file: _File, names: list[str], bins: list[int]) -> tuple[np.ndarray | None, ...]:
    """Return the edges of each variable's bins, None of a category."""
    block, edges = "boundaries", []
    for i, line in enumerate(file.rows(block, len(names))):
        if line == "*":
            edges.append(None)
            continue
        of = f", variable {names[i]!r}"
        low, high = _RANGES.get(names[i], (-1e6, 1e6))
        values = file.numbers(block, bins[i] + 1, i, of=of, low=low, high=high)
        if (np.diff(values) <= 0.0).any():
            raise file.error(block, f"{of}: expected edges that increase, or *", i)
        edges.append(values)
    return tuple(edges)
