"""Names for the arrays that the world, the policies and the planner compute with.

The same functions compute in NumPy, in JAX and, with Python's floats, for one aircraft alone. Type
checkers know no type that covers the three, so that these names tell the reader what `Any` would
not. Shapes stand in the docstrings.
"""

from typing import Any, TypeAlias

Array: TypeAlias = Any
"""An array of NumPy or JAX, or a float where a function computes for one aircraft."""

ArrayModule: TypeAlias = Any
"""The module that computes, `numpy` or `jax.numpy`; parameters of this type are called `xp`."""
