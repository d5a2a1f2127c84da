"""Speed beside other simulators: ``python -m benchmarks.simulators [--only NAME,...]``.

Environment steps a second under random actions, with observations, rewards and, but for CAMAR and
VMAS, fresh starts, on all cores: of our surrogate, of a whole training of ours, and of the
simulators of other fields that are installed. Each flies its own task with its own physics: what is
compared is how soon so many steps are had, not what they are worth. A body is what moves in a step,
with or without an action of its own.
"""

from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax
from jaxtyping import PRNGKeyArray

from agents.config.load import load
from benchmarks import surrogate, training
from benchmarks.measure import parse_names, report, seconds
from commands.command import Parser, run_cli, whole
from envs.aircraft import PAPER
from envs.encounters import Scenario
from envs.scenarios import scenario
from rlcas_jax.config import TrainConfig

INSTALL = "pip install -c constraints/peers.txt gymnax six jaxmarl camar vmas"
_ROWS = 16  # of our pool of starts
_LONG = 5.0  # s for a measurement, after which no more environments are tried
_CONFIG = Path("configs/sprint.yaml")  # of the training

Work = Callable[[], Any]


class Simulator(NamedTuple):
    """A simulator that can be measured."""

    package: str | None  # that must be installed; None: ours
    task: str
    prepare: Callable[[int, int], tuple[Work, int]]
    """From a number of environments and of steps to the work of one measurement, which waits for
    its own result, and how many bodies move in each environment.
    """


class Rate(NamedTuple):
    """How fast a simulator is."""

    name: str
    task: str
    environments: int  # in parallel
    bodies: int  # that move in each
    steps_per_s: float  # of all environments


def _ours(source: Scenario, bodies: int, count: int, steps: int) -> tuple[Work, int]:
    advance, state = surrogate.ours(count, steps, _ROWS, source), surrogate.start(count, source)
    return surrogate.work_of(advance, state), bodies


def _by_jax(
    reset: Callable[[PRNGKeyArray], tuple[Any, Any]],
    act: Callable[[PRNGKeyArray], Any],
    step: Callable[[PRNGKeyArray, Any, Any], tuple[Any, ...]],
    bodies: int,
    count: int,
    steps: int,
) -> tuple[Work, int]:
    """Return the work of an environment of functions of one key: observation, state and reward are
    the first that a step returns.
    """

    def advance(key: PRNGKeyArray, state: Any) -> tuple[Any, Any]:
        def one_step(state: Any, key: PRNGKeyArray) -> tuple[Any, Any]:
            action_keys, step_keys = jax.random.split(key, (2, count))
            actions = jax.vmap(act)(action_keys)
            observation, state, reward = jax.vmap(step)(step_keys, state, actions)[:3]
            return state, (observation, reward)

        return jax.lax.scan(one_step, state, jax.random.split(key, steps))

    _, state = jax.jit(jax.vmap(reset))(jax.random.split(jax.random.key(0), count))
    return surrogate.work_of(jax.jit(advance), state), bodies


def _gymnax(count: int, steps: int) -> tuple[Work, int]:
    environment, settings = import_module("gymnax").make("Pendulum-v1")
    space = environment.action_space(settings)
    return _by_jax(
        lambda key: environment.reset(key, settings),
        space.sample,
        lambda key, state, action: environment.step(key, state, action, settings),
        1,
        count,
        steps,
    )


def _jaxmarl(count: int, steps: int) -> tuple[Work, int]:
    environment = import_module("jaxmarl").make("MPE_simple_spread_v3")
    agents = environment.agents

    def act(key: PRNGKeyArray) -> dict[str, Any]:
        keys = zip(agents, jax.random.split(key, len(agents)), strict=True)
        return {agent: environment.action_space(agent).sample(own) for agent, own in keys}

    return _by_jax(environment.reset, act, environment.step, len(agents), count, steps)


def _camar(count: int, steps: int) -> tuple[Work, int]:
    environment = import_module("camar").camar_v0(max_steps=steps)  # none ends meanwhile
    act, agents = environment.action_spaces.sample, environment.num_agents
    return _by_jax(environment.reset, act, environment.step, agents, count, steps)


def _vmas(count: int, steps: int) -> tuple[Work, int]:
    environment = import_module("vmas").make_env("navigation", count, seed=0)  # none ends

    def work() -> None:
        for _ in range(steps):
            actions = [environment.get_random_action(agent) for agent in environment.agents]
            environment.step(actions)

    return work, len(environment.agents)


SIMULATORS = {
    "circle": Simulator(None, "one intruder", partial(_ours, scenario("circle", PAPER), 2)),
    "multi": Simulator(
        None, "four intruders", partial(_ours, scenario("multi", PAPER, intruders=(4, 4)), 5)
    ),
    "gymnax": Simulator("gymnax", "Pendulum-v1", _gymnax),
    "jaxmarl": Simulator("jaxmarl", "MPE_simple_spread_v3", _jaxmarl),
    "camar": Simulator("camar", "random_grid, holonomic", _camar),
    "vmas": Simulator("vmas", "navigation", _vmas),
}
LEARNING = "learning"  # our training, beside the simulators


def measure(names: Sequence[str], counts: Sequence[int], steps: int, repeats: int) -> list[Rate]:
    """Return how fast simulators are, each with the number of environments that suits it best.

    Args:
        names: of :data:`SIMULATORS`, and :data:`LEARNING`.
        counts: numbers of environments, ascending; no more are tried where a measurement takes
            long.
        steps: of each measurement.
        repeats: measurements of each.
    """
    rates = []
    for name in names:
        if name == LEARNING:
            config = load(TrainConfig, _CONFIG)
            time = median(seconds(training.Training(config).update, repeats))
            rates.append(Rate(name, config.name, config.environments, 2, config.samples / time))
            continue
        tried = []
        for count in counts:
            work, bodies = SIMULATORS[name].prepare(count, steps)
            time = median(seconds(work, repeats))
            tried.append(Rate(name, SIMULATORS[name].task, count, bodies, count * steps / time))
            if time > _LONG:
                break
        rates.append(max(tried, key=lambda tried_rate: tried_rate.steps_per_s))
    return rates


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(arguments)
    names = parse_names(options.only, [*SIMULATORS, LEARNING])
    packages = {name: SIMULATORS[name].package for name in names if name != LEARNING}
    missing = [name for name, package in packages.items() if package and not find_spec(package)]
    if missing:
        print(f"not installed and left out: {', '.join(missing)}; to have them: {INSTALL}")
    there = [name for name in names if name not in missing]
    rates = measure(there, sorted(options.environments), options.steps, options.repeats)
    print(f"{'simulator':10} {'task':24} environments   steps/s  bodies moved/s")
    for rate in rates:
        print(
            f"{rate.name:10} {rate.task:24} {rate.environments:12} {rate.steps_per_s:9.3g} "
            f"{rate.bodies * rate.steps_per_s:15.3g}"
        )
    figures = {"benchmark": "simulators", "rates": [rate._asdict() for rate in rates]}
    peers = [package for name, package in packages.items() if package and name in there]
    report(figures, ("jax", "jaxlib", *peers))


def _parser() -> Parser:
    parser = Parser(prog="python -m benchmarks.simulators", description=__doc__)
    add = parser.add_argument
    known = ",".join([*SIMULATORS, LEARNING])
    add("--only", default=known, metavar="NAMES", help=f"with commas (default {known})")
    what = "numbers of environments in parallel; the best of them counts (default 64 512 4096)"
    add("--environments", type=whole(1), nargs="+", default=[64, 512, 4096], help=what)
    add("--steps", type=whole(1), default=32, help="steps of a measurement (default 32)")
    add("--repeats", type=whole(1), default=5, help="measurements of each (default 5)")
    return parser


if __name__ == "__main__":
    run_cli(main)
