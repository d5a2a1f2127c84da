"""The encounter flown by the true aircraft, ``rlcas/C208-v0``; importing this module registers it.

Observation, action, reward and ends are those of :class:`envs.gym.gymnasium_env.DeconflictionEnv`:
what was trained in the surrogate runs here unchanged. Nothing is meant to be trained on it.
"""

from typing import Any

import numpy as np

from envs import world
from envs.backend import EXACT_FLOATS
from envs.c208.conditions import CALM, Conditions
from envs.c208.vehicle import C208Vehicle, FlightError
from envs.encounters import EncounterError, Scenario
from envs.frames import Air
from envs.gym.gymnasium_contract import error
from envs.gym.gymnasium_env import DeconflictionEnv, register, registry
from envs.kinematics import VehicleState, commands
from envs.wind import NO_WIND, over_ground, through_air
from envs.world import State, StepResult

ENV_ID = "rlcas/C208-v0"


class C208Env(DeconflictionEnv):
    """One encounter of the true aircraft, at 2500 m, under its autopilot.

    The action's accelerations and turn rates are those of ``aircraft`` over the ground; the
    aircraft reaches them with its lags, as far as its power and its wing allow. ``info`` also holds
    ``altitude`` and ``airspeed``. A flight that the aircraft does not survive raises
    :class:`envs.c208.vehicle.FlightError`.

    ``variant`` is a name in :data:`envs.c208.facts.VARIANTS`. The conditions hold for every flight,
    but to the seed of the turbulence the encounter's number is added. The other settings are those
    of the surrogate's environment.
    """

    def __init__(
        self,
        scenario: str | Scenario = "circle",
        *,
        variant: str = "ex",
        conditions: Conditions = CALM,
        **settings: Any,
    ) -> None:
        super().__init__(scenario, **settings)
        self._variant, self._conditions = variant, conditions
        self._vehicle: C208Vehicle | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next encounter, or the one that the options ask for; an EncounterError if it
        cannot be flown.
        """
        self._vehicle = None
        observation, info = super().reset(seed=seed, options=options)
        assert self._flight is not None
        conditions = self._conditions._replace(seed=(self._conditions.seed + self._number) % 2**31)
        own = over_ground(self._flight.own, NO_WIND, 0.0)
        try:
            self._vehicle = C208Vehicle(own, self._variant, conditions)
        except FlightError as problem:
            raise EncounterError(
                f"encounter {self._number} cannot be flown by the aircraft: {problem}"
            ) from problem
        return observation, info | self._measure()

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly on for one time step, as the surrogate's environment does, or raise a FlightError."""
        if self._vehicle is None:
            raise error.ResetNeeded(
                "step was called before reset; call reset to begin an encounter"
            )
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, terminated, truncated, info | self._measure()

    def _advance(self, before: State, action: tuple[float, float]) -> tuple[State, StepResult]:
        vehicle = self._vehicle
        assert vehicle is not None  # checked in step
        acceleration, yaw_rate = commands(action, self.world.limits, EXACT_FLOATS)
        vehicle.step(acceleration, yaw_rate, self.world.rules.dt)
        over_air = through_air(vehicle.state, NO_WIND, 0.0)  # encounters know no wind
        own: VehicleState[Air] = VehicleState(*(float(field) for field in over_air))
        traffic = world.move_intruders(before, self.world.rules.dt, EXACT_FLOATS)
        return world.evaluate(before, own, traffic, self.world.rules, EXACT_FLOATS)

    def _measure(self) -> dict[str, float]:
        assert self._vehicle is not None
        return {
            "altitude": self._vehicle.measured.altitude,
            "airspeed": self._vehicle.measured.airspeed,
        }


# Kept if it stands already, as in the surrogate's module.
if ENV_ID not in registry:
    register(ENV_ID, entry_point="envs.c208.gymnasium_env:C208Env")
