"""Encounters from one form of file to another: ``python -m eval.convert encounters.json
own.csv``.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from commands.command import ConfigError, Parser, run_cli
from commands.files import write_whole
from envs.encounters import EncounterError
from envs.formats import encounter_file
from envs.formats.encounter_exchange import (
    ExchangedEncounter,
    check_same,
    daidalus_text,
    is_number,
    lincoln_objects,
    rows_of_scenes,
    scenes_of,
    scenes_of_tracks,
)
from envs.formats.lincoln_file import read_lincoln, tracks_of
from envs.formats.track_files import read_daidalus
from envs.traffic.track_units import FOOT
from envs.traffic.tracks import TrackError, sum_of_repairs

_DESCRIPTION = """\
Turn encounters from one form of file into another; the names' ends say which:

  .csv         our own (columns in docs/howto/own-encounters.md), for --scenario file:PATH
  .json        two-aircraft encounters of MIT Lincoln Laboratory's form
  .daa, .xyz   one encounter in the form of NASA's DAIDALUS; written with local positions

What the other form cannot hold is refused in one sentence; with --lossy it is left out, counted
and named. What was written is read again before the file gets its name."""

_EPILOG = """\
examples:
  python -m eval.convert own.csv own.json --altitude-ft 5000 --lossy
  python -m eval.convert own.csv one.xyz --encounter "from the right" --altitude-ft 5000 --lossy
  python -m eval.convert scenario.daa own.csv --lossy"""

_TRACKS = (".daa", ".xyz")


def main(arguments: Sequence[str] | None = None) -> int:
    """Convert what the command line names and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    for path in (options.source, options.target):
        if path.suffix not in (".csv", ".json", *_TRACKS):
            raise ConfigError(f"{path} ends in {path.suffix!r}; expected .csv, .json, .daa or .xyz")
    if options.target.exists():
        raise ConfigError(f"{options.target} is there already, expected a new file")
    count = _convert(options)
    print(f"{options.target}: {count} encounter{'s' if count != 1 else ''}")
    return 0


def _parser() -> argparse.ArgumentParser:
    from commands.command import real, whole

    parser = Parser(prog="python -m eval.convert", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("source", type=Path, metavar="FROM", help="file to read")
    add("target", type=Path, metavar="TO", help="file to write, a new one")
    add("--encounter", metavar="NAME", help="convert this one alone (default: all)")
    add(
        "--altitude-ft",
        type=real(-2_000.0, 60_000.0, "ft"),
        metavar="FT",
        help="altitude of encounters that have none",
    )
    seconds = "length of tracks that are made of our encounters (default: 300)"
    add("--seconds", type=whole(1, 3_600), default=300, metavar="S", help=seconds)
    ahead = "goal, where the form has none (default: 220 s ahead)"
    add("--ahead", type=real(10.0, 3_600.0, "s"), default=220.0, metavar="S", help=ahead)
    add(
        "--repair",
        action="store_true",
        help="drop what is wrong in tracks, accept gaps, and say what was done",
    )
    add(
        "--lossy",
        action="store_true",
        help="leave out what the other form cannot hold, and name it",
    )
    return parser


def _convert(options: argparse.Namespace) -> int:
    source, target = options.source, options.target.suffix
    scenes = _read(source, source.suffix, options.seconds, options.repair)
    if options.encounter is not None:
        names = [scene.name for scene in scenes]
        scenes = [scene for scene in scenes if scene.name == options.encounter]
        if not scenes:
            raise ConfigError(
                f"--encounter: {options.encounter!r} is not in {source}; it holds {names[:5]} ..."
            )
    lost = _losses(scenes, target)
    if lost and not options.lossy:
        raise ConfigError(
            f"{options.target} cannot hold {'; '.join(lost)}; expected --lossy to leave it out"
        )
    if target in _TRACKS and len(scenes) != 1:
        raise ConfigError(
            f"{source} holds {len(scenes)} encounters and {target} files one, expected "
            "--encounter NAME"
        )
    _write(options, scenes)
    for sentence in lost:
        print(f"left out: {sentence}", file=sys.stderr)
    return len(scenes)


def _losses(scenes: Sequence[ExchangedEncounter], target: str) -> list[str]:
    """Return what a form of file cannot hold of the encounters, with how many have it."""
    losses: dict[str, list[ExchangedEncounter]] = {}
    for kind in sorted({kind for scene in scenes for kind, rows in scene.left_out.items() if rows}):
        affected = [scene for scene in scenes if scene.left_out.get(kind)]
        losses[f"{sum(scene.left_out[kind] for scene in affected)} {kind}"] = affected
    if target == ".csv":
        losses["altitudes"] = [scene for scene in scenes if scene.altitudes]
        losses["the ownship's motion after the start"] = [
            scene for scene in scenes if not scene.straight(0)
        ]
    else:
        losses["the goal"] = [scene for scene in scenes if scene.goal is not None]
        losses["the noise of reports"] = [scene for scene in scenes if any(scene.sensor)]
    if target == ".json":
        losses["the name"] = [scene for scene in scenes if not is_number(scene.name)]
    else:
        losses["the weight"] = [scene for scene in scenes if scene.weight != 1.0]
    return [
        f"{part} of {len(affected)} of {len(scenes)} encounters, the first {affected[0].name!r}"
        for part, affected in losses.items()
        if affected
    ]


def _read(path: Path, form: str, seconds: int, repair: bool) -> list[ExchangedEncounter]:
    if form == ".csv":
        return scenes_of(*encounter_file.read(path), seconds)
    if form == ".json":
        encounters = read_lincoln(path, repair=repair)
        repairs = sum_of_repairs([encounter.repairs for encounter in encounters])
        recorded = [
            (str(encounter.number), tracks_of(encounter), encounter.weight)
            for encounter in encounters
        ]
    else:
        tracks, repairs = read_daidalus(path, repair=repair)
        recorded = [(path.stem, tracks, 1.0)]
    if any(repairs):
        print(
            "repaired: " + ", ".join(f"{v} {k}" for k, v in repairs._asdict().items() if v),
            file=sys.stderr,
        )
    return scenes_of_tracks(recorded)


def _write(options: argparse.Namespace, scenes: list[ExchangedEncounter]) -> None:
    target, form = options.target, options.target.suffix
    altitude = None if options.altitude_ft is None else options.altitude_ft * FOOT
    longest = max(len(scene.tracks[0].time) for scene in scenes) - 1
    try:
        with write_whole(target) as new:
            try:
                if form == ".csv":
                    encounter_file.write_rows(
                        new, rows_of_scenes(scenes, options.ahead), [s.name for s in scenes]
                    )
                elif form == ".json":
                    new.write_text(
                        json.dumps(lincoln_objects(scenes, altitude), allow_nan=False) + "\n",
                        "utf-8",
                    )
                else:
                    new.write_text(daidalus_text(scenes[0], altitude), "utf-8")
                again = _read(new, form, longest, repair=False)
                check_same(scenes, again, own=form != ".csv", altitudes=form != ".csv")
            except (EncounterError, TrackError) as problem:
                raise EncounterError(
                    str(problem).replace(str(new), f"{target}, as it would be")
                ) from None
    except OSError as problem:
        raise ConfigError(f"{target}: cannot be written: {problem.strerror}") from None


if __name__ == "__main__":
    run_cli("eval.convert:main")
