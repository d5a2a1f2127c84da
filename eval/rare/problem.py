"""Rare losses of separation as a problem of importance splitting: the smallest separation of the
flight decided on.
"""

import math

import numpy as np

from agents.resolvability.classify import Verdict
from envs.encounters import Encounter, Scenario
from envs.scenarios import sample
from envs.starts import check_heeded
from envs.trees import take
from eval.flights.chunks import Conditioned, ReadyEvaluation
from eval.flights.conditions import verdict_within
from eval.flights.recorded import fly_in_mode
from eval.flights.simulate import Flights, Unmitigated, fly

_BLOCK = 1_024  # flights flown together, to bound memory
_LARGEST = np.nextafter(1.0, 0.0)


class FlightProblem:
    """Encounters of a scenario, their draws taken as normal numbers through the normal
    distribution's function.

    The value of an encounter is the smallest separation of its flight, m; it is infinite where
    nothing is flown, and, if only the resolvable count, where the encounter is proven unresolvable.
    """

    def __init__(
        self,
        ready: ReadyEvaluation,
        mode: str,
        *,
        resolvable_only: bool = False,
        closer_than: float | None = None,
    ) -> None:
        """Take what flies in a mode: policy (once a second), plan (made at the start) or none
        (straight to the goal).

        Flights closer than ``closer_than``, m, count, and go on after a loss; None: below the
        required separation.

        Raises:
            EncounterError: the scenario's intruders have separations of their own, are reported in
                part, or answer the ownship.
        """
        scenario = ready.evaluation.source
        if not isinstance(scenario, Scenario):
            raise ValueError("expected a sampled scenario")
        self._ready = ReadyEvaluation(ready.evaluation._replace(mode=mode), ready.policy)
        self._scenario, self._aircraft = scenario, ready.evaluation.aircraft
        self._resolvable_only, self._endless = resolvable_only, closer_than is not None
        self.level = self._aircraft.separation if closer_than is None else closer_than
        flawed = mode != "none" and (
            scenario.position_std or scenario.velocity_std or scenario.latency[1]
        )
        steps = (
            0
            if not flawed
            else 1
            if mode == "plan"
            else round(self._aircraft.t_max / self._aircraft.dt)
        )
        self._noise = (steps, 4, scenario.intruders[1])
        # Draws of the start, then of the sensors' noise step by step where there is any.
        self.dimensions = scenario.dimensions + math.prod(self._noise)
        # Neither plans nor the file of lost encounters know of optional fields.
        encounters, _ = self.sample_encounters(np.zeros((1, self.dimensions)))
        check_heeded(encounters, f"scenario {scenario.name!r}")

    def sample_encounters(self, draws: np.ndarray) -> tuple[Encounter, np.ndarray]:
        """Return the encounters, ``[N]``, and which meet the scenario's conditions, bool
        ``[N]``.
        """
        from scipy.special import ndtr

        uniform = np.minimum(ndtr(draws[:, : self._scenario.dimensions]), _LARGEST)
        return sample(self._scenario, uniform[None], np)

    def value(self, draws: np.ndarray) -> np.ndarray:
        """Return the smallest separations, m, ``[N]``, not a number where a start fails the
        scenario's conditions.
        """
        starts, inside = self.sample_encounters(draws)
        apart, rows = np.full(len(inside), np.nan), np.flatnonzero(inside)
        for first in range(0, rows.size, _BLOCK):
            block = rows[first : first + _BLOCK]
            noise = draws[block, self._scenario.dimensions :].reshape(block.size, *self._noise)
            apart[block] = self._fly(take(starts, block), noise).min_separation
        # Where no trajectory was proposed, nothing was flown that could lose the separation.
        apart[inside & np.isnan(apart)] = np.inf
        if self._resolvable_only:
            lost = np.flatnonzero(apart < self.level)
            apart[lost[self.unresolvable(take(starts, lost))]] = np.inf
        return apart

    def unresolvable(self, starts: Encounter) -> np.ndarray:
        """Return which encounters are proven unresolvable, bool ``[N]``."""
        mode = self._ready.evaluation.mode
        limits = self._aircraft.limits if mode == "none" else self._ready.evaluation.limits
        judged = verdict_within(starts, self._aircraft, limits, ())
        return judged.verdict == Verdict.UNRESOLVABLE

    def _fly(self, starts: Encounter, noise: np.ndarray) -> Flights:
        if self._ready.evaluation.mode == "none":
            return fly(starts, Unmitigated(self._aircraft), self._aircraft, endless=self._endless)
        by_step = (lambda step: np.moveaxis(noise[:, step], 0, 1)) if noise.size else None
        conditioned = Conditioned(starts, by_step)
        _, flights = fly_in_mode(self._ready, conditioned, None, endless=self._endless)
        return flights
