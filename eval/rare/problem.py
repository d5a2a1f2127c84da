"""Rare losses of separation as a problem of importance splitting: the smallest separation of the flight decided on."""

from collections.abc import Callable

import numpy as np

from agents.resolvability.classify import Verdict
from envs.encounters import Encounter, Scenario, sample
from envs.trees import take
from eval.flights.chunks import Pilot
from eval.flights.conditions import verdicts
from eval.flights.plan_mode import fly_once, plan_at_start
from eval.flights.simulate import Direct, Flights, fly
from eval.rare.splitting import Draws

__all__ = ["FlightProblem"]

_BLOCK = 1_024  # flights flown together, to bound memory
_LARGEST = np.nextafter(1.0, 0.0)


class FlightProblem:
    """Encounters of a scenario, their draws taken as normal numbers through the normal distribution's function.

    The value of an encounter is the smallest separation of its flight, m; it is infinite where nothing is flown, and,
    if only the resolvable count, where the encounter is proven unresolvable.
    """

    def __init__(
        self, pilot: Pilot, mode: str, *, resolvable_only: bool = False, closer_than: float | None = None
    ) -> None:
        """Take what flies in a mode: policy (once a second), plan (made at the start) or none (straight to the goal).

        With ``resolvable_only`` proven unresolvable encounters do not count. Flights closer than ``closer_than``, m,
        count, and go on after a loss of the required separation; None: those below the required one.
        """
        scenario = pilot.evaluation.source
        if not isinstance(scenario, Scenario):
            raise ValueError("expected a sampled scenario")
        self._pilot, self._scenario, self._mode = pilot, scenario, mode
        self._resolvable_only, self._endless = resolvable_only, closer_than is not None
        self.level = pilot.evaluation.rules.separation if closer_than is None else closer_than
        self._flawed = scenario.position_std > 0.0 or scenario.velocity_std > 0.0 or scenario.latency[1] > 0.0

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Of the draws of the start, and of the sensors' noise step by step where there is any."""
        start = (self._scenario.dimensions,)
        if not self._flawed or self._mode == "none":
            return (start,)
        aircraft = self._pilot.evaluation.aircraft
        seconds = 1 if self._mode == "plan" else round(aircraft.t_max / aircraft.dt)
        return (start, (seconds, 4, self._scenario.intruders[1]))

    def supported(self, draws: Draws) -> np.ndarray:
        """Return which starts meet the scenario's conditions, bool ``[N]``."""
        return self._sampled(draws)[1]

    def value(self, draws: Draws) -> np.ndarray:
        """Return the smallest separations, m, ``[N]``."""
        starts, flights = self.flown(draws)
        # Where no trajectory was proposed, nothing was flown that could lose the separation.
        apart = np.where(np.isnan(flights.min_separation), np.inf, flights.min_separation)
        if self._resolvable_only:
            apart = np.where(self.unresolvable(starts, apart < self.level), np.inf, apart)
        return apart

    def starts(self, draws: Draws) -> Encounter:
        """Return the encounters, ``[N]``."""
        return self._sampled(draws)[0]

    def flown(self, draws: Draws) -> tuple[Encounter, Flights]:
        """Return the encounters and how they were flown, ``[N]``."""
        starts = self.starts(draws)
        count = len(starts.goal_x)
        blocks = [slice(first, first + _BLOCK) for first in range(0, count, _BLOCK)]
        parts = [self._fly(take(starts, block), [one[block] for one in draws[1:]]) for block in blocks]
        return starts, Flights(*(np.concatenate(field) for field in zip(*parts, strict=True)))

    def unresolvable(self, starts: Encounter, lost: np.ndarray) -> np.ndarray:
        """Return which encounters are proven unresolvable, bool ``[N]``; only those that were lost are asked about."""
        found = np.zeros(len(lost), bool)
        rows = np.flatnonzero(lost)
        if rows.size:
            evaluation = self._pilot.evaluation
            unsolved = np.zeros(rows.size, bool)
            judged = verdicts(take(starts, rows), evaluation.aircraft, solved=unsolved)
            found[rows] = judged.verdict == Verdict.UNRESOLVABLE
        return found

    def _sampled(self, draws: Draws) -> tuple[Encounter, np.ndarray]:
        from scipy.special import ndtr

        return sample(self._scenario, np.minimum(ndtr(draws[0]), _LARGEST)[None], np)

    def _fly(self, starts: Encounter, noises: list[np.ndarray]) -> Flights:
        evaluation = self._pilot.evaluation
        noise = None if not noises else _by_step(noises[0])
        aircraft, setting = evaluation.aircraft, evaluation.setting
        if self._mode == "none":
            return fly(starts, Direct(aircraft), aircraft, endless=self._endless)
        if self._mode == "policy":
            return fly(starts, self._pilot.decider, aircraft, noise=noise, endless=self._endless)
        plans = plan_at_start(starts, self._pilot.policy, aircraft, setting, None if noise is None else noise(0))
        return fly_once(starts, plans, aircraft, setting, endless=self._endless).flights


def _by_step(noise: np.ndarray) -> Callable[[int], np.ndarray]:
    """Return noise ``[N, T, 4, K]`` by number of the step, ``[4, N, K]``."""
    steps = np.moveaxis(noise, 0, 2)
    return lambda step: steps[step]
