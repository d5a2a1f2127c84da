"""Networks in the ``.nnet`` text format, and the advisory logics of the field that come in it.

The format (K. Julian, Stanford, 2016) is a text: the number of layers, inputs, outputs and the
widest layer; the layers' sizes; a number without use; minima, maxima, means and ranges of the
inputs, the last two with one more for all outputs; then for each layer its weights, a line a row,
and its biases, a line each. Comment lines, which begin with ``//``, and blank lines may stand
anywhere, a byte order mark at the beginning.

Two logics are known by the number of inputs. HorizontalCAS has 3 (intruder ahead ft, left ft,
relative heading rad) and advises what scores highest; ACAS Xu has 5 (distance ft, bearing rad,
relative heading rad, both speeds ft/s) and advises what scores lowest. Both have five outputs:
clear of conflict, weak left, weak right, strong left, strong right (1.5 and 3 deg/s), and one
network for each advisory that went before.
"""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from agents.baselines.baselines import (
    Observation,
    check_observation,
    course_to_goal,
    may_return,
    steer,
)
from commands.command import InputError
from commands.files import check_regular
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.observation import most_critical

ADVISORIES = ("clear of conflict", "weak left", "weak right", "strong left", "strong right")
"""Meaning of the outputs 0 to 4, and of the networks by previous advisory."""

_RATES = np.radians([0.0, 1.5, -1.5, 3.0, -3.0])
_FOOT = 0.3048
_HORIZONTAL, _ACAS_XU = 3, 5
_PREVIOUS = re.compile(r"(pra(?=[0-4]_)|v2a_(?=[1-5]_)|run2a_(?=[1-5]_))(\d)")


class NnetError(InputError):
    """A file that is no network; the message says file and what was expected."""


@dataclass(frozen=True)
class Network:
    """A feed-forward network with ReLU between its layers."""

    weights: tuple[np.ndarray, ...]  # [out, in] each
    biases: tuple[np.ndarray, ...]
    low: np.ndarray  # of the inputs [I]; what lies outside is clipped
    high: np.ndarray
    mean: np.ndarray  # of the inputs and, last, of all outputs, [I + 1]
    span: np.ndarray

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Return outputs ``[N, O]`` for inputs ``[N, I]`` in the file's units; ValueError: wrong
        shape, not finite.
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
    """Read a network; raise NnetError where the file cannot be read or is not as documented."""
    source = os.fspath(path)
    numbers = _numbers(source)
    layers, inputs, outputs, _ = _whole(numbers[:4], 4, source)
    sizes = _whole(numbers[4:], layers + 1, source)
    if sizes[0] != inputs or sizes[-1] != outputs:
        raise NnetError(f"{source}: sizes {sizes} do not fit {inputs} inputs and {outputs} outputs")
    shapes = [(inputs,), (inputs,), (inputs + 1,), (inputs + 1,)]
    shapes += [shape for columns, rows in pairwise(sizes) for shape in ((rows, columns), (rows,))]
    ends = np.cumsum([math.prod(shape) for shape in shapes], dtype=object)
    begin = 4 + len(sizes) + 1  # after the number without use
    if len(numbers) != begin + ends[-1]:
        raise NnetError(
            f"{source}: {len(numbers)} numbers, expected {begin + ends[-1]} for the sizes {sizes}"
        )
    parts = np.split(numbers[begin:], ends[:-1].astype(int))
    low, high, mean, span, *matrices = (
        part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)
    )
    if not ((low < high).all() and (span > 0.0).all()):
        raise NnetError(
            f"{source}: expected maxima of the inputs above their minima, and ranges above 0"
        )
    return Network(tuple(matrices[::2]), tuple(matrices[1::2]), low, high, mean, span)


@dataclass(frozen=True)
class AdvisoryLogic:
    """A logic flown as a resolver: its advisory for the most critical intruder, else to the goal
    when that is clear.

    The networks see the scene as it is. They were made to keep 500 ft between aircraft of about 200
    ft/s, but advise long before. The way back to the goal is free where the aircraft's separation
    is kept.
    """

    networks: tuple[Network, ...]
    """One for each previous advisory, or a single one."""
    aircraft: Aircraft

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` that hold the speed, and the advisories to remember; a
        ValueError: not finite.
        """
        observation = check_observation(observation)
        inputs = self._inputs(observation)
        scores = np.empty((len(memory), len(ADVISORIES)))
        for previous in range(len(ADVISORIES)):
            rows = memory == previous
            if rows.any():
                scores[rows] = self.networks[previous % len(self.networks)](inputs[rows])
        best = np.argmin if inputs.shape[1] == _ACAS_XU else np.argmax
        advisory = best(scores, axis=-1)
        advised = np.clip(_RATES[advisory] / self.aircraft.limits.yaw_rate_max, -1.0, 1.0)
        free = may_return(observation, self.aircraft, self.aircraft.separation)
        home = steer(observation.own, course_to_goal(observation, self.aircraft), self.aircraft)
        steering = np.where(advisory == 0, np.where(free, home, 0.0), advised)
        return np.stack([np.zeros_like(steering), steering], axis=-1), advisory.astype(np.int8)

    def _inputs(self, observation: Observation) -> np.ndarray:
        own = observation.own
        other = most_critical(own, observation.intruders, observation.mask, self.aircraft, np)
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

    A name that holds ``pra0_`` to ``pra4_`` (HorizontalCAS), ``run2a_1_`` or ``v2a_1_`` to 5 (ACAS
    Xu; the number after it is the vertical tau's, of which 1 is co-altitude) stands for the
    networks of all five previous advisories, which must lie beside it; another name for one that
    serves always.

    Raises:
        NnetError: a network is missing, malformed, or none of a logic that is known.
    """
    networks = []
    for sibling in _family(Path(path)):
        network = read(sibling)
        shape = len(network.low), len(network.biases[-1])
        if shape not in ((_HORIZONTAL, len(ADVISORIES)), (_ACAS_XU, len(ADVISORIES))):
            raise NnetError(
                f"{sibling}: {shape[0]} inputs and {shape[1]} outputs, expected {_HORIZONTAL} "
                "(HorizontalCAS) or "
                f"{_ACAS_XU} (ACAS Xu) inputs and {len(ADVISORIES)} outputs"
            )
        networks.append(network)
    if len({len(network.low) for network in networks}) != 1:
        raise NnetError(
            f"{os.fspath(path)}: the networks of the previous advisories have different inputs"
        )
    return AdvisoryLogic(tuple(networks), aircraft)


def _family(path: Path) -> Sequence[Path]:
    """Return the files of all previous advisories, or the one file."""
    match = _PREVIOUS.search(path.name)
    if match is None:
        return [path]
    before, after = path.name[: match.start(2)], path.name[match.end(2) :]
    first = 0 if match[1] == "pra" else 1
    return [
        path.with_name(f"{before}{number}{after}")
        for number in range(first, first + len(ADVISORIES))
    ]


def _product(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return ``x weight^T``, each row with the same bits in any batch."""
    return np.einsum("ni,oi->no", x, weight)


def _numbers(source: str) -> np.ndarray:
    try:
        check_regular(source)
        lines = Path(source).read_text(encoding="utf-8-sig").splitlines()
        cells = ",".join(line for line in lines if not line.lstrip().startswith("//")).split(",")
        numbers = np.array([cell for cell in cells if cell.strip()], np.float64)
    except FileNotFoundError:
        raise NnetError(f"{source}: there is no such file") from None
    except ValueError as problem:
        raise NnetError(f"{source}: not a text of numbers ({problem})") from None
    except OSError as problem:
        raise NnetError(f"{source}: cannot be read: {problem.strerror}") from None
    if not np.isfinite(numbers).all():
        raise NnetError(f"{source}: a number is not finite")
    return numbers


def _whole(numbers: np.ndarray, count: int, source: str) -> list[int]:
    """Return the first numbers, which must be whole and positive."""
    head = numbers[:count]
    if len(head) < count or (head != np.round(head)).any() or (head < 1).any():
        raise NnetError(
            f"{source}: begins with {head.tolist()}, expected {count} whole numbers of at least 1"
        )
    return head.astype(int).tolist()
