"""The options that the commands share, and what they name: configuration, policy, encounters."""

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from agents.config.load import AIRCRAFT, ConfigError, Strict, check_once, file_of, load
from agents.policy import inputs
from agents.policy.inference import Policy
from commands.command import real, visible, whole
from commands.extension import is_extension, load_extension
from envs import scenarios
from envs.aircraft import Aircraft
from envs.areas import Area, AreaError
from envs.encounters import EncounterError, Sampler
from envs.formats.areas import read_near_areas
from envs.formats.local_frame import LocalFrame
from eval.config import PREFIXES, EncountersConfig, MonteCarloConfig, PolicyConfig
from eval.flights.chunks import Evaluation
from eval.flights.sources import Source, most_intruders, read_source

Config = TypeVar("Config", bound=EncountersConfig)
Model = TypeVar("Model", bound=Strict)


def first_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that a command begins with: configuration and policy."""
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="YAML file with what differs from the defaults")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of the configuration",
    )
    add("--help-keys", action="store_true", help="list every key of the configuration, and exit")
    add("--policy", type=Path, metavar="FILE", help="policy file (default: the one that ships)")
    names = "c208, jet, light, paper, uas"
    add(
        "--aircraft",
        type=Path,
        metavar="FILE",
        help=f"YAML file, or a name: {names} (default: the policy's own)",
    )
    add(
        "--allow-outside-domain",
        action="store_true",
        help="fly what the policy was not trained for, too",
    )
    add(
        "--policy-sha256",
        metavar="DIGEST",
        help="SHA-256 that the policy must have, 64 hex digits (default: any)",
    )
    extension_option(parser)


def extension_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that names code of the user's own, which :func:`load_extensions` loads."""
    parser.add_argument(
        "--extension",
        action="append",
        default=[],
        metavar="MODULE:NAME",
        help="input or scenario of your own that is needed, may be repeated (default: none)",
    )


def scenario_option(parser: argparse.ArgumentParser, *files: str, when: str = "") -> None:
    """Add the option of the scenario; ``files`` are the prefixes of those that it may name, of
    :data:`eval.config.PREFIXES`; the help begins with ``when``.
    """
    kinds = " or ".join(f"{kind}PATH" for kind in files)
    own = "module:name of your own"
    parser.add_argument(
        "--scenario",
        metavar="NAME",
        help=f"{when}{scenarios.expected(own)}{kinds and f'; or {kinds}'} (default: circle)",
    )


def load_extensions(names: Iterable[str]) -> None:
    """Load and register the code that the user names: inputs of the network, and scenarios.

    Call this only with what the user has written by hand, never with what a policy file says.

    Raises:
        InputError: there is no such code, or it cannot be used.
    """
    for name in names:
        if name in scenarios.SAMPLERS:
            continue
        if is_extension(name) and isinstance(load_extension(name, _EXTENSION), Sampler):
            scenarios.resolve(name)
        else:
            inputs.resolve([name])


_EXTENSION = "an input of the network (agents.policy.inputs.Input) or a scenario"


def run_argument(parser: argparse.ArgumentParser, help_text: str) -> None:
    """Add the folder of a run that a command reads, ``run``; it may also stand after ``--run``."""
    add = parser.add_argument
    add("run", type=Path, nargs="?", metavar="DIR", help=help_text)
    add("--run", type=Path, metavar="DIR", help=argparse.SUPPRESS)


def config_option(parser: argparse.ArgumentParser, run: str) -> None:
    """Add the option of a file that holds the configuration; ``run`` is what writes such files,
    such as ``a comparison``.
    """
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help=f"YAML file, such as {run}'s config.yaml"
    )


def policy_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that name a policy, for :func:`given_policy`."""
    add = parser.add_argument
    add("--policy", type=Path, metavar="FILE", help="policy file (default: the one that ships)")
    add(
        "--policy-sha256", metavar="DIGEST", help="SHA-256 that the policy must have (default: any)"
    )


def confidence_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of the level of a command's intervals, which the configuration holds."""
    parser.add_argument(
        "--confidence",
        type=real(0.5, 0.999999),
        metavar="P",
        help="confidence of all intervals (default: 0.95)",
    )


def new_folder_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of the folder that a command fills, which must be given."""
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for what is written, new or empty",
    )


def default_folder(name: str) -> Path:
    """Return the folder of a command's run where none is named."""
    return Path("runs") / time.strftime(f"{name}_%Y%m%d_%H%M%S")


def workers_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of the processes that fly."""
    parser.add_argument(
        "--workers",
        type=whole(0),
        metavar="N",
        help="processes; 0: one for every core (default: 0)",
    )


def resume_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that goes on with a run, for :func:`config_file`."""
    parser.add_argument(
        "--resume", action="store_true", help="go on with the run in --out instead of beginning one"
    )


def last_options(parser: argparse.ArgumentParser, name: str) -> None:
    """Add the options that a command ends with: workers, and the run's folder, whose default begins
    with ``name``.
    """
    add = parser.add_argument
    workers_option(parser)
    add(
        "--scheduler",
        metavar="ADDRESS",
        help="fly on a Dask cluster instead, such as tcp://node7:8786",
    )
    resume_option(parser)
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"folder of the run (default: runs/{name}_DATE_TIME)",
    )


def override(key: str, value: Any) -> str:
    """Return a key's value as ``KEY=VALUE``: words as they stand, a path absolute, the rest as
    JSON.
    """
    if isinstance(value, str):
        return f"{key}={value}"
    # Absolute, because a path of the command line is meant from the working directory.
    return f"{key}={json.dumps(str(value.absolute()) if isinstance(value, Path) else value)}"


def load_with_options(model: type[Model], path: Path | None, options: Mapping[str, Any]) -> Model:
    """Return a configuration: a file's values under those that options give, by key; None: not
    given.

    Raises:
        ConfigError: a key or a value is refused; an option is named as such.
    """
    overrides = [override(key, value) for key, value in options.items() if value is not None]
    try:
        return load(model, path, overrides)
    except ConfigError as problem:
        raise ConfigError(str(problem).replace("--set: ", "--", 1)) from None


def given_policy(options: argparse.Namespace) -> dict[str, Any]:
    """Return the keys of the policy that options name; the digest of a file's own policy does not
    count for another one.
    """
    digest = options.policy_sha256
    if options.policy is not None and digest is None:
        digest = "null"
    return {"policy": options.policy, "policy_sha256": digest and digest.lower()}


def config_file(options: argparse.Namespace) -> Path | None:
    """Return the file with the configuration: the one that is named, or that of the run that is
    gone on with; None: neither.

    Raises:
        ConfigError: there is no run to go on with.
    """
    if not options.resume:
        return options.config
    if options.out is None:
        raise ConfigError("--resume: expected --out with the folder of the run")
    begun = options.out / "config.yaml"
    if not begun.is_file():
        raise ConfigError(
            f"--resume: {options.out} holds no run (no config.yaml), expected one that was begun"
        )
    return options.config or begun


def load_config(
    model: type[Config], options: argparse.Namespace, keys: Mapping[str, str], prefix: str
) -> Config:
    """Return the configuration: a file's or a begun run's values under those of the command line;
    the code of the user's own that it names is loaded.

    Args:
        model: of the configuration.
        options: config, resume, out, policy, policy_sha256, scenario, set, those that ``keys``
            names, and where the command has them aircraft, allow_outside_domain and extension.
        keys: of the configuration, by the names of their options.
        prefix: stands for ``--set: `` in messages about options that have names of their own.
    """
    path, overrides = config_file(options), list[str]()
    if options.policy is not None:
        overrides.append(override("policy", options.policy))
        overrides += [] if options.resume else ["policy_sha256=null"]
    if getattr(options, "aircraft", None) is not None:
        overrides.append(override("aircraft", file_of(options.aircraft, AIRCRAFT)))
    if getattr(options, "allow_outside_domain", False):
        overrides.append("allow_outside_domain=true")
    if getattr(options, "extension", None):
        overrides.append(override("extensions", options.extension))
    if options.policy_sha256 is not None:
        overrides.append(f"policy_sha256={options.policy_sha256.lower()}")
    if options.scenario is not None:
        overrides.append(f"scenario={_absolute(options.scenario)}")
        overrides += [] if options.resume else ["scenario_sha256=null"]
    if getattr(options, "areas", None) is not None and not options.resume:
        overrides.append("areas_sha256=null")
    options_given = {key: getattr(options, name) for name, key in keys.items()}
    overrides += [f"{key}={value}" for key, value in options_given.items() if value is not None]
    check_once(
        [
            override_text
            for override_text in (*overrides, *options.set)
            if not override_text.endswith("_sha256=null")
        ]
    )
    try:
        config = load(model, path, [*overrides, *options.set])
    except ConfigError as problem:
        raise ConfigError(
            str(problem) if options.set else str(problem).replace("--set: ", prefix, 1)
        ) from None
    load_code(config)
    return config


def _absolute(scenario: str) -> str:
    """Return a scenario whose file, if it is one, is named from the root."""
    kind = next(
        (prefix for prefix in PREFIXES if scenario.startswith(prefix) and scenario != prefix), None
    )
    return scenario if kind is None else f"{kind}{Path(scenario.removeprefix(kind)).absolute()}"


def load_code(config: EncountersConfig) -> None:
    """Load the user's own code that a configuration names: extensions and the scenario.

    Raises:
        InputError: there is no such code, or it cannot be used.
    """
    load_extensions(config.extensions)
    if config.file is None:
        try:
            scenarios.resolve(config.scenario)
        except EncounterError as problem:
            raise ConfigError(f"scenario: {problem}") from None


def named_policy(config: PolicyConfig) -> Policy:
    """Load the policy that a configuration names; ``ConfigError``: it is not the expected one."""
    policy = Policy.load(config.policy)
    check_digest(config.policy, policy.sha256, config.policy_sha256, "key policy_sha256")
    return policy


def check_digest(path: Path | None, digest: str, expected: str | None, option: str) -> None:
    """Refuse a policy (None: the one that ships) whose SHA-256 is not the wanted one (None: any),
    as an option says.
    """
    if expected is not None and digest != expected.lower():
        raise ConfigError(
            f"policy {path or 'that ships'} has SHA-256 {digest}, expected {expected} ({option})"
        )


def named_source(
    config: EncountersConfig, aircraft: Aircraft
) -> tuple[Source, tuple[str, ...] | None, dict[str, Any]]:
    """Return scenario or encounters, names of the encounters of a file, and what is resolved
    thereby.

    A file that is not the expected one, or holds fewer than are wanted, raises ``ConfigError``.
    """
    source, names = read_source(config, aircraft)
    count = len(names) if names is not None and config.encounters is None else config.default_count
    if config.file is None:
        return source, names, {"encounters": count}
    digest = hashlib.sha256(config.file.read_bytes()).hexdigest()
    expected = config.scenario_sha256
    if expected not in (None, digest):
        raise ConfigError(
            f"{config.file} has SHA-256 {digest}, expected {expected} (key scenario_sha256)"
        )
    if names is not None and count > len(names):
        raise ConfigError(
            f"encounters is {count}; expected at most {len(names)}, as many as {config.file} holds"
        )
    return source, names, {"scenario_sha256": digest, "encounters": count}


def named_evaluation(config: MonteCarloConfig) -> tuple[Evaluation, Policy, dict[str, Any]]:
    """Return what a configuration names: what is flown, the policy as its file has it, and what is
    resolved thereby.
    """
    policy = named_policy(config)
    aircraft = config.flown_aircraft(policy)
    source, names, resolved = named_source(config, aircraft)
    # A plan is validated against all, however many the policy looks at.
    unproven = config.baseline == "none" and config.mode == "policy"
    if unproven and not config.allow_outside_domain:
        policy.check_intruders(most_intruders(source))
    backend = config.backend_for(policy, resolved["encounters"])
    planner = config.planner.options(aircraft)
    how = (config.mode, planner, config.baseline, backend, config.wind_mps, config.areas)
    areas, digest = named_areas(config)
    evaluation = Evaluation(config.policy, source, names, config.seed, aircraft, *how, areas)
    resolved |= {"policy_sha256": policy.sha256, "backend": backend, "areas_sha256": digest}
    return evaluation, policy, resolved


def named_areas(config: MonteCarloConfig) -> tuple[tuple[Area, ...], str | None]:
    """Return the areas of a configuration's file, and its SHA-256; what is left out or changed of
    it is said on stderr.

    Raises:
        ConfigError: it is not the expected file.
        AreaError: it cannot be used, or holds nothing that lies near.
    """
    if config.areas_file is None or config.latitude is None or config.longitude is None:
        return (), None
    frame = LocalFrame(config.latitude, config.longitude)
    areas, remarks = read_near_areas(config.areas_file, frame)
    for remark in remarks:
        print(visible(remark), file=sys.stderr)
    if not areas:
        raise AreaError(f"{config.areas_file}: holds no area that is an obstacle, expected some")
    digest = hashlib.sha256(config.areas_file.read_bytes()).hexdigest()
    if config.areas_sha256 not in (None, digest):
        raise ConfigError(
            f"{config.areas_file} has SHA-256 {digest}, expected {config.areas_sha256} (key "
            "areas_sha256)"
        )
    return areas, digest
