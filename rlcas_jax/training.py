"""Training from Python: :func:`train` and :func:`resume` do what the command ``rlcas_jax.train``
does.

The command is a thin layer over :func:`train_all`, as these two functions are. They are called as
``rlcas_jax.training.train``, since ``rlcas_jax.train`` is the module of the command.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from agents.config.load import ConfigError, load, validate
from agents.learning.algorithm import Algorithm
from agents.policy import inputs as own_inputs
from agents.policy.inputs import Input
from commands.folder_lock import is_unused, lock
from envs import rewards as own_rewards
from envs import scenarios as own_scenarios
from envs.encounters import Sampler
from envs.rewards import Term
from rlcas_jax import algorithm as own_algorithm
from rlcas_jax.cli import Job, Options, resumed_jobs, write_configurations
from rlcas_jax.config import TrainConfig
from rlcas_jax.devices import Devices, connect, is_writer
from rlcas_jax.figures import training_figures
from rlcas_jax.finish import finish
from rlcas_jax.interrupt import Interrupt
from rlcas_jax.loop import Callback, prepare, run
from rlcas_jax.memory import needed_bytes
from rlcas_jax.progress import Reporter

__all__ = ["Callback", "Extensions", "resume", "train", "train_all"]


class Extensions(NamedTuple):
    """Parts of a training that are the user's own, as objects instead of by ``module:name``."""

    inputs: Sequence[Input] = ()
    """Inputs of the network, beside those of the key ``network.inputs``."""
    algorithm: Callable[..., Algorithm] | None = None
    """What learns, in place of the key ``algorithm``: a class or a function with a name, called
    with a :class:`agents.learning.algorithm.Setup` and the keys of ``algorithm_settings``."""
    scenarios: Mapping[str, Sampler] = MappingProxyType({})
    """Geometries of encounters by the names under which ``scenarios`` of the configuration asks for
    them."""
    rewards: Mapping[str, Term] = MappingProxyType({})
    """Terms of the reward by the names under which ``rewards`` of the configuration weighs them."""


NONE = Extensions()
"""No part of the user's own."""


def train(
    config: TrainConfig | Mapping[str, Any] | Path | str,
    directory: Path | str,
    *,
    extensions: Extensions = NONE,
    callback: Callback | None = None,
    devices: int | None = None,
    quiet: bool = True,
) -> dict[str, Any]:
    """Train a policy in a new directory and return the summary, as ``summary.json`` holds it.

    Args:
        config: a configuration, its keys, a YAML file, or the name of a configuration that ships,
            such as ``quick``.
        directory: of the run; its files are those of the command (docs/howto/train.md).
        extensions: of the user's own. The configuration that is written names them: inputs and the
            algorithm as ``module:name``, scenarios and rewards as it did.
        callback: called after each update with its metrics by name (docs/reference/metrics.md), for
            logging elsewhere. What it raises ends the training; the last checkpoint is kept.
        devices: how many to split the encounters over; None: all that JAX sees.
        quiet: show no progress on the standard error.

    Raises:
        ConfigError: the configuration, an extension or the directory cannot be used.
        TrainingError: a loss or a parameter is no longer finite.
        OSError: a file cannot be written.
    """
    job = Job(_config_of(config, extensions), Path(directory), resume=False)
    if not is_unused(job.directory):
        raise ConfigError(f"{directory} exists and is not empty; name another, or call resume")
    (summary,) = train_all(Options(job.directory, (job,), quiet, devices=devices), callback)
    return summary


def resume(
    directory: Path | str,
    *,
    extensions: Extensions = NONE,
    callback: Callback | None = None,
    devices: int | None = None,
    quiet: bool = True,
) -> dict[str, Any]:
    """Go on with the training of a directory, as it was configured, and return the summary.

    Args:
        directory: of the run.
        extensions: those of the training's configuration that cannot be found by their names, such
            as classes of a notebook.
        callback: as of :func:`train`; also devices and quiet.

    Raises:
        ConfigError: there is no such run, or an extension of it is missing.
        CheckpointError: it has no whole checkpoint.
        TrainingError: a loss or a parameter is no longer finite.
        OSError: a file cannot be written.
    """
    _register(extensions)
    jobs = resumed_jobs(Path(directory))
    if len(jobs) > 1:
        raise ConfigError(f"{directory} holds {len(jobs)} runs; expected one of them")
    (summary,) = train_all(Options(Path(directory), jobs, quiet, True, devices), callback)
    return summary


def train_all(
    options: Options, callback: Callback | None = None, interrupt: Interrupt | None = None
) -> list[dict[str, Any]]:
    """Train the jobs of the options one after another, until the end or an interrupt; return the
    summaries of those that were begun.
    """
    interrupt = Interrupt() if interrupt is None else interrupt
    devices = connect(options.devices, options.processes)
    if not options.resumed:
        # Nothing is written before the configuration has been checked.
        prepare(options.jobs[0].config, options.jobs[0].directory, devices)
    with ExitStack() as stack:
        if is_writer():
            for folder in dict.fromkeys([options.directory, *(j.directory for j in options.jobs)]):
                stack.enter_context(lock(folder, "--resume" if options.resumed else "--out"))
                if not options.resumed and folder == options.directory and not is_unused(folder):
                    raise ConfigError(f"--out {folder}: another run has begun in it; name another")
            write_configurations(options)
        summaries: list[dict[str, Any]] = []
        for job in options.jobs:
            summaries.append(_train_seed(job, options, devices, callback, interrupt))
            if not summaries[-1]["finished"]:
                break
        if is_writer() and len(options.jobs) > 1:
            directories = [job.directory for job in options.jobs[: len(summaries)]]
            training_figures(directories, options.directory / "figures")
    return summaries


def _train_seed(
    job: Job,
    options: Options,
    devices: Devices,
    callback: Callback | None,
    interrupt: Interrupt,
) -> dict[str, Any]:
    """Train one seed and write its files; return the summary, in other processes than the first its
    end.
    """
    reporter = Reporter(quiet=options.quiet or not is_writer())
    memory = f"needs about {needed_bytes(job.config) / 2**30:.2g} GiB of memory"
    reporter.note(
        f"training {job.config.name}, seed {job.config.seed}, in {job.directory}: {memory}"
    )
    training = prepare(job.config, job.directory, devices, resume=job.resume)
    result = run(training, reporter, interrupt, callback)
    interrupt.waits_for("the evaluation of the policy")
    reporter.note("evaluating the policy")
    return finish(result) if is_writer() else {"finished": result.finished}


def _config_of(
    config: TrainConfig | Mapping[str, Any] | Path | str, extensions: Extensions
) -> TrainConfig:
    """Return the configuration, which names the extensions; these are registered."""
    names = _register(extensions)
    # Together with the rest, as it decides whether algorithm_settings are right.
    algorithm = {"algorithm": names["algorithm"]} if "algorithm" in names else {}
    if isinstance(config, TrainConfig):
        validated = validate(TrainConfig, config.model_dump() | algorithm)
    elif isinstance(config, Mapping):
        validated = validate(TrainConfig, {**config, **algorithm})
    else:
        validated = load(
            TrainConfig, Path(config), [f"{key}={name}" for key, name in algorithm.items()]
        )
    if "inputs" not in names:
        return validated
    values = validated.model_dump()
    values["network"]["inputs"] = [*validated.network.inputs, *names["inputs"]]
    return validate(TrainConfig, values)


def _register(extensions: Extensions) -> dict[str, Any]:
    """Make extensions known in this process; return what the configuration has to name: inputs and
    the algorithm. Scenarios and rewards are named there already.
    """
    names: dict[str, Any] = {}
    for name, sampler in extensions.scenarios.items():
        own_scenarios.register(name, sampler)
    for name, term in extensions.rewards.items():
        own_rewards.register(name, term)
    if extensions.inputs:
        names["inputs"] = [own_inputs.register(entry).name for entry in extensions.inputs]
    if extensions.algorithm is not None:
        names["algorithm"] = own_algorithm.register(extensions.algorithm)
    return names
