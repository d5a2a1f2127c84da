"""Networks in the ``.nnet`` text format, and the advisory logics of the field that come in it.

The format (K. Julian, Stanford, 2016) is a text: the number of layers, inputs, outputs and the widest layer; the
layers' sizes; a line without use; minima, maxima, means and ranges of the inputs, the last two with one more for all
outputs; then for each layer its weights, a line a row, and its biases, a line each. Comment lines, which begin with
``//``, and blank lines may stand anywhere, a byte order mark at the beginning.

Two logics are known by the number of inputs. HorizontalCAS has 3 (intruder ahead ft, left ft, relative heading rad)
and advises what scores highest; ACAS Xu has 5 (distance ft, bearing rad, relative heading rad, both speeds ft/s) and
advises what scores lowest. Both have five outputs: clear of conflict, weak left, weak right, strong left, strong right
(1.5 and 3 deg/s), and one network for each advisory that went before.
"""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines.baselines import Sight, checked, course_to_goal, may_return, steered
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.edge.command import InputError
from envs.edge.files import check_regular
from envs.observation import most_critical

ADVISORIES = ("clear of conflict", "weak left", "weak right", "strong left", "strong right")
"""Meaning of the outputs 0 to 4, and of the networks by previous advisory."""

_RATES = np.radians([0.0, 1.5, -1.5, 3.0, -3.0])
_FOOT = 0.3048
_HORIZONTAL, _ACAS_XU = 3, 5
_MOST = 100_000_000
_PREVIOUS = re.compile(r"(pra(?=[0-4]_)|v2a_(?=[1-5]_)|run2a_(?=[1-5]_))(\d)")


class NnetError(InputError):
    """A file that is no network; the message says file, line, and what was expected."""


@dataclass(frozen=True)
class Network:
    """A feed-forward network with ReLU between its layers."""

    weights: tuple[np.ndarray, ...]
    """``[out, in]`` each."""
    biases: tuple[np.ndarray, ...]
    low: np.ndarray
    """Of the inputs ``[I]``; what lies outside is clipped."""
    high: np.ndarray
    mean: np.ndarray
    """Of the inputs and, last, of all outputs, ``[I + 1]``."""
    span: np.ndarray

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Return the outputs ``[N, O]`` for inputs ``[N, I]`` in the units of the file.

        Raises:
            ValueError: the last axis is not the number of inputs, or an input is not finite.
        """
        inputs = np.asarray(inputs, np.float64)
        if inputs.ndim != 2 or inputs.shape[1] != len(self.low):
            raise ValueError(f"inputs have shape {inputs.shape}, expected [N, {len(self.low)}]")
        if not np.isfinite(inputs).all():
            raise ValueError("an input is not finite")
        x = (np.clip(inputs, self.low, self.high) - self.mean[:-1]) / self.span[:-1]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(_product(x, weight) + bias, 0.0)
        return (_product(x, self.weights[-1]) + self.biases[-1]) * self.span[-1] + self.mean[-1]


def read(path: str | os.PathLike[str]) -> Network:
    """Read a network.

    Raises:
        NnetError: the file cannot be read or is not as documented; the message names file and line.
    """
    source = os.fspath(path)
    lines = _Lines(source)
    layers, inputs, outputs, widest = lines.whole("layers, inputs, outputs and widest layer", 4)
    sizes = lines.whole("sizes of the layers", layers + 1)
    if sizes[0] != inputs or sizes[-1] != outputs or max(sizes[1:]) > max(widest, outputs):
        raise lines.error(f"sizes {sizes} do not fit {inputs} inputs, {outputs} outputs and at most {widest} a layer")
    if sum(a * b for a, b in pairwise(sizes)) > _MOST:
        raise lines.error(f"sizes {sizes}: expected at most {_MOST} weights")
    lines.unused(inputs)
    low, high = lines.numbers("minima of the inputs", inputs), lines.numbers("maxima of the inputs", inputs)
    if not (low < high).all():
        raise lines.error("a maximum does not exceed its minimum")
    mean = lines.numbers("means of the inputs and of the outputs", inputs + 1)
    span = lines.numbers("ranges of the inputs and of the outputs", inputs + 1)
    if not (span > 0.0).all():
        raise lines.error("a range is not positive")
    weights, biases = [], []
    for layer, (columns, rows) in enumerate(pairwise(sizes), start=1):
        matrix = [lines.numbers(f"weights of layer {layer}, row {i + 1}", columns) for i in range(rows)]
        weights.append(np.array(matrix))
        biases.append(np.array([lines.numbers(f"bias {i + 1} of layer {layer}", 1)[0] for i in range(rows)]))
    lines.end()
    return Network(tuple(weights), tuple(biases), low, high, mean, span)


@dataclass(frozen=True)
class AdvisoryLogic:
    """A logic flown as a decider: its advisory for the most critical intruder, else to the goal when that is clear.

    The networks see the scene as it is. They were made to keep 500 ft between aircraft of about 200 ft/s, but advise
    long before; whatever they keep beyond is theirs. The way back to the goal is free where the aircraft's
    separation is kept.
    """

    networks: tuple[Network, ...]
    """One for each previous advisory, or a single one."""
    aircraft: Aircraft

    def decide(self, sight: Sight, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` that hold the speed, and the advisories to remember.

        Raises:
            ValueError: something of the sight is not finite.
        """
        inputs = self._inputs(checked(sight))
        scores = np.empty((len(memory), len(ADVISORIES)))
        for previous in range(len(ADVISORIES)):
            rows = memory == previous
            if rows.any():
                scores[rows] = self.networks[previous % len(self.networks)](inputs[rows])
        best = np.argmin if inputs.shape[1] == _ACAS_XU else np.argmax
        advisory = best(scores, axis=-1)
        advised = np.clip(_RATES[advisory] / self.aircraft.limits.yaw_rate_max, -1.0, 1.0)
        free = may_return(sight, self.aircraft, self.aircraft.separation)
        home = steered(sight.own, course_to_goal(sight, self.aircraft), self.aircraft)
        steering = np.where(advisory == 0, np.where(free, home, 0.0), advised)
        return np.stack([np.zeros_like(steering), steering], axis=-1), advisory.astype(np.int8)

    def _inputs(self, sight: Sight) -> np.ndarray:
        """Return what the networks take, ``[M, I]``."""
        own = sight.own
        other = most_critical(own, sight.intruders, sight.mask, self.aircraft, np)
        east, north = (other.x - own.x) / _FOOT, (other.y - own.y) / _FOOT
        cosine, sine = np.cos(own.heading), np.sin(own.heading)
        ahead, left = east * cosine + north * sine, north * cosine - east * sine
        course = wrap(other.heading - own.heading, np)
        if len(self.networks[0].low) == _HORIZONTAL:
            return np.stack([ahead, left, course], axis=-1)
        speeds = own.speed / _FOOT, other.speed / _FOOT
        return np.stack([np.hypot(ahead, left), np.arctan2(left, ahead), course, *speeds], axis=-1)


def load_logic(path: str | os.PathLike[str], aircraft: Aircraft) -> AdvisoryLogic:
    """Load a logic for an aircraft by one of its networks.

    A name that holds ``pra0_`` to ``pra4_`` (HorizontalCAS), ``run2a_1_`` or ``v2a_1_`` to 5 (ACAS Xu; the number after
    it is the vertical tau's, of which 1 is co-altitude) stands for the networks of all five previous advisories, which
    must lie beside it; another name for one that serves always.

    Raises:
        NnetError: a network is missing, malformed, or none of a logic that is known.
    """
    networks = []
    for sibling in _family(Path(path)):
        network = read(sibling)
        shape = len(network.low), len(network.biases[-1])
        if shape not in ((_HORIZONTAL, len(ADVISORIES)), (_ACAS_XU, len(ADVISORIES))):
            raise NnetError(
                f"{sibling}: {shape[0]} inputs and {shape[1]} outputs, expected {_HORIZONTAL} (HorizontalCAS) or "
                f"{_ACAS_XU} (ACAS Xu) inputs and {len(ADVISORIES)} outputs"
            )
        networks.append(network)
    if len({len(network.low) for network in networks}) != 1:
        raise NnetError(f"{os.fspath(path)}: the networks of the previous advisories have different inputs")
    return AdvisoryLogic(tuple(networks), aircraft)


def _family(path: Path) -> Sequence[Path]:
    """Return the files of all previous advisories, or the one file."""
    found = _PREVIOUS.search(path.name)
    if found is None:
        return [path]
    before, after = path.name[: found.start(2)], path.name[found.end(2) :]
    first = 0 if found[1] == "pra" else 1
    return [path.with_name(f"{before}{number}{after}") for number in range(first, first + len(ADVISORIES))]


def _product(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return ``x weight^T``, each row the same whatever its company: BLAS would round it by the size of the batch."""
    return np.einsum("ni,oi->no", x, weight)


class _Lines:
    """The lines of a file, read one after the other."""

    def __init__(self, source: str) -> None:
        self._source, self._number = source, 0
        try:
            check_regular(source)
            self._lines = Path(source).read_text(encoding="utf-8-sig").splitlines()
        except FileNotFoundError:
            raise NnetError(f"{source}: there is no such file") from None
        except UnicodeDecodeError as problem:
            raise NnetError(f"{source}: not a text in UTF-8 (byte {problem.start})") from None
        except OSError as problem:
            raise NnetError(f"{source}: cannot be read: {problem.strerror}") from None

    def error(self, text: str) -> NnetError:
        """Return an error about the line read last."""
        return NnetError(f"{self._source} line {self._number}: {text}")

    def next(self) -> str | None:
        """Return the next line that is neither blank nor a comment; None at the end."""
        for line in self._lines[self._number :]:
            self._number += 1
            if line.strip() and not line.lstrip().startswith("//"):
                return line
        return None

    def unused(self, inputs: int) -> None:
        """Pass over the line without use; a blank one is it where the minima of several inputs follow."""
        before = self._number
        line = self.next()
        if line is not None and self._number > before + 1 and len(_cells(line)) == inputs > 1:
            self._number -= 1

    def numbers(self, what: str, count: int) -> np.ndarray:
        """Return the finite numbers of the next line; a comma at its end is usual."""
        line = self.next()
        if line is None:
            raise NnetError(f"{self._source}: ends after line {self._number}, expected {what}")
        cells = _cells(line)
        if len(cells) != count:
            raise self.error(f"{len(cells)} numbers, expected {count}: {what}")
        return np.array([self._number_of(cell.strip(), what) for cell in cells])

    def whole(self, what: str, count: int) -> list[int]:
        """Return the positive whole numbers of the next line."""
        values: list[Any] = self.numbers(what, count).tolist()
        for value in values:
            if value != int(value) or not 1 <= value <= 1e6:
                raise self.error(f"{value:g}, expected whole numbers of at least 1: {what}")
        return [int(value) for value in values]

    def end(self) -> None:
        """Refuse what is left."""
        line = self.next()
        if line is not None:
            raise self.error(f"{line.strip()[:40]!r}, expected the end of the file")

    def _number_of(self, cell: str, what: str) -> float:
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in cell or not cell.isascii():
            raise self.error(f"{cell!r} is not a finite number: {what}")
        return value


def _cells(line: str) -> list[str]:
    return line.strip().removesuffix(",").split(",")
