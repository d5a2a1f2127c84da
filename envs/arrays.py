"""Names for the arrays that the world, the policies and the planner compute with.

The same functions compute in NumPy, in JAX and, with Python's floats, for one aircraft alone. No
type covers the three for a type checker; these names tell the reader what `Any` would not.

`Array` is an array of NumPy or JAX, or a float where a function computes for one aircraft.
`ArrayModule` is the module that computes, `numpy` or `jax.numpy`, or the floats of
:mod:`envs.backend`; parameters of this type are called `xp`.
`Record` is an element of a structured array, whose fields compiled code reads and writes as
attributes.

`Bool`, `Float`, `Int` and `Shaped` say the shape of an array in a signature, as jaxtyping writes
it: ``Float[Array, "N K"]``; `Shaped` is of any type, such as objects or records. They are for the
reader and the type checker alone: at run time they are the array's type, and nothing is imported.
"""

# Imported under these names and not defined as aliases: of two values whose type is an alias the
# type checker takes `a | b` for a union of types.
from typing import TYPE_CHECKING, Any
from typing import Any as Array
from typing import Any as ArrayModule
from typing import Any as Record

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int, Shaped
else:

    class _WithShape:
        """``Float[Array, "N"]`` is ``Array``."""

        def __class_getitem__(cls, array_and_shape: tuple[Any, str]) -> Any:
            """Return the type of the array."""
            return array_and_shape[0]

    Bool = Float = Int = Shaped = _WithShape

__all__ = ["Array", "ArrayModule", "Bool", "Float", "Int", "Record", "Shaped"]
