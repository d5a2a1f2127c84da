"""Public Bayesian models of uncorrelated air traffic: the files of MIT Lincoln Laboratory's encounter models.

A model is a dynamic Bayesian network. The initial network draws airspace class, altitude layer, airspeed, acceleration,
vertical rate and turn rate; the transition network draws the last three anew each second. A file is a text of blocks,
each with a line ``# name``:

``labels_initial``, ``labels_transition``  names of the variables, in quotes, between commas
``G_initial``, ``G_transition``            a row a variable: 1 under each variable that it is a parent of
``r_initial``, ``r_transition``            how many bins each variable has
``N_initial``, ``N_transition``            counts, variable after variable, bin after bin, the first parent fastest;
                                           of the transition network only the variables at t+1
``boundaries``                             a line an initial variable: edges of its bins, or ``*`` for a category
``resample_rates``                         chance a second that a value is drawn anew inside its bin

The units stand nowhere in the file, they are those of the form: kt, kt/s, ft/min, deg/s clockwise, ft above ground.
(Kochenderfer et al., Uncorrelated encounter model of the National Airspace System, ATC-345, 2008.)
"""

import math
import os
import re
from typing import NamedTuple

import numpy as np

from envs.encounters import EncounterError
from envs.traffic.text_file import lines_of

__all__ = ["ACCELERATION", "CLIMB", "SPEED", "TURN", "EncounterModel", "Variable", "read_model", "write_model"]

SPEED, ACCELERATION, CLIMB, TURN = "v", r"\dot v", r"\dot h", r"\dot \psi"
"""Names of the variables that make a track."""

_BLOCKS = (
    *("labels_initial", "G_initial", "r_initial", "N_initial"),
    *("labels_transition", "G_transition", "r_transition", "N_transition"),
    *("boundaries", "resample_rates"),
)
_NEEDED = (SPEED, ACCELERATION, TURN)
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

    name: str
    """Without the time."""
    bins: int
    parents: tuple[int, ...]
    """Places in the network, ascending."""
    counts: np.ndarray
    """``[C, bins]``: how often each bin was seen under each configuration of the parents, the first parent fastest."""


class EncounterModel(NamedTuple):
    """A dynamic Bayesian network of one aircraft."""

    initial: tuple[Variable, ...]
    transition: tuple[Variable, ...]
    """Variables at t + 1; their parents are places in the initial network's variables at t, followed by these."""
    moving: tuple[int, ...]
    """Place in the initial network of each variable of the transition."""
    boundaries: tuple[np.ndarray | None, ...]
    """Edges of the bins of each initial variable, ``[bins + 1]``, in the form's units; None for a category."""
    rates: np.ndarray
    """Chance a second that a value is drawn anew inside its bin, of each initial variable."""

    def place(self, name: str) -> int:
        """Return the place of an initial variable.

        Raises:
            ValueError: there is none of this name.
        """
        return [variable.name for variable in self.initial].index(name)


def read_model(path: str | os.PathLike[str]) -> EncounterModel:
    """Read a model.

    Raises:
        EncounterError: the file cannot be read or is not as documented; the message names file, line and block.
    """
    source = os.fspath(path)
    blocks = _blocks(source)
    names = [_bare(name) for name in _labels(source, blocks, "labels_initial")]
    later = _labels(source, blocks, "labels_transition")
    for name in _NEEDED:
        if name not in names:
            raise EncounterError(f"{_where(source, blocks, 'labels_initial')}: no variable {name!r}, expected one")
    moving = _moving(source, blocks, names, later)
    bins = _sizes(source, blocks, "r_initial", len(names))
    all_bins = _sizes(source, blocks, "r_transition", len(later))
    for i, place in enumerate([*range(len(names)), *moving]):
        if all_bins[i] != bins[place]:
            raise EncounterError(
                f"{_where(source, blocks, 'r_transition')}, variable {later[i]!r}: {all_bins[i]} bins, expected "
                f"{bins[place]} as of {names[place]!r} in r_initial"
            )
    parents = _parents(source, blocks, "G_initial", names)
    all_parents = _parents(source, blocks, "G_transition", later)
    for i in range(len(names)):
        if all_parents[i]:
            raise EncounterError(
                f"{_where(source, blocks, 'G_transition')}: {later[i]!r} at time t has a parent, expected none"
            )
    first = _variables(source, blocks, "N_initial", names, bins, parents)
    second = _variables(
        source, blocks, "N_transition", [names[i] for i in moving], all_bins, all_parents[len(names) :], len(names)
    )
    edges = _boundaries(source, blocks, names, bins)
    for name in {*_NEEDED, *(names[i] for i in moving)}:
        if edges[names.index(name)] is None:
            raise EncounterError(f"{_where(source, blocks, 'boundaries')}, variable {name!r}: '*', expected edges")
    return EncounterModel(first, second, moving, edges, _rates(source, blocks, len(names)))


def write_model(model: EncounterModel) -> str:
    """Return the text of a file that :func:`read_model` gives back."""
    names = [variable.name for variable in model.initial]
    static = set(range(len(names))) - set(model.moving)
    later = [names[i] if i in static else f"{names[i]}(t)" for i in range(len(names))]
    later += [f"{names[i]}(t+1)" for i in model.moving]

    def graph(children: tuple[tuple[int, ...], ...]) -> list[str]:
        size = len(children)
        return [" ".join("1" if row in children[child] else "0" for child in range(size)) for row in range(size)]

    def counts(variables: tuple[Variable, ...]) -> str:
        return " ".join(f"{value:.17g}" for variable in variables for value in variable.counts.ravel())

    first, none = tuple(v.parents for v in model.initial), ((),) * len(names)
    bins = [variable.bins for variable in model.initial]
    quoted = [", ".join(f'"{name}"' for name in group) for group in (names, later)]
    edges = ["*" if e is None else " ".join(f"{x:.17g}" for x in e) for e in model.boundaries]
    lines = [
        *("# labels_initial", quoted[0], "# G_initial", *graph(first)),
        *("# r_initial", " ".join(map(str, bins)), "# N_initial", counts(model.initial)),
        *("# labels_transition", quoted[1]),
        *("# G_transition", *graph((*none, *(v.parents for v in model.transition)))),
        *("# r_transition", " ".join(str(b) for b in [*bins, *(v.bins for v in model.transition)])),
        *("# N_transition", counts(model.transition), "# boundaries", *edges),
        *("# resample_rates", " ".join(f"{rate:.17g}" for rate in model.rates)),
    ]
    return "\n".join(lines) + "\n"


_Blocks = dict[str, tuple[int, list[tuple[int, str]]]]
"""Of each block the number of its line and its lines with their numbers, from 1."""


def _blocks(source: str) -> _Blocks:
    found: _Blocks = {}
    name = ""
    for number, line in enumerate(lines_of(source, EncounterError), start=1):
        line = line.strip()  # noqa: PLW2901
        if line.startswith("#"):
            name = line[1:].strip()
            if name not in _BLOCKS:
                raise EncounterError(f"{source} line {number}: block {name!r}, expected one of {', '.join(_BLOCKS)}")
            if name in found:
                raise EncounterError(f"{source} line {number}: block {name} stands twice, expected it once")
            found[name] = (number, [])
        elif line:
            if not name:
                raise EncounterError(
                    f"{source} line {number}: {line[:20]!r}, expected a line with # and a block's name"
                )
            found[name][1].append((number, line))
    for wanted in _BLOCKS:
        if wanted not in found:
            raise EncounterError(f"{source}: no block {wanted}, expected one (a file that is cut off?)")
        if not found[wanted][1]:
            raise EncounterError(f"{source} line {found[wanted][0]}: block {wanted} is empty, expected values")
    return found


def _where(source: str, blocks: _Blocks, name: str, row: int = 0) -> str:
    return f"{source} line {blocks[name][1][row][0]}, block {name}"


def _bare(label: str) -> str:
    """Return a label without the time."""
    return re.sub(r"\(t(\+1)?\)$", "", label).strip()


def _labels(source: str, blocks: _Blocks, name: str) -> list[str]:
    line = _single(source, blocks, name)
    labels = re.findall(r'"([^"]*)"', line)
    rest = re.sub(r'"[^"]*"', "", line).replace(",", "").strip()
    if not labels or rest or len(set(labels)) != len(labels) or not all(label.strip() for label in labels):
        raise EncounterError(f"{_where(source, blocks, name)}: expected different names in quotes between commas")
    return [label.strip() for label in labels]


def _single(source: str, blocks: _Blocks, name: str) -> str:
    lines = blocks[name][1]
    if len(lines) != 1:
        raise EncounterError(f"{_where(source, blocks, name)}: {len(lines)} lines, expected one")
    return lines[0][1]


def _numbers(text: str, where: str) -> np.ndarray:
    words = text.split(maxsplit=_MOST_COUNTS)
    try:
        values = np.array([_number(word) for word in words], dtype=np.float64)
    except ValueError as problem:
        raise EncounterError(f"{where}: {problem}, expected numbers") from None
    wrong = ~(abs(values) <= _LARGEST)
    if wrong.any():
        raise EncounterError(f"{where}: {values[wrong][0]}, expected numbers from {-_LARGEST:g} to {_LARGEST:g}")
    return values


def _number(word: str) -> float:
    try:
        if "_" in word:
            raise ValueError
        return float(word)
    except ValueError:
        raise ValueError(repr(word[:40])) from None


def _sizes(source: str, blocks: _Blocks, name: str, count: int) -> list[int]:
    where = _where(source, blocks, name)
    values = _numbers(_single(source, blocks, name), where)
    if len(values) != count:
        raise EncounterError(f"{where}: {len(values)} numbers of bins, expected {count}, one for each variable")
    wrong = values[(values != np.round(values)) | (values < 1.0) | (values > _MOST_BINS)]
    if wrong.size:
        raise EncounterError(f"{where}: {wrong[0]:g} bins, expected whole numbers from 1 to {_MOST_BINS}")
    return [int(value) for value in values]


def _moving(source: str, blocks: _Blocks, names: list[str], later: list[str]) -> tuple[int, ...]:
    """Return the place in the initial network of each variable at t + 1."""
    where = _where(source, blocks, "labels_transition")
    if [_bare(label) for label in later[: len(names)]] != names or any(
        label.endswith("(t+1)") for label in later[: len(names)]
    ):
        raise EncounterError(f"{where}: expected first the variables of labels_initial, at time t")
    places = []
    for label in later[len(names) :]:
        if not label.endswith("(t+1)") or _bare(label) not in names:
            raise EncounterError(f"{where}: {label!r}, expected a variable of labels_initial with (t+1)")
        places.append(names.index(_bare(label)))
    for name in (ACCELERATION, TURN):
        if names.index(name) not in places:
            raise EncounterError(f"{where}: no variable {name + '(t+1)'!r}, expected one")
    return tuple(places)


def _parents(source: str, blocks: _Blocks, name: str, labels: list[str]) -> list[tuple[int, ...]]:
    """Return the parents of each variable; a graph with a circle is refused."""
    lines, count = blocks[name][1], len(labels)
    if len(lines) != count:
        raise EncounterError(f"{_where(source, blocks, name)}: {len(lines)} rows, expected {count}, one a variable")
    rows = []
    for i, (_, line) in enumerate(lines):
        where = _where(source, blocks, name, i)
        values = _numbers(line, where)
        if len(values) != count or not np.isin(values, (0.0, 1.0)).all():
            raise EncounterError(f"{where}: expected {count} times 0 or 1")
        rows.append(values)
    graph = np.array(rows, bool)
    left = set(range(count))
    while left:
        free = [i for i in left if not any(graph[j, i] for j in left)]
        if not free:
            raise EncounterError(
                f"{_where(source, blocks, name)}: {labels[min(left)]!r} is its own ancestor, expected none"
            )
        left -= set(free)
    return [tuple(np.flatnonzero(graph[:, i]).tolist()) for i in range(count)]


def _variables(
    source: str,
    blocks: _Blocks,
    block: str,
    names: list[str],
    bins: list[int],
    parents: list[tuple[int, ...]],
    skipped: int = 0,
) -> tuple[Variable, ...]:
    """Return the last variables of a network, ``skipped`` of whose sizes come first, with their counts."""
    shapes = [(math.prod(bins[j] for j in each), bins[skipped + i]) for i, each in enumerate(parents)]
    wanted = sum(configurations * size for configurations, size in shapes)
    where = _where(source, blocks, block)
    if wanted > _MOST_COUNTS:
        raise EncounterError(f"{where}: the graph asks for {wanted} counts, expected at most {_MOST_COUNTS}")
    values = _numbers(_single(source, blocks, block), where)
    if len(values) != wanted:
        raise EncounterError(f"{where}: {len(values)} counts, expected {wanted} (a file that is cut off?)")
    if (values < 0.0).any():
        raise EncounterError(f"{where}: count {values[values < 0.0][0]:g}, expected 0 or more")
    made, begin = [], 0
    for name, each, (configurations, size) in zip(names, parents, shapes, strict=True):
        end = begin + configurations * size
        counts = values[begin:end].reshape(configurations, size)
        if not each and not counts.any():
            raise EncounterError(f"{where}, variable {name!r}: all counts are 0, expected some that are not")
        made.append(Variable(name, size, each, counts))
        begin = end
    return tuple(made)


def _boundaries(source: str, blocks: _Blocks, names: list[str], bins: list[int]) -> tuple[np.ndarray | None, ...]:
    lines = blocks["boundaries"][1]
    if len(lines) != len(names):
        raise EncounterError(
            f"{_where(source, blocks, 'boundaries')}: {len(lines)} lines, expected {len(names)}, one a variable"
        )
    edges: list[np.ndarray | None] = []
    for i, (_, line) in enumerate(lines):
        where = f"{_where(source, blocks, 'boundaries', i)}, variable {names[i]!r}"
        if line == "*":
            edges.append(None)
            continue
        values = _numbers(line, where)
        if len(values) != bins[i] + 1 or (np.diff(values) <= 0.0).any():
            raise EncounterError(f"{where}: expected {bins[i] + 1} edges that increase, or *")
        low, high = _RANGES.get(names[i], (-1e6, 1e6))
        if values[0] < low or values[-1] > high:
            raise EncounterError(f"{where}: {values[0]:g} to {values[-1]:g}, expected within {low:g} to {high:g}")
        edges.append(values)
    return tuple(edges)


def _rates(source: str, blocks: _Blocks, count: int) -> np.ndarray:
    where = _where(source, blocks, "resample_rates")
    values = _numbers(_single(source, blocks, "resample_rates"), where)
    if len(values) != count or (values < 0.0).any() or (values > 1.0).any():
        raise EncounterError(f"{where}: expected {count} chances a second, 0 to 1")
    return values
