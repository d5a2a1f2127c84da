"""All published figures by one command: ``python -m eval.evidence``, then ``python -m eval.evidence
--tables``.
"""

import argparse
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

from agents.config.load import Parser, load
from agents.policy.inference import Policy
from commands.command import real, require
from commands.files import write_file
from commands.json_text import parse_json
from eval.evidence.closing import show_closing
from eval.evidence.domain import cells
from eval.evidence.dossier_page import write
from eval.evidence.listed import (
    Entry,
    Evidence,
    Reading,
    find_figures,
    read_results,
    written_results,
)
from eval.evidence.tables import publish

ROOT = Path(__file__).resolve().parents[2]
"""The checkout: list, results and pages are its."""

_LEAST = 20  # encounters of a size
_DESCRIPTION = """\
Run the evaluations of configs/evidence.yaml for the policy that ships, the most important first.
Written to --out: NAME.json of each result, and the folders of the commands. A result that is
there already, of this policy and command and at least as large, is not run again; Ctrl-C keeps
what is finished. More: docs/reference/results.md."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run or publish what the command line asks for and return the exit status."""
    options = _parser().parse_args(arguments)
    if options.scheduler is not None:
        require("--scheduler", "distributed")
    listed = load(Evidence, options.list)
    names = listed.choose(options.only)
    policy = Policy.load().sha256
    store = ROOT / "docs/reference/evidence.json"
    results = published_results(listed, policy, read_results(store), options.out)
    if options.tables:
        write_file(store, written_results(results))
        print(
            "\n".join(
                f"written: {path.relative_to(ROOT)}" for path in publish(ROOT, listed, results)
            )
        )
        return 0
    if options.dossier is not None:
        about = {"policy": policy, "commit": str(_commit())}
        print(write(ROOT, options.dossier, listed, results, about, options.out, options.junit))
        return 0
    options.out.mkdir(parents=True, exist_ok=True)
    failed = False
    for name in names:
        status = _result(name, listed, policy, options)
        print(f"{name}: {status or 'FAILED'}", flush=True)
        failed |= not status
    results = published_results(listed, policy, {}, options.out)
    show_closing(listed, results, names, options.out)
    return int(failed)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.evidence", description=_DESCRIPTION)
    add = parser.add_argument
    add(
        "--only",
        nargs="+",
        default=[],
        metavar="NAME",
        help="results, or tables for all their rows (default: all)",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument(
        "--quick", action="store_const", const=0.01, dest="scale", help="the same as --scale 0.01"
    )
    size.add_argument(
        "--scale",
        type=real(1e-4, 100.0),
        metavar="S",
        help="factor on the listed numbers of encounters (default: 1)",
    )
    add(
        "--tables",
        action="store_true",
        help="run nothing: write the tables of README and docs from --out",
    )
    add(
        "--dossier",
        type=Path,
        metavar="FILE",
        help="run nothing: write the case of configs/dossier.yaml, HTML",
    )
    add(
        "--junit",
        type=Path,
        nargs="+",
        default=[],
        metavar="XML",
        help="pytest --junitxml reports, for --dossier",
    )
    add("--scheduler", metavar="ADDRESS", help="of a Dask cluster, for the commands that take one")
    add(
        "--list",
        type=Path,
        default=ROOT / "configs/evidence.yaml",
        metavar="FILE",
        help="what is evaluated",
    )
    add(
        "--out",
        type=Path,
        default=ROOT / "runs/evidence",
        metavar="DIR",
        help="folder (default: runs/evidence)",
    )
    parser.set_defaults(scale=1.0)
    return parser


def published_results(
    listed: Evidence, policy: str, before: Mapping[str, Any], folder: Path
) -> dict[str, Any]:
    """Return the results of this policy and the listed commands, the larger one of before and of a
    folder.
    """
    results: dict[str, Any] = {}
    for name, entry in listed.results.items():
        for result in (before.get(name), read_results(folder / f"{name}.json").get(name)):
            if _size(result, entry, policy) >= max(_size(results.get(name), entry, policy), 1):
                results[name] = result
    return results


def _size(result: Any, entry: Entry, policy: str) -> int:
    """Return the size of a result; 0 of none, and of one of another policy or command."""
    if result is None or (result["policy"], result["command"]) != (
        policy,
        entry.command.format(n=result["n"]),
    ):
        return 0
    return result["n"]


def _result(name: str, listed: Evidence, policy: str, options: argparse.Namespace) -> str:
    """Make a result that is not there yet, and return what was done; nothing if its command
    failed.
    """
    entry, path = listed.results[name], options.out / f"{name}.json"
    n = (
        max(round(entry.n * options.scale), min(entry.n, _LEAST))
        if "{n}" in entry.command
        else entry.n
    )
    if _size(read_results(path).get(name), entry, policy) >= n:
        return "there already"
    if "$RLCAS_DATA" in entry.command and not os.environ.get("RLCAS_DATA"):
        return "skipped: RLCAS_DATA names no folder of public data"
    if entry.needs is not None and not os.environ.get(entry.needs):
        return f"skipped: {entry.needs} names no program"
    reading = listed.readings[entry.command.split()[0]]
    command = entry.command.format(n=n)
    folder = options.out / f"{name}-{sha256(f'{policy} {command}'.encode()).hexdigest()[:8]}"
    begun = time.perf_counter()
    report = _json_of(command, reading, folder, options.scheduler)
    if report is None:
        return ""
    figures = find_figures(report, reading.keys) | (cells(folder) if entry.cells else {})
    seconds = round(time.perf_counter() - begun, 1)
    header = {
        "policy": policy,
        "commit": _commit(),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": _machine(),
        "command": command,
        "n": n,
    }
    write_file(path, written_results({name: header | {"seconds": seconds, "figures": figures}}))
    return f"{seconds:g} s"


def _json_of(
    command: str, reading: Reading, folder: Path, scheduler: str | None
) -> dict[str, Any] | None:
    """Run a command and return what it says in JSON; None where it fails."""
    words = [sys.executable, "-m", *shlex.split(os.path.expandvars(command))]
    words += ["--out", str(folder.absolute())] if reading.file is not None or reading.chunks else []
    if reading.file is not None:
        if (reading.chunks or reading.resumes) and (folder / "config.yaml").exists():
            words += ["--resume"]
        elif folder.exists():
            shutil.rmtree(folder)  # what was begun there cannot be gone on with
        words += ["--scheduler", scheduler] if reading.chunks and scheduler else []
    print(f"$ python {shlex.join(words[1:])}", flush=True)
    output = None if reading.file is not None else subprocess.PIPE
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    # In a session of its own, so that an interrupt reaches it once, from here.
    with subprocess.Popen(
        words, cwd=ROOT, stdout=output, text=True, start_new_session=True
    ) as child:
        try:
            printed, _ = child.communicate()
        except KeyboardInterrupt:
            child.send_signal(signal.SIGINT)
            child.wait()
            raise
        finally:
            signal.signal(signal.SIGTERM, before)
    try:  # status 1 may say that what is found is bad, which must be seen
        text = (folder / reading.file).read_text() if reading.file else printed.splitlines()[-1]
        return parse_json(text) if child.returncode in (0, 1) else None
    except (OSError, ValueError, IndexError):
        return None


def _commit() -> str | None:
    command = [
        "git",
        "-C",
        str(ROOT),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",
    ]
    process = (
        subprocess.run(command, capture_output=True, text=True, check=False)
        if shutil.which("git")
        else None
    )
    return process.stdout.strip() or None if process else None


def _machine() -> str:
    info = Path("/proc/cpuinfo")
    model = re.search(
        r"model name\s*: (.*)", info.read_text(encoding="utf-8") if info.exists() else ""
    )
    return f"{model[1] if model else platform.machine()}, {os.cpu_count()} cores"
