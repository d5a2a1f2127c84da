"""Code of a user's own, named ``module:name`` in a configuration, an option or a call.

A module is looked for where Python looks for modules, and in the working directory. Only what the
user names by hand is imported; no file of data names code that is then run.
"""

import importlib
import sys
import sysconfig
import traceback
from pathlib import Path
from typing import Any

from commands.command import InputError

__all__ = ["failure", "is_extension", "load_extension"]

_TRACED = {
    "TracerArrayConversionError": "numpy, or float(), takes an array that JAX traces",
    "TracerBoolConversionError": "if, and, or, min() or max() takes a value that JAX traces",
    "TracerIntegerConversionError": "an index or int() takes a value that JAX traces",
    "ConcretizationTypeError": "a number is asked of an array that JAX traces",
    "NonConcreteBooleanIndexError": "a mask that JAX traces selects rows",
}
"""What errors of JAX mean in a function that is compiled, by their class."""

_ROOT = Path(__file__).resolve().parents[1]
_OURS = tuple(
    str(_ROOT / name) for name in ("agents", "commands", "envs", "eval", "rlcas_jax", "ros_bridge")
)


def is_extension(name: str) -> bool:
    """Return whether a name has the form ``module:name``."""
    module, colon, attribute = name.partition(":")
    parts = (*module.split("."), attribute)
    return bool(colon) and all(part.isidentifier() for part in parts)


def load_extension(name: str, expected: str) -> Any:
    """Return the object that ``module:name`` names.

    Args:
        name: such as ``my_module:thing``.
        expected: what it should be, for the message, such as ``a scenario``.

    Raises:
        InputError: the name has another form, the module cannot be found or fails while it is
            imported, or it has no such name.
    """
    if not is_extension(name):
        raise InputError(f"{name!r} names no code; expected module:name, {expected} of your own")
    module_name, _, attribute = name.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path and "" not in sys.path:
        sys.path.append(folder)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as problem:
        missing = problem.name or module_name
        raise InputError(
            f"{name}: no module {missing!r} is in {folder} or installed; expected {expected}"
        ) from None
    except Exception as problem:
        raise InputError(f"{name}: importing {module_name} {failure(problem)}") from problem
    try:
        return getattr(module, attribute)
    except AttributeError:
        raise InputError(
            f"{name}: {module_name} has no {attribute!r}; expected {expected} there"
        ) from None


def failure(problem: BaseException, namespace: str = "xp") -> str:
    """Return in a sentence how code of the user's own has failed, and in which of its lines.

    Args:
        problem: what was raised.
        namespace: what the code is to use for arrays that JAX traces.
    """
    kind = type(problem).__name__
    says = str(problem).strip().partition("\n")[0]
    if kind in _TRACED:
        says = f"{_TRACED[kind]}; use {namespace}, such as {namespace}.where for a choice"
    return f"fails with {kind}: {says}{_line_of(problem)}"


def _line_of(problem: BaseException) -> str:
    """Return the innermost line of a traceback that is neither the toolkit's nor a library's."""
    paths = sysconfig.get_paths()
    libraries = _OURS + tuple(paths[key] for key in ("stdlib", "platstdlib", "purelib", "platlib"))
    for frame in reversed(traceback.extract_tb(problem.__traceback__)):
        if not frame.filename.startswith((*libraries, "<")):
            path = Path(frame.filename)
            name = path.name if path.parent == Path.cwd() else path
            return f" ({name}, line {frame.lineno})"
    return ""
