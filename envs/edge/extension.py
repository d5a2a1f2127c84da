"""Code of a user's own, named ``module:name`` in a configuration, an option or a call.

A module is looked for where Python looks for modules, and in the working directory. Only what the
user names by hand is imported; no file of data names code that is then run.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

from envs.edge.command import InputError

__all__ = ["is_extension", "load_extension"]


def is_extension(name: str) -> bool:
    """Return whether a name has the form ``module:name``."""
    module, colon, attribute = name.partition(":")
    parts = (*module.split("."), attribute)
    return bool(colon) and all(part.isidentifier() for part in parts)


def load_extension(name: str, what: str) -> Any:
    """Return the object that ``module:name`` names.

    Args:
        name: such as ``my_module:thing``.
        what: what it is expected to be, for the message, such as ``a scenario``.

    Raises:
        InputError: the name has another form, the module cannot be found or fails while it is
            imported, or it has no such name.
    """
    if not is_extension(name):
        raise InputError(f"{name!r} names no code; expected module:name, {what} of your own")
    module_name, _, attribute = name.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path and "" not in sys.path:
        sys.path.append(folder)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as problem:
        missing = problem.name or module_name
        raise InputError(
            f"{name}: no module {missing!r} is in {folder} or installed; expected {what}"
        ) from None
    except Exception as problem:
        raise InputError(
            f"{name}: importing {module_name} fails with {type(problem).__name__}: {problem}"
        ) from problem
    try:
        return getattr(module, attribute)
    except AttributeError:
        raise InputError(
            f"{name}: {module_name} has no {attribute!r}; expected {what} there"
        ) from None
