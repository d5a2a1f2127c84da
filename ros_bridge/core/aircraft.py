"""The policy and the aircraft that files name; the shipped policy and its aircraft where they name
none.
"""

from functools import cache
from pathlib import Path

from agents.policy.file import PolicyFileError
from agents.policy.inference import Policy
from agents.policy.inputs import resolve
from commands.command import InputError
from envs.aircraft import Aircraft


def load_extensions(names: str) -> None:
    """Load the inputs of the user's own that the policy needs, ``module:name`` each with commas
    between them, or raise ValueError.
    """
    try:
        resolve(name.strip() for name in names.split(",") if name.strip())
    except InputError as error:
        raise ValueError(f"extensions: {error}") from error


@cache
def load_policy(policy_file: str) -> Policy:
    """Return the policy of a file, for "" the one that ships, or raise ValueError."""
    try:
        return Policy.load(policy_file or None)
    except (PolicyFileError, OSError) as error:
        raise ValueError(f"policy_file: {error}") from error


def aircraft_of(file: str, policy_file: str) -> Aircraft:
    """Return the aircraft of a file or of a name that ships (``uas``), for "" the policy's, or
    raise ValueError.
    """
    if not file:
        return load_policy(policy_file).aircraft
    # Not before it is asked for: these take a third of a node's start.
    from agents.config.load import ConfigError
    from agents.config.world import AircraftConfig

    try:
        return AircraftConfig.of_file(Path(file)).aircraft()
    except ConfigError as error:
        raise ValueError(f"aircraft: {error}") from error
