"""Random numbers by position: the draws of encounter 1234 do not depend on how many others are made
with it.
"""

import numpy as np

_WORDS_PER_COUNT = 4  # Philox gives four 64-bit words per counter value


def uniforms(
    seed: int, first: int, count: int, shape: tuple[int, ...], stream: int = 0
) -> np.ndarray:
    """Return draws in [0, 1) for the encounters ``first .. first + count - 1`` of a seed >= 0,
    ``[count, *shape]``.

    Args:
        shape: of the draws that one encounter takes.
        stream: number of an independent set of draws.
    """
    size = int(np.prod(shape))
    counts = -(-size // _WORDS_PER_COUNT)
    bits = np.random.Philox(key=np.array([seed, stream], dtype=np.uint64))
    bits.advance(first * counts)
    words = np.random.Generator(bits).random((count, counts * _WORDS_PER_COUNT))
    return words[:, :size].reshape(count, *shape)


def normals(
    seed: int, first: int, count: int, shape: tuple[int, ...], stream: int = 0
) -> np.ndarray:
    """Return standard normal draws, ``[count, *shape]``, by position as :func:`uniforms`
    (Box-Muller).
    """
    pairs = uniforms(seed, first, count, (*shape, 2), stream)
    return np.sqrt(-2.0 * np.log1p(-pairs[..., 0])) * np.cos(2.0 * np.pi * pairs[..., 1])
