"""A decision of the policy in the planner's flight ahead: ``python -m benchmarks.decision``.

The policy is rolled ahead through random traffic to a goal that it does not reach, so that every
flight takes as many decisions as there is time for; interpreted and compiled in turns, in one
process. Times are the processor's for the thread.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Options, Request, prepare
from agents.planner.request.options import task_of
from agents.planner.request.request import check_request, in_wind
from agents.planner.search.rollout import roll
from agents.policy.inference import Policy
from benchmarks.measure import report, request_options, show
from benchmarks.traffic import question
from commands.command import ConfigError, Parser, run_cli
from envs import compiled

_INTRUDERS = 1, 10
_RADIUS = 30_000.0  # m about the ownship in which intruders are
_FAR = 100.0  # separations to the goal


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 50)
    options = parser.parse_args(arguments)
    policy = Policy.load(options.policy)
    if policy.decider is None or not compiled.may_compile():
        raise ConfigError(
            "there is no compiled code for this policy, or numba is missing; expected both"
        )
    prepare()
    summary: dict[str, Any] = {"benchmark": "decision", "flights": options.requests}
    with threadpool_limits(1):
        for count in _INTRUDERS:
            spent = np.zeros(2)  # interpreted, compiled
            for number in range(options.requests):
                for way in (0, 1):
                    spent[way] += _flight(options.seed + number, count, policy, compile_it=way == 1)
            for way, name in enumerate(("interpreted", "compiled")):
                summary[f"{name}_{count}_us"] = 1e6 * spent[way] / options.requests
    show(summary)
    report(summary, ("numpy", "numba"))


def _flight(number: int, count: int, policy: Policy, *, compile_it: bool) -> float:
    """Return the time of one decision on average in a flight among so many intruders, s."""
    options = in_wind(replace(Options.for_aircraft(policy.aircraft), direct=False), None)
    drawn = question(number, count, _RADIUS, policy.aircraft)
    far = [replace(at, x=at.x + _FAR * policy.aircraft.separation) for at in drawn.route]
    request: Request = check_request(drawn.own, drawn.intruders, far, options)[0]
    compiled.use(compile_it)
    began = time.thread_time()
    roll(request, np.zeros(1, dtype=int), policy, options, floats=True)
    return (time.thread_time() - began) / (task_of(options).until / options.aircraft.dt)


if __name__ == "__main__":
    run_cli(main)
