"""Names for the arrays that the world, the policies and the planner compute with.

The same functions compute in NumPy, in JAX and, with Python's floats, for one aircraft alone. No
type covers the three for a type checker; these names tell the reader what `Any` would not. Shapes
stand in the docstrings.

`Array` is an array of NumPy or JAX, or a float where a function computes for one aircraft.
`ArrayModule` is the module that computes, `numpy` or `jax.numpy`, or the floats of
:mod:`envs.backend`; parameters of this type are called `xp`.
`Record` is an element of a structured array, whose fields compiled code reads and writes as
attributes.
"""

# Imported under these names and not defined as aliases: of two values whose type is an alias the
# type checker takes `a | b` for a union of types.
from typing import Any as Array
from typing import Any as ArrayModule
from typing import Any as Record

__all__ = ["Array", "ArrayModule", "Record"]
