"""The matrix products of learning, counted and timed on their own: the limit that
arithmetic sets.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

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
    found = []
    for layer, (inputs, outputs) in enumerate(itertools.pairwise(widths)):
        found += [
            Product((batch, inputs), (inputs, outputs), (1, 0)),
            Product((batch, inputs), (batch, outputs), (0, 0)),
        ]
        if layer > 0:
            found.append(Product((batch, outputs), (inputs, outputs), (1, 1)))
    return found


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
    """Return the same without the gradient of the first layer's inputs, which nobody computes."""
    return 2 * weights(networks) + epochs * sum(flop(products(widths, 1)) for widths in networks)


def flop(work: list[Product]) -> int:
    """Return the floating-point operations of some products."""
    return sum(product.flop for product in work)


def runner(work: list[Product], rounds: int) -> Callable[[], None]:
    """Return a function that computes the products one after another, ``rounds`` times, each
    compiled on its own.
    """
    prepared, results = [], []
    rng = np.random.default_rng(0)
    for product in work:
        left, right = (
            jnp.asarray(rng.standard_normal(s), jnp.float32) for s in (product.left, product.right)
        )
        numbers = (((product.contract[0],), (product.contract[1],)), ((), ()))

        def dot(
            a: jax.Array, b: jax.Array, _: jax.Array, numbers: lax.DotDimensionNumbers = numbers
        ) -> jax.Array:
            return lax.dot_general(a, b, numbers, preferred_element_type=jnp.float32)

        # The last result's memory is handed back for the next one: allocating it is no arithmetic.
        result = jnp.zeros(
            (product.left[1 - product.contract[0]], product.right[1 - product.contract[1]])
        )
        compiled = (
            jax.jit(dot, donate_argnums=2, keep_unused=True).lower(left, right, result).compile()
        )
        prepared.append((compiled, left, right))
        results.append(result)

    def run() -> None:
        for _ in range(rounds):
            for index, (compiled, left, right) in enumerate(prepared):
                # Waiting for each keeps them from overlapping, as layers that depend on each other
                # cannot.
                results[index] = compiled(left, right, results[index]).block_until_ready()

    return run
