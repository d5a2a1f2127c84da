"""The algorithm of a training: PPO, or one of the user's own, by the name in its configuration."""

from collections.abc import Callable

from agents.config.load import ConfigError
from agents.learning.algorithm import Algorithm, Setup
from agents.learning.networks import Actor, Critic
from agents.learning.ppo import PpoSettings, ppo
from commands.command import InputError
from commands.extension import failure, is_extension
from commands.registry import Registry
from rlcas_jax.config import PPO, NetworkConfig, TrainConfig

JAX = "jax.numpy"
"""What an algorithm is to use for arrays."""

ALGORITHMS: Registry[Callable[..., Algorithm]] = Registry(
    "algorithm", "an algorithm", object, InputError
)
"""The algorithms of the user's own that were registered in this process, by ``module:name``."""


def register(make: Callable[..., Algorithm]) -> str:
    """Make an algorithm of the user's own known in this process; return the name by which a
    configuration, and the policy file, call it.

    Args:
        make: a class or function with a name, such as ``my_algorithm.ActorCritic``; it is called
            with a :class:`~agents.learning.algorithm.Setup` and the keys of
            ``algorithm_settings``.

    Raises:
        InputError: it cannot be called, or has no name.
    """
    full_name = f"{getattr(make, '__module__', '')}:{getattr(make, '__name__', '')}"
    if not callable(make) or not is_extension(full_name):
        raise InputError(f"algorithm is {make!r}; expected a class or a function with a name")
    ALGORITHMS.register(full_name, make)
    return full_name


def algorithm_of(config: TrainConfig, axis: str | None = None) -> Algorithm:
    """Return the algorithm of a configuration, whose code is loaded where it is the user's own.

    Args:
        axis: name of the devices' axis; None on one device.

    Raises:
        ConfigError: there is no such algorithm, it cannot be made, or it does not know of the other
            devices.
    """
    network = config.network
    critic = Critic(network.hidden, network.feature_set, network.encoder)
    setup = Setup(actor_of(network), critic, config.discount, axis)
    if config.algorithm == PPO:
        return ppo(setup, ppo_settings(config))
    return _own(config, setup)


def actor_of(network: NetworkConfig) -> Actor:
    """Return the network that decides."""
    return Actor(network.hidden, network.feature_set, encoder=network.encoder)


def ppo_settings(config: TrainConfig) -> PpoSettings:
    """Return PPO's settings under a configuration."""
    chosen = config.ppo
    return PpoSettings(
        epochs=chosen.epochs,
        minibatches=config.samples // chosen.minibatch,
        segment=chosen.segment,
        discount=config.discount,
        gae_lambda=chosen.gae_lambda,
        clip=chosen.clip,
        value=chosen.value,
        entropy=chosen.entropy,
        action_bound_coef=chosen.action_bound_coef,
        max_grad_norm=chosen.max_grad_norm,
        adam_epsilon=chosen.adam_epsilon,
        normalize_advantage=chosen.normalize_advantage,
    )


def _own(config: TrainConfig, setup: Setup) -> Algorithm:
    """Return an algorithm of the user's own."""
    name = config.algorithm
    try:
        make = ALGORITHMS.load(name)
    except InputError as problem:
        raise ConfigError(f"algorithm: {problem}; ppo ships") from None
    try:
        algorithm = make(setup, **config.algorithm_settings)
    except Exception as problem:
        raise ConfigError(f"algorithm {name}: {failure(problem, JAX)}") from problem
    missing = [part for part in ("init", "act", "update") if not hasattr(algorithm, part)]
    if missing:
        raise ConfigError(
            f"algorithm {name}: has no {', '.join(missing)}; expected init, act and update "
            "(agents.learning.algorithm.Algorithm)"
        )
    if setup.axis is not None and not getattr(algorithm, "several_devices", False):
        raise ConfigError(
            f"algorithm {name}: does not say several_devices; expected one device, or an algorithm "
            "that averages its gradients over setup.axis"
        )
    return algorithm
