"""Mutation of what decides: ``python -m tests.mutants ROOM [--only TEXT] [--workers N]``.

A room is a module beside this one, such as ``check``, with a table ``MUTANTS``. Each mutant
replaces a text of one file in a copy of the checkout and runs its tests there; at least one of them
must fail. One line a mutant says what came of it; exit status 1 means that a mutant survived.
"""

import argparse
import importlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from tests.mutants.mutant import ROOT, Mutant, mutated

SECONDS = 300.0  # for the tests of a mutant; one that never ends is noticed too
PASSED, FAILED = 0, 1  # exit statuses of pytest


def copy_checkout(folder: Path) -> None:
    """Copy the files that git tracks or would track."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        source, target = ROOT / name, folder / name
        if source.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target, follow_symlinks=False)


def status_of(tests: tuple[str, ...], checkout: Path) -> int | None:
    """Return the exit status of some tests, run in a checkout until one fails; None: they do not
    end.
    """
    command = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    try:
        completed = subprocess.run(
            command,
            cwd=checkout,
            env=os.environ | {"PYTHONPATH": str(checkout)},
            capture_output=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None
    return completed.returncode


def outcome(mutant: Mutant, checkout: Path) -> str:
    """Return what the tests say of a mutant in a checkout, which is afterwards as it was."""
    path = checkout / mutant.file
    source = path.read_text(encoding="utf-8")
    path.write_text(mutated(mutant, source), encoding="utf-8")
    try:
        status = status_of(mutant.tests, checkout)
    finally:
        path.write_text(source, encoding="utf-8")
    return {PASSED: "SURVIVED", FAILED: "killed", None: "killed (endless)"}.get(status, "BROKEN")


def run(mutants: list[Mutant], workers: int) -> list[Mutant]:
    """Run the tests of some mutants, print what came of each, and return those that were not
    killed.

    Raises ValueError where tests fail without a mutant: they would kill all.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as executor:
        checkouts: SimpleQueue[Path] = SimpleQueue()
        for number in range(workers):
            copy_checkout(checkout := Path(folder, str(number)))
            checkouts.put(checkout)

        for tests in {mutant.tests for mutant in mutants}:
            if status_of(tests, checkout) != PASSED:
                raise ValueError(f"{' '.join(tests)}: do not pass without a mutant")

        def is_killed(mutant: Mutant) -> bool:
            checkout, began = checkouts.get(), time.monotonic()
            result = outcome(mutant, checkout)
            checkouts.put(checkout)
            line = f"{result} in {time.monotonic() - began:.0f} s: {mutant.file}: {mutant.text!r}"
            print(f"{line} -> {mutant.replacement!r}", flush=True)
            return result.startswith("killed")

        killed = executor.map(is_killed, mutants)
        return [mutant for mutant, dead in zip(mutants, killed, strict=True) if not dead]


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("room", help="module of this folder with the mutants")
    parser.add_argument("--only", default="", help="mutants whose file or text holds this")
    parser.add_argument("--workers", type=int, default=1, help="tests at a time (default 1)")
    options = parser.parse_args(arguments)
    room: tuple[Mutant, ...] = importlib.import_module(f"tests.mutants.{options.room}").MUTANTS
    mutants = [
        mutant for mutant in room if options.only in mutant.file or options.only in mutant.text
    ]
    if not mutants:
        parser.error(f"no mutant of {options.room} holds {options.only!r}")
    try:
        alive = run(mutants, options.workers)
    except ValueError as problem:
        print(problem, file=sys.stderr)
        return 2
    print(f"{len(mutants)} mutants, {len(alive)} not killed")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
