"""Examples of flying well that a training is drawn to, from a file that ``eval.practice`` writes."""

import zipfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from agents.config.load import ConfigError
from agents.learning.ppo import Examples
from envs.observation import SIZE
from rlcas_jax.config import TrainConfig

__all__ = ["exemplary"]


def exemplary(config: TrainConfig) -> Examples | None:
    """Return the examples that a training imitates, float32 ``[M]``; None where there are none.

    Raises:
        ConfigError: the file cannot be used.
    """
    path = config.practice.examples
    if path is None:
        return None
    stored = _read(path)
    arrays = [_checked(path, stored, name, width) for name, width in (("observation", SIZE), ("action", 2))]
    if len(arrays[0]) != len(arrays[1]):
        raise ConfigError(
            f"practice.examples: {path} holds {len(arrays[0])} observations and {len(arrays[1])} actions, "
            "expected as many of both"
        )
    return Examples(*(jnp.asarray(array, jnp.float32) for array in arrays))


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except FileNotFoundError:
        raise ConfigError(f"practice.examples: {path}: there is no such file") from None
    except (OSError, ValueError, AttributeError, EOFError, zipfile.BadZipFile) as problem:
        raise ConfigError(
            f"practice.examples: {path} cannot be read ({problem}), expected an .npz file that eval.practice wrote"
        ) from None


def _checked(path: Path, stored: dict[str, np.ndarray], name: str, width: int) -> np.ndarray:
    if name not in stored:
        raise ConfigError(f"practice.examples: {path} holds no {name}, expected one of shape [M, {width}]")
    array = stored[name]
    numbers = np.issubdtype(array.dtype, np.floating)
    if not numbers or array.ndim != 2 or array.shape[1] != width or not len(array):
        raise ConfigError(
            f"practice.examples: {name} of {path} has shape {list(array.shape)} and type {array.dtype}, "
            f"expected [M, {width}] of floats"
        )
    if not np.all(np.abs(array) <= 1.0):
        raise ConfigError(
            f"practice.examples: {name} of {path} holds what is not within [-1, 1], expected finite shares"
        )
    return array
