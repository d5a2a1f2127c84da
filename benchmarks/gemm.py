"""The matrix products of learning, counted and timed on their own: the limit that
arithmetic sets.
"""

import itertools
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

__all__ = [
    "Product",
    "flop",
    "flop_per_step",
    "plain",
    "products",
    "runner",
    "used_flop_per_step",
    "weights",
]


class Product(NamedTuple):
    """One matrix product."""

    left: tuple[int, int]
    right: tuple[int, int]
    contract: tuple[int, int]
    """The axis of each factor that is summed over, as the layers use them: nothing is transposed
    beforehand.
    """

    @property
    def flop(self) -> int:
        """Floating-point operations: a multiplication and an addition for each pair of factors."""
        rows, columns = self.left[1 - self.contract[0]], self.right[1 - self.contract[1]]
        return 2 * rows * columns * self.left[self.contract[0]]


def products(widths: list[int], batch: int) -> list[Product]:
    """Return the products of a network's forward and backward pass over a minibatch.

    Args:
        widths: of its inputs, hidden layers and outputs.
        batch: samples.

    Returns:
        For each layer X W, the weights' gradient X^T dY and, but for the first layer, whose inputs
        need no gradient, the inputs' gradient dY W^T.
    """
    needed = []
    for layer, (inputs, outputs) in enumerate(itertools.pairwise(widths)):
        needed += [
            Product((batch, inputs), (inputs, outputs), (1, 0)),
            Product((batch, inputs), (batch, outputs), (0, 0)),
        ]
        if layer > 0:
            needed.append(Product((batch, outputs), (inputs, outputs), (1, 1)))
    return needed


def plain(batch: int, width: int) -> list[Product]:
    """Return the product that machines like best: a batch with one square layer."""
    return [Product((batch, width), (width, width), (1, 0))]


def weights(networks: list[list[int]]) -> int:
    """Return the number P of weights (without biases) of networks given by their widths."""
    return sum(a * b for widths in networks for a, b in itertools.pairwise(widths))


def flop_per_step(networks: list[list[int]], epochs: int) -> int:
    """Return the usual count 2 P (1 + 3 epochs) for an environment step: one evaluation, and three
    for a gradient.
    """
    return 2 * weights(networks) * (1 + 3 * epochs)


def used_flop_per_step(networks: list[list[int]], epochs: int) -> int:
    """Return the same count without the gradient of the first layer's inputs, which no learner
    computes.
    """
    return 2 * weights(networks) + epochs * sum(flop(products(widths, 1)) for widths in networks)


def flop(work: list[Product]) -> int:
    """Return the floating-point operations of some products."""
    return sum(product.flop for product in work)


def runner(work: list[Product], rounds: int) -> Callable[[], None]:
    """Return a function that computes the products one after another, ``rounds`` times, each
    compiled on its own.
    """
    rng = np.random.default_rng(0)
    compiled = [_CompiledProduct(product, rng) for product in work]

    def run() -> None:
        for _ in range(rounds):
            for product in compiled:
                product.compute()

    return run


class _CompiledProduct:
    """One product of random factors."""

    def __init__(self, product: Product, rng: np.random.Generator) -> None:
        self._left, self._right = (
            jnp.asarray(rng.standard_normal(shape), jnp.float32)
            for shape in (product.left, product.right)
        )
        rows, columns = (
            product.left[1 - product.contract[0]],
            product.right[1 - product.contract[1]],
        )
        self._result = jnp.zeros((rows, columns))
        dot = partial(_dot, (((product.contract[0],), (product.contract[1],)), ((), ())))
        jitted = jax.jit(dot, donate_argnums=2, keep_unused=True)
        self._compiled = jitted.lower(self._left, self._right, self._result).compile()

    def compute(self) -> None:
        """Compute it, and wait: layers that depend on each other cannot overlap either."""
        # The last result's memory is handed back for the next one: allocating it is no arithmetic.
        self._result = self._compiled(self._left, self._right, self._result).block_until_ready()


def _dot(
    numbers: lax.DotDimensionNumbers,
    left: Float[Array, "A B"],
    right: Float[Array, "C D"],
    _: Float[Array, "R S"],
) -> Float[Array, "R S"]:
    return lax.dot_general(left, right, numbers, preferred_element_type=jnp.float32)
