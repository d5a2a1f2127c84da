"""One policy whose weights are the mean of several: ``python -m rlcas_jax.average A.safetensors=1 B.safetensors=1``.

Of whole runs, their directories in place of the files, it is a run that a training can begin with.

Policies that were trained one from the other differ little enough for that to be a policy again, and often one beyond
the trade between them: what the last steps of either owe to chance is averaged out (Izmailov et al. 2018; Wortsman et
al. 2022).
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from agents.config.load import ConfigError, Parser, run_cli
from agents.policy.file import PolicyFile, PolicyFileError, read, write
from rlcas_jax import checkpoint

__all__ = ["average", "main"]

_DESCRIPTION = """\
Write the policy whose weights are the mean of those of several, which should have been trained one from the other, and
must have the same network, inputs and limits of the vehicle. The shares are divided by their sum. Of runs, whose
directories may stand in place of the files, their critics and optimisers are averaged, too, and the directory that is
written is one that start_from takes."""

_EPILOG = """\
examples:
  python -m rlcas_jax.average runs/a/policy.safetensors=0.4 runs/b/policy.safetensors=0.6 --out runs/policy.safetensors
  python -m rlcas_jax.average runs/a=0.4 runs/b=0.6 --out runs/mean

The new policy carries the configuration of the last policy named and, in its notes, share and digest of each."""


def average(policies: Sequence[tuple[PolicyFile, float]]) -> PolicyFile:
    """Return the policy whose weights are the weighted mean of those of several.

    Args:
        policies: content and share of each; shares above 0, divided by their sum. The metadata are the last one's.

    Raises:
        PolicyFileError: networks, inputs or limits differ, or the mean is no policy.
    """
    from agents.learning.export import to_policy_file, variables

    last = policies[-1][0]
    total = math.fsum(share for _, share in policies)
    for content, _ in policies:
        for name in ("architecture", "limits", "observation", "action"):
            if content.metadata[name] != last.metadata[name]:
                raise PolicyFileError(
                    f"policy {content.sha256[:8]}: its {name} is {content.metadata[name]}, expected "
                    f"{last.metadata[name]} as of policy {last.sha256[:8]}"
                )
    mean = {
        name: sum(content.actor[name].astype(float) * (share / total) for content, share in policies)
        for name in last.actor
    }
    made_of = ", ".join(f"{share / total:.4g} of {content.sha256[:8]}" for content, share in policies)
    return to_policy_file(
        variables(mean),
        last.hidden,
        last.feature_set,
        last.limits,
        last.metadata["training"]["config"],
        steps=last.metadata["training"]["steps"],
        notes=f"mean of the weights of {made_of}; configuration and steps are those of the last",
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what the command line asks for, and return the exit status.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``CheckpointError``.
    """
    parser = Parser(prog="python -m rlcas_jax.average", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument(
        "policies", nargs="+", type=_weighted, metavar="FILE=SHARE", help="policy file, or run, and its share"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", required=True, help="new policy file, or directory of a run"
    )
    options = parser.parse_args(arguments)
    from rlcas_jax.finish import POLICY  # with the whole training: not for --help

    if options.out.exists():
        raise ConfigError(f"--out {options.out} exists, expected the name of a new file")
    runs = [path.is_dir() for path, _ in options.policies]
    if any(runs) and not all(runs):
        path = options.policies[runs.index(False)][0]
        raise ConfigError(f"{path} is no directory, expected runs alone or policy files alone")
    found = average([(read(path / POLICY if path.is_dir() else path), share) for path, share in options.policies])
    if all(runs):
        _save_learners(options.out / "checkpoints", options.policies)
    write(options.out / POLICY if all(runs) else options.out, found)
    print(f"{options.out}: policy {found.sha256[:8]}, {found.metadata['notes']}")
    return 0


def _save_learners(out: Path, runs: Sequence[tuple[Path, float]]) -> None:
    """Write the mean of what runs have learned as the checkpoint of a run, which ``start_from`` takes."""
    total = math.fsum(share for _, share in runs)
    newest = [(checkpoint.latest(path / "checkpoints"), share / total) for path, share in runs]
    checkpoint.save_mean(out, newest, "learner")


def _weighted(text: str) -> tuple[Path, float]:
    """Return path and share of ``FILE=SHARE``."""
    path, _, share = text.rpartition("=")
    try:
        number = float(share)
    except ValueError:
        number = math.nan
    if not path or not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(
            f"{text!r}; expected FILE=SHARE with a share above 0, such as a.safetensors=0.5"
        )
    return Path(path), number


if __name__ == "__main__":
    run_cli(main, PolicyFileError, checkpoint.CheckpointError)
