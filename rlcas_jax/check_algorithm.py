"""A trial of an algorithm of the user's own, before a training begins."""

from collections.abc import Sequence
from typing import Any

import jax

from agents.config.load import ConfigError
from commands.command import InputError
from commands.extension import failure
from rlcas_jax.algorithm import JAX
from rlcas_jax.config import PPO, TrainConfig
from rlcas_jax.task import CompiledTask


def check_algorithm(config: TrainConfig, tasks: Sequence[CompiledTask]) -> None:
    """Trace an algorithm of the user's own with the shapes of each phase's task, computing nothing.

    Raises:
        ConfigError: it fails, its state holds no actor, or an update or a phase changes the shapes
            of its state.
    """
    if config.algorithm == PPO:
        return
    name, shapes = f"algorithm {config.algorithm}", []
    for task in tasks:
        try:
            before = task.shapes()
            if "actor" not in getattr(before.learner, "_fields", ()):
                raise ConfigError(
                    f"{name}: its state has no actor; expected a named tuple with the field actor, "
                    "the variables of the actor network"
                )
            after, _ = jax.eval_shape(task.update, before)
        except InputError:
            raise
        except Exception as problem:
            raise ConfigError(f"{name}: {failure(problem, JAX)}") from problem
        shapes += [_shapes(before.learner), _shapes(after.learner)]
    for number, shape in enumerate(shapes):
        if shape != shapes[0]:
            where = f"an update of phase {number // 2}" if number % 2 else f"phase {number // 2}"
            raise ConfigError(
                f"{name}: {where} changes its state from {shapes[0]:.200} to {shape:.200}; "
                "expected the same structure, shapes and dtypes"
            )


def _shapes(tree: Any) -> str:
    return str(jax.tree.map(lambda leaf: f"{leaf.dtype}{list(leaf.shape)}", tree))
