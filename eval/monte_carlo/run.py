"""Monte Carlo evaluation of a policy: ``python -m eval.monte_carlo --encounters 10000 --out runs/first``."""

import argparse
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.load import Parser
from eval.runner.command import cluster_of, concluded, flown_on, run_in, whole_table
from eval.runner.options import first_options, last_options, loaded, named_evaluation, whole

if TYPE_CHECKING:
    from agents.policy.inference import Policy
    from eval.config import MonteCarloConfig
    from eval.runner.outputs import RunFolder


_DESCRIPTION = """\
Fly a policy through many encounters and say how often it succeeds, with intervals.

Sampled scenarios: circle (the paper's), crossing_left, crossing_right, head_on, same_course, maneuvering, noisy,
multi; or file:PATH for a CSV file (columns in docs/howto/own-encounters.md), tracks:PATH for recorded tracks
(a .json file of Lincoln Laboratory's encounters or of ADS-B reports, a .daa or .xyz file of DAIDALUS), lincoln:PATH for
traffic drawn from a file of one of Lincoln Laboratory's encounter models.

Written to --out: summary.json, encounters.parquet (a row an encounter), config.yaml as resolved, and figures as PNG
and SVG. The same config.yaml gives the same table again, bit for bit, on the same kind of machine and versions,
however many workers fly it."""

_EPILOG = """\
examples:
  python -m eval.monte_carlo --policy runs/quick/policy.safetensors --out runs/circle
  python -m eval.monte_carlo --scenario multi --encounters 2000 --out runs/multi
  python -m eval.monte_carlo --set changes.min_initial_separation=0 --out runs/unfiltered
  python -m eval.monte_carlo --policy mine.safetensors --aircraft uas --out runs/uas
  python -m eval.monte_carlo --resume --out runs/circle        go on with a run that was interrupted
  python -m eval.monte_carlo --scheduler tcp://node7:8786 --encounters 1000000 --out runs/many

Every key of the configuration, with its unit and default: python -m eval.monte_carlo --help-keys"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the evaluation of the command line and return the exit status; bad input raises ``InputError``."""
    options = _parser().parse_args(arguments)
    if options.help_keys:
        from agents.config.keys import help_text
        from eval.config import MonteCarloConfig

        print(help_text(MonteCarloConfig))
        return 0
    return concluded(_evaluate, options)


def run_quietly(arguments: Sequence[str], folder: Path, *, resume: bool = False) -> int:
    """Fly an evaluation of several without figures and without its table for a person; return the exit status."""
    again = ["--resume"] if resume and (folder / "config.yaml").is_file() else []
    with redirect_stdout(StringIO()):
        return main([*arguments, "--set", "figures=false", *again, "--out", str(folder)])


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.monte_carlo", description=_DESCRIPTION, epilog=_EPILOG)
    first_options(parser)
    add = parser.add_argument
    add(
        "--mode",
        metavar="MODE",
        help="what decides: policy (the network once a second), plan (planned once, then followed) or assured "
        "(planned, monitored and planned again); default: policy",
    )
    add("--scenario", metavar="NAME", help="a name, file:PATH, tracks:PATH or lincoln:PATH (default: circle)")
    add(
        "--repair",
        action="store_const",
        const="true",
        help="drop and fill what is wrong in recorded tracks, and say what was done (default: refuse such files)",
    )
    add("--encounters", type=whole(1), metavar="N", help="how many (default: 10000, or all of a file's)")
    add("--seed", type=whole(0), metavar="N", help="of encounters, sensor noise and bootstrap (default: 0)")
    add("--baseline", metavar="NAME", help="decides in the policy's place: rules, mvp or mvp_speed (default: none)")
    last_options(parser, "monte_carlo")
    return parser


def _evaluate(options: argparse.Namespace) -> int:
    begun = time.perf_counter()
    config = _config(options)
    from eval.flights.chunks import Pilot, columns
    from eval.flights.sources import said, say
    from eval.runner.outputs import RunFolder
    from eval.runner.workers import DECISIVE, Task, cores

    packages = ("jax", "jaxlib") if config.backend == "jax" else ()
    with cluster_of(options, packages) as cluster:
        workers = config.workers or cores() if cluster is None else cluster.size()
        if cluster is not None and config.backend == "auto":
            config = config.model_copy(update={"backend": "numpy"})
        evaluation, policy, resolved = named_evaluation(config)
        config = config.model_copy(update=resolved)
        config = config.model_copy(update={"chunk": config.chunk_for(config.wanted, workers)})
        say(evaluation.source)
        folder = RunFolder(options.out or Path("runs") / time.strftime("monte_carlo_%Y%m%d_%H%M%S"), config)
        task = Task(Pilot, columns, (*DECISIVE, *packages))
        fly = flown_on(cluster, workers, task, evaluation, policy.sha256)
        with run_in(folder, config, resume=options.resume):
            table, flown = whole_table(folder, config, fly, "chunks", "python -m eval.monte_carlo")
            wall_s = time.perf_counter() - begun
            summary = _summary(table, config, policy, wall_s, flown) | said(evaluation.source)
            paths = [folder.write_summary(summary)]
            if config.figures:
                from eval.plots.encounters import draw_all

                paths += draw_all(folder, table, evaluation)
    _show(summary, folder, paths)
    return 0


def _config(options: argparse.Namespace) -> "MonteCarloConfig":
    from eval.config import MonteCarloConfig

    keys = {key: key for key in ("mode", "encounters", "seed", "baseline", "workers")}
    return loaded(MonteCarloConfig, options, keys | {"repair": "tracks.repair"}, "--")


def _summary(table: Any, config: "MonteCarloConfig", policy: "Policy", wall_s: float, flown: int) -> dict[str, Any]:
    from envs.edge.installation import versions
    from eval.flights.aircraft import described
    from eval.metrics.summary import SCHEMA_VERSION, summarise
    from eval.metrics.weighted import summarise_weighted

    how = (config.confidence, config.resamples, config.seed)
    return {
        "schema_version": SCHEMA_VERSION,
        "encounters": config.wanted,
        "seed": config.seed,
        "scenario": config.scenario,
        "changes": config.changes,
        "mode": config.mode,
        "baseline": config.baseline,
        "backend": config.backend,
        "policy_sha256": policy.sha256,
        **described(config.flown_aircraft(policy), policy),
        "confidence": config.confidence,
        **summarise(table, *how),
        "weighted": summarise_weighted(table, *how),
        "outside_domain": _outside(table, policy.for_aircraft(config.flown_aircraft(policy), outside="allow")),
        "wall_s": wall_s,
        "encounters_flown_now": flown,
        "encounters_per_s": flown / wall_s if flown else None,
        "versions": versions("numpy", "safetensors", "pyarrow", "scipy"),
    }


def _outside(table: Any, policy: "Policy") -> dict[str, int]:
    """Return how many encounters begin outside the operating domain, by quantity; none is left out."""
    from agents.policy.domain import excess

    columns = {"own_speed": "own_speed_m_s", "intruder_speed": "intruder_speed_m_s", "distance": "distance_m"}
    columns["intruders"] = "intruders"
    return {name: int((excess(policy.domain[name], table[column]) > 0.0).sum()) for name, column in columns.items()}


def _show(summary: dict[str, Any], folder: "RunFolder", paths: list[Path]) -> None:
    from agents.config.progress import spaced
    from eval.flights.aircraft import lines_about
    from eval.metrics.summary import headline, print_table

    decider = summary["mode"] if summary["baseline"] == "none" else f"baseline {summary['baseline']}"
    title = f"{spaced(summary['encounters'])} encounters, {decider}, scenario {summary['scenario']}"
    names = ("", "value", f"{100.0 * summary['confidence']:g} % interval", "count")
    notes = []
    ratio, ends = summary["risk_ratio"], summary["risk_ratio_interval"]
    if ratio is not None and ends["high"] - ends["low"] > ratio:
        notes.append("the interval of the risk ratio is wide (half of it exceeds half the ratio): fly more encounters")
    notes += lines_about(summary)
    if summary["encounters_per_s"] is not None:
        notes.append(f"{summary['wall_s']:.1f} s, {summary['encounters_per_s']:.0f} encounters/s")
    files = sorted({path.name for path in paths} | {folder.table, "config.yaml"})
    notes.append(f"files: {folder.path}: {', '.join(files)}")
    print_table(f"{title}, seed {summary['seed']}", names, [line[1:] for line in headline(summary, {})], notes)
