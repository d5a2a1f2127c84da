"""What the tests share: the backends of the core, and strategies and batches of physical states."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

from envs.backend import FLOATS
from envs.kinematics import VehicleState

__all__ = [
    "ARRAY_BACKENDS",
    "BACKENDS",
    "Backend",
    "accelerations",
    "angle_between",
    "headings",
    "mirrored",
    "moved",
    "one",
    "random_states",
    "speeds",
    "stacked",
    "states",
    "yaw_rates",
]


@dataclass(frozen=True)
class Backend:
    """One array namespace at one precision."""

    name: str
    xp: Any
    dtype: Any

    def apply(self, function: Callable[..., Any], *columns: Any) -> tuple[np.ndarray, ...]:
        """Return ``function(*columns)``, a tuple of arrays ``[N]``, computed in this backend, as float64.

        Plain floats are evaluated one element at a time.
        """
        rows = np.broadcast_arrays(*(np.asarray(column, self.dtype) for column in columns))
        if self.xp is FLOATS:
            each = [function(*map(float, row)) for row in zip(*rows, strict=True)]
            return tuple(np.array(column, np.float64) for column in zip(*each, strict=True))
        results = function(*(self.xp.asarray(row) for row in rows))
        for result in results:
            assert result.dtype in (self.dtype, bool), f"{self.name}: a result is {result.dtype}"
        return tuple(np.asarray(result, np.float64) for result in results)

    def rounded(self, values: Any) -> np.ndarray:
        """Return float64 values that this backend represents exactly."""
        return np.asarray(values, self.dtype).astype(np.float64)


ARRAY_BACKENDS = (
    Backend("numpy64", np, np.float64),
    Backend("numpy32", np, np.float32),
    Backend("jax32", jnp, np.float32),
)
BACKENDS = (*ARRAY_BACKENDS, Backend("floats", FLOATS, np.float64))

headings = st.floats(-math.pi, math.pi, exclude_max=True)
speeds = st.floats(50.0, 100.0)
accelerations = st.floats(-0.5, 0.5)
yaw_rates = st.floats(-math.radians(3.0), math.radians(3.0))
_positions = st.floats(-10_000.0, 10_000.0)


@st.composite
def states(draw: st.DrawFn) -> VehicleState:
    """Draw a vehicle within 10 km of the origin and the surrogate's speeds, as float64 scalars."""
    return VehicleState(*(np.float64(draw(part)) for part in (_positions, _positions, headings, speeds)))


def random_states(generator: np.random.Generator, *shape: int, extent: float = 10_000.0) -> VehicleState:
    """Return vehicles ``shape`` within ``extent`` of the origin and the surrogate's speeds."""
    return VehicleState(
        generator.uniform(-extent, extent, shape),
        generator.uniform(-extent, extent, shape),
        generator.uniform(-math.pi, math.pi, shape),
        generator.uniform(50.0, 100.0, shape),
    )


def one(x: float, y: float, heading: float, speed: float) -> VehicleState:
    """Return one vehicle as a batch ``[1]``."""
    return VehicleState(*(np.array([value], np.float64) for value in (x, y, heading, speed)))


def stacked(*vehicles: VehicleState) -> VehicleState:
    """Return vehicles ``[...]`` side by side, ``[..., K]``."""
    return VehicleState(*(np.stack(fields, axis=-1) for fields in zip(*vehicles, strict=True)))


def mirrored(state: VehicleState) -> VehicleState:
    """Return the state reflected at the east axis."""
    heading = np.where(state.heading == -math.pi, state.heading, -state.heading)
    return VehicleState(state.x, -state.y, heading, state.speed)


def moved(state: VehicleState, angle: float, east: float = 0.0, north: float = 0.0) -> VehicleState:
    """Return the state rotated about the origin by an angle (rad) and then shifted (m)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    heading = np.remainder(state.heading + angle + math.pi, 2.0 * math.pi) - math.pi
    return VehicleState(
        state.x * cosine - state.y * sine + east, state.x * sine + state.y * cosine + north, heading, state.speed
    )


def angle_between(a: Any, b: Any) -> np.ndarray:
    """Return the size of the smallest turn from one angle to the other, rad."""
    return np.abs(np.angle(np.exp(1j * (np.asarray(a, np.float64) - np.asarray(b, np.float64)))))
