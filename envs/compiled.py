"""Scalar code compiled by numba, where it is installed (extra ``fast``): the one module that
imports it.

A *scalar* function computes with plain floats and loops and is marked by :func:`scalar`: compiled
code may call it, and in Python it stays what it is. Functions over an ``xp`` are scalar where they
are called with :data:`~envs.backend.FLOATS`, so that one source serves arrays, floats and compiled
code. An :class:`Entry` is a scalar function that Python calls compiled. There are few: a call costs
some microseconds, a signature some seconds to compile.

Nothing is compiled in flight. :func:`prepare` compiles all entries, or loads them from a folder of
the user's cache that is named by a digest of the sources, numba, numpy and the processor; from then
on arguments of other types are refused (TypeError). Before that, and without numba, entries are not
:attr:`~Entry.ready`, and callers take the interpreted way.
"""

import fcntl
import hashlib
import importlib.util
import inspect
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from commands.compiled import cache_folder
from envs.arrays import Array
from envs.backend import EXACT_FLOATS, FLOATS

Function = TypeVar("Function", bound=Callable[..., Any])
Arguments = tuple[Any, ...]

_SOURCES = ("envs", "agents")  # packages that hold what is compiled
# Each with what is compiled where the last argument is FLOATS, and where it is not.
_SCALARS: list[tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]] = []
_ENTRIES: list["Entry"] = []
_PREPARING = threading.Lock()
_flying = False  # whether callers take what is compiled
_IMPORTED = time.time()  # sources are imported now or later; s


def scalar(function: Function) -> Function:
    """Mark a function that compiled code may call."""
    _SCALARS.append((function, function, function))
    return function


def scalar_as(
    of_floats: Callable[..., Any], otherwise: Callable[..., Any]
) -> Callable[[Function], Function]:
    """Mark a function that chooses by its last argument, ``xp``: compiled code calls the first of
    the given ones, of the same arguments, where that is :data:`~envs.backend.FLOATS`, and the
    second where it is not.
    """

    def mark(function: Function) -> Function:
        _SCALARS.append((function, of_floats, otherwise))
        return function

    return mark


class Entry:
    """A scalar function that Python calls compiled.

    Args:
        function: that is compiled.
        examples: gives a list of arguments for each signature. Arrays are contiguous in them and in
            every call.
    """

    def __init__(
        self, function: Callable[..., Any], examples: Callable[[], list[Arguments]]
    ) -> None:
        self.function, self._examples = function, examples
        self._compiled: Any = None
        _ENTRIES.append(self)

    @property
    def name(self) -> str:
        """The function's, with its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"

    @property
    def is_compiled(self) -> bool:
        """Whether it is compiled, ready or not."""
        return self._compiled is not None

    @property
    def ready(self) -> bool:
        """Whether callers take it."""
        return _flying and self.is_compiled

    def __call__(self, *arguments: Any) -> Any:
        """Call it compiled."""
        return self._compiled(*arguments)

    def compile(self, numba: Any, *, cache: bool) -> None:
        """Compile each signature, or load it, and refuse all others from now on. What divides by 0
        is as in numpy no error.
        """
        compiled = numba.njit(self.function, cache=cache, error_model="numpy")
        try:
            for arguments in self._examples():
                compiled.compile(tuple(map(numba.typeof, arguments)))
        except Exception:
            if not cache:
                raise
            self.compile(numba, cache=False)  # what is kept is damaged
            return
        compiled.disable_compile()
        self._compiled = compiled


def records(columns: Mapping[str, Array]) -> Array:
    """Return columns ``[K]`` by their names as one array of records ``[K]``, float64.

    Compiled code reads and writes ``array[k].name``. Each array that a function is given costs
    time, in the call and within.
    """
    size = np.size(next(iter(columns.values())))
    array = np.empty(size, dtype=[(name, float) for name in columns])
    for name, column in columns.items():
        array[name] = column
    return array


def may_compile() -> bool:
    """Return whether numba is installed, and its own variable NUMBA_DISABLE_JIT does not forbid it
    to compile.
    """
    forbidden = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    return not forbidden and importlib.util.find_spec("numba") is not None


def prepare() -> bool:
    """Compile all entries, or load them from the cache; return whether numba may do it.

    The first time that takes about a minute, later about a second. Processes that compile the same
    at the same time share the work.
    """
    if not may_compile():
        return False
    with _PREPARING:
        _compile_waiting()
    use(True)
    return True


def _compile_waiting() -> None:
    """Compile the entries that are not compiled."""
    waiting = [entry for entry in _ENTRIES if not entry.is_compiled]
    if not waiting:
        return
    import numba  # half a second, for those alone that fly compiled
    from numba.core import config

    _teach()
    folder = folder_of_code()
    settings: Any = config
    before, settings.CACHE_DIR = settings.CACHE_DIR, "" if folder is None else str(folder)
    try:
        for entry in in_turns(waiting, folder):
            entry.compile(numba, cache=folder is not None)
    finally:
        settings.CACHE_DIR = before


def in_turns(entries: list[Entry], folder: Path | None) -> Generator[Entry]:
    """Yield entries, each held for this process alone until the next; those come last that another
    process compiles meanwhile, since they can be loaded then.
    """
    if folder is None:
        yield from entries
        return
    waiting = entries
    for lock in (fcntl.LOCK_EX | fcntl.LOCK_NB, fcntl.LOCK_EX):
        busy = []
        for entry in waiting:
            with (folder / f"{entry.name}.lock").open("w") as file:
                try:
                    fcntl.flock(file, lock)
                except BlockingIOError:
                    busy.append(entry)
                    continue
                yield entry
        waiting = busy


def in_use() -> bool:
    """Return whether callers take what is compiled."""
    return _flying


def use(flying: bool) -> None:
    """Say whether callers take what is compiled, or go the interpreted way."""
    global _flying  # noqa: PLW0603
    _flying = flying


def folder_of_code() -> Path | None:
    """Return the folder that compiled code is kept in; None: it is compiled anew, because there is
    no room, or because sources have changed since they were imported.

    numba itself would not see that a function has changed which another file calls.
    """
    import numba

    sums = hashlib.sha256()
    for package in _SOURCES:
        root = Path(next(iter(sys.modules[package].__path__)))
        for path in sorted(root.rglob("*.py")):
            if path.stat().st_mtime > _IMPORTED:
                return None
            sums.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return cache_folder(sums.hexdigest(), numba.__version__, np.__version__)


_taught = 0  # scalar functions that numba knows


def _teach() -> None:
    """Let compiled code call the scalar functions, and the functions of the floats' namespaces."""
    global _taught  # noqa: PLW0603
    from numba import extending, types
    from numba.core.imputils import lower_constant

    if _taught == 0:
        of_floats = _new_namespace("Floats", FLOATS, extending, types, lower_constant)
        _new_namespace("ExactFloats", EXACT_FLOATS, extending, types, lower_constant)
        _taught_floats.append(of_floats)
    for function, of_floats, otherwise in _SCALARS[_taught:]:
        extending.overload(function, strict=False)(_chooser(of_floats, otherwise))
    _taught = len(_SCALARS)


_taught_floats: list[Any] = []  # the type of FLOATS


def _chooser(of_floats: Callable[..., Any], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    def choose(*arguments: Any, **named: Any) -> Callable[..., Any]:
        values = [*arguments, *named.values()]
        return of_floats if values and values[-1] is _taught_floats[0] else otherwise

    return choose


def _always(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return what chooses a function for all types; numba wants the function's own signature."""

    def choose(*_arguments: Any) -> Callable[..., Any]:
        return function

    vars(choose)["__signature__"] = inspect.signature(function)
    return choose


def _new_namespace(name: str, namespace: Any, extending: Any, types: Any, constant: Any) -> Any:
    """Make a type of a namespace of floats, whose functions are those of its own, compiled."""
    kind = type(name, (types.Opaque,), {"__init__": lambda self: types.Opaque.__init__(self, name)})
    of_floats = kind()
    extending.register_model(kind)(extending.models.OpaqueModel)
    extending.typeof_impl.register(type(namespace))(lambda _value, _context: of_floats)
    constant(kind)(lambda context, _builder, _type, _value: context.get_dummy_value())
    for function_name, function in _FUNCTIONS.items():
        extending.overload_method(kind, function_name)(_always(function))
    return of_floats


# The functions of a namespace, after the namespace itself.
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "row": lambda xp, count: np.zeros(count),
    "sqrt": lambda xp, value: math.sqrt(value),
    "exp": lambda xp, value: math.exp(value),
    "log": lambda xp, value: math.log(value),
    "floor": lambda xp, value: math.floor(value),
    "abs": lambda xp, value: abs(value),
    "copysign": lambda xp, value, sign: math.copysign(value, sign),
    "minimum": lambda xp, a, b: min(a, b),
    "maximum": lambda xp, a, b: max(a, b),
    "logical_and": lambda xp, a, b: a and b,
    "logical_or": lambda xp, a, b: a or b,
    "logical_not": lambda xp, value: not value,
    "where": lambda xp, condition, yes, no: yes if condition else no,
    "clip": lambda xp, value, low, high: low if value < low else high if value > high else value,
}
