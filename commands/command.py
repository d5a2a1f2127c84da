"""A command line that refuses in one sentence, and the guard around every program's main function.

Nothing but the standard library is imported here, so that the guard also catches what is not
installed.
"""

import argparse
import ast
import errno
import importlib
import importlib.util
import io
import os
import sys
import traceback
import unicodedata
from collections.abc import Callable, Iterable
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, NoReturn

from commands.installation import extra_of, foreign

_HIDDEN = {"Cc", "Cf", "Zl", "Zp"}


class InputError(ValueError):
    """Bad input of a user; the message is one sentence: what is wrong, where, what was expected."""


class ConfigError(InputError):
    """A command line or a configuration that cannot be used."""


class Parser(argparse.ArgumentParser):
    """An argument parser that raises :class:`ConfigError` where argparse would print its usage and
    exit.

    It also refuses what argparse accepts silently: an option that stands twice, of which it takes
    the last, and arguments that are no text. Every parser knows ``--version``.
    """

    def __init__(self, **settings: Any) -> None:
        if Path(sys.argv[0]).name.startswith("rlcas-"):
            settings["prog"] = Path(sys.argv[0]).name
        settings.setdefault("allow_abbrev", False)
        settings.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(**settings)
        self.stored: set[str] = set()
        for name in (None, "store"):
            self.register("action", name, _Once)
        self.add_argument("--version", action="version", version=_version())

    def error(self, message: str) -> NoReturn:
        """Raise instead of exiting."""
        raise ConfigError(f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Parse arguments, those of the process by default."""
        given = sys.argv[1:] if args is None else list(args)
        for word in given:
            try:
                word.encode()
            except UnicodeEncodeError:
                self.error(f"argument {word!r} holds bytes that are not UTF-8; expected a text")
        self.stored.clear()
        return super().parse_known_args(given, namespace)


class _Once(argparse.Action):
    """Stores a value; an option that stands twice is refused."""

    def __call__(
        self,
        parser: Any,  # a Parser: argparse has its own class here
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        if option_string is None and values is self.default:
            return  # an argument that may be left out, and is
        if self.dest in parser.stored:
            name = option_string or self.metavar or self.dest
            parser.error(f"argument {name} stands twice; expected it once")
        parser.stored.add(self.dest)
        setattr(namespace, self.dest, values)


def require(asker: str, *modules: str) -> None:
    """Raise :class:`ConfigError` where a module is not installed that an option, or whatever
    ``asker`` names, will need: asked for before anything begins.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise ConfigError(f"{asker} needs {module}, which {_to_install(module, '')}")


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return a type of an option: a whole number of at least ``least``, at most ``most``."""
    expected = (
        f"a whole number of at least {least}"
        if most is None
        else f"a whole number, {least} to {most}"
    )

    def value(text: str) -> int:
        if (
            not text.isascii()
            or not text.isdecimal()
            or int(text) < least
            or (most is not None and int(text) > most)
        ):
            raise argparse.ArgumentTypeError(f"{text!r}; expected {expected}")
        return int(text)

    return value


def real(low: float, high: float, unit: str = "") -> Callable[[str], float]:
    """Return a type of an option: a number from ``low`` to ``high``, in a unit for messages."""
    unit = f" {unit}" if unit else ""

    def value(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"{text!r}; expected a number, {low:g} to {high:g}{unit}"
            ) from None
        if not low <= number <= high:  # inverted for nan
            raise argparse.ArgumentTypeError(
                f"{number:g}{unit}; expected {low:g} to {high:g}{unit}"
            )
        return number

    return value


def run_cli(main: Callable[[], int | None] | str) -> NoReturn:
    """Run a program's main function and exit with its status.

    Bad input (:class:`InputError`) and a missing extra end with one line on stderr and status 2; a
    full disk and what no machine holds with one line and status 1; Ctrl-C with 130. Where an extra
    is missing ``--help`` says what the program does and what to install. Everything else is a
    defect and keeps its traceback. ``main`` returns the status (None: 0) or is a name,
    ``package.module:function``, to be imported under the guard.
    """
    _settle_surroundings()
    try:
        status = _run(main)
        sys.stdout.flush()
    except InputError as problem:
        status = _say(str(problem), 1 if _disk_full(problem) else 2)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        status = 130
    except BrokenPipeError:
        # What reads the output has ended (``| head``); what is still buffered must not complain at
        # the exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except ModuleNotFoundError as problem:
        command = main if isinstance(main, str) else ""
        if extra_of(problem.name, command) is None:
            raise
        if {"-h", "--help"} & set(sys.argv[1:]):
            print(f"usage: {Path(sys.argv[0]).name} [options]\n\n{_purpose(main)}\n")
            install = _install(problem.name, command)
            print(f"Its options can be listed once {problem.name} is installed: {install}")
            status = 0
        else:
            status = _say(f"{problem.name} {_to_install(problem.name, command)}", 2)
    except OSError as problem:
        if problem.errno is None:
            raise
        status = _say(f"{problem.filename or 'a file'}: {os.strerror(problem.errno)}", 1)
        if problem.errno == errno.ENOSPC:
            # Buffered output to the full disk must not complain again at the exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (MemoryError, RecursionError, OverflowError) as problem:
        texts = {
            MemoryError: "out of memory",
            RecursionError: "nested too deeply",
            OverflowError: "a number too large",
        }
        words = next(text for kind, text in texts.items() if isinstance(problem, kind))
        status = _say(f"{words}: {str(problem) or type(problem).__name__}, {_place(problem)}", 1)
    sys.exit(status)


# What pyproject.toml installs as rlcas-train and so on.
compare = partial(run_cli, "eval.compare.run:main")
display = partial(run_cli, "ros_bridge.display.run:main")
evaluate = partial(run_cli, "eval.monte_carlo.run:main")
hifi = partial(run_cli, "eval.hifi.run:main")
mavlink = partial(run_cli, "ros_bridge.mavlink.program:main")
report = partial(run_cli, "eval.report.run:main")
sweep = partial(run_cli, "rlcas_jax.sweep.run:main")
train = partial(run_cli, "rlcas_jax.train:main")


def visible(text: str) -> str:
    """Return a text with its control and format characters, which may reverse what follows, as
    their codes.

    Line feeds stay.
    """
    return "".join(
        f"\\u{ord(character):04x}"
        if character != "\n" and unicodedata.category(character) in _HIDDEN
        else character
        for character in text
    )


def _settle_surroundings() -> None:
    """Let figures and texts be written whatever the environment says of screens and encodings.

    Programs draw into files, while matplotlib refuses to load where ``MPLBACKEND`` names a backend
    that is not installed, as notebooks hand theirs on. A character that the output's encoding lacks
    stands there as its code.
    """
    os.environ["MPLBACKEND"] = "agg"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _disk_full(problem: BaseException | None) -> bool:
    """Return whether an error, or its cause, says that the disk is full."""
    while problem is not None:
        if isinstance(problem, OSError) and problem.errno == errno.ENOSPC:
            return True
        problem = problem.__cause__ or problem.__context__
    return False


def _run(main: Callable[[], int | None] | str) -> int:
    if sys.argv[1:] == ["--version"]:  # also where the command itself cannot be imported
        print(_version())
        return 0
    refusal = foreign()
    if refusal:
        raise InputError(refusal)
    if not isinstance(main, str):
        return main() or 0
    module, _, name = main.partition(":")
    return getattr(importlib.import_module(module), name)() or 0


def _purpose(main: Callable[[], int | None] | str) -> str:
    """Return what a program says of itself, without importing it."""
    if not isinstance(main, str):
        return (sys.modules["__main__"].__doc__ or "").strip()
    module = main.partition(":")[0]
    path = Path(__file__).resolve().parents[1].joinpath(*module.split(".")).with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or module).strip()


def _version() -> str:
    try:
        return f"rlcas-toolkit {metadata.version('rlcas-toolkit')}"
    except metadata.PackageNotFoundError:
        return "rlcas-toolkit, not installed"


def _install(module: str | None, command: str) -> str:
    """Return what installs a module of an extra."""
    return f"pip install 'rlcas-toolkit[{extra_of(module, command)}]'"


def _to_install(module: str | None, command: str) -> str:
    return f"is not installed; expected the extra: {_install(module, command)}"


def _say(sentence: str, status: int) -> int:
    print("error:", visible(" ".join(sentence.split())), file=sys.stderr)
    return status


def _place(problem: BaseException) -> str:
    """Return the innermost line of the toolkit in a traceback."""
    root = Path(__file__).resolve().parents[1]
    frames = traceback.extract_tb(problem.__traceback__)
    ours = [frame for frame in frames if Path(frame.filename).is_relative_to(root)]
    last = (ours or frames)[-1]
    return f"{Path(last.filename).name}, line {last.lineno}"
