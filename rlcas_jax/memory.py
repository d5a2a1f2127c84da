"""The memory that a training needs, estimated before it starts."""

import os

import jax

from agents.config.load import ConfigError
from agents.policy.features import size
from commands.compiled import local_devices
from envs.observation import SIZE
from rlcas_jax.config import PPO, TrainConfig

_FLOAT = 4
# Python, JAX, its compiler and the evaluations: a training with arrays of 15 MiB was measured to
# hold 984 MiB
_PROCESS = 950 * 2**20
# numbers of an encounter's start with one intruder, and of each further one some of them again
_START = 40


def needed_bytes(config: TrainConfig) -> int:
    """Return about how many bytes a training holds at once, its largest phase on all devices
    together and what every process holds beside it.
    """
    arrays = max(_of_phase(phase) for phase in config.phase_configs())
    return arrays + _PROCESS * jax.process_count()


def _of_phase(config: TrainConfig) -> int:
    """Count the pool and the samples twice, as either is sorted; activations; parameters with
    gradients and moments.
    """
    intruders = max(drawn.intruders[1] for drawn in config.training_scenarios())
    network, hidden = config.network, config.network.hidden
    if network.feature_set == "set":
        inputs = network.input_table()
        inputs = inputs.own_size + inputs.intruder_size * intruders
    else:
        inputs = size(network.feature_set)
    pool = 2 * config.environments * config.pool_rows * _START * (1 + intruders) // 2
    samples = 2 * config.samples * (inputs + SIZE)
    # The critic sees the whole rollout at once; so may the gradient of an algorithm of one's own.
    batch = config.ppo.minibatch if config.algorithm == PPO else config.samples
    activations = max(2 * 3 * batch, config.samples) * (inputs + sum(hidden))
    widths = (inputs, *hidden)
    parameters = (
        2 * 4 * sum(before * after for before, after in zip(widths, (*hidden, 2), strict=True))
    )
    return _FLOAT * (pool + samples + activations + parameters)


def check_memory(config: TrainConfig) -> None:
    """Raise a ConfigError where the devices have less memory than :func:`needed_bytes`."""
    needed, available = needed_bytes(config), _available_bytes()
    if needed > available:
        raise ConfigError(
            f"environments {config.environments} with rollout {config.rollout} "
            "and pool_rows "
            f"{config.pool_rows} need about {needed / 2**30:.3g} GiB of memory; expected at most "
            f"{available / 2**30:.3g} GiB"
        )


def _available_bytes() -> int:
    devices = local_devices(jax)
    if devices[0].platform == "cpu":
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * jax.process_count()
    own = sum((device.memory_stats() or {}).get("bytes_limit", 2**63) for device in devices)
    return own * jax.process_count()
