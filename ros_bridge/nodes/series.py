"""A series of encounters in the simulator, as the parameters name them; the node that
``ros_bridge.simulator`` runs.
"""

from functools import partial
from typing import Any

from envs.encounters import EncounterError
from envs.scenarios import resolve, scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from ros_bridge.nodes import simulator
from ros_bridge.nodes.simulator import Simulator
from ros_bridge.sim.flight_log import keep_promises, table
from ros_bridge.transport import process


class Series(Simulator):
    """Flies the encounters that its parameters name, and finishes."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**more)
        self.finished, self.code = False, 0
        seed, first, count = (self._value(name) for name in ("seed", "encounter", "encounters"))
        if count < 1:
            raise ValueError(f"encounters is {count}, expected 1 or more")
        self._name, self._first = self._value("scenario"), first
        try:
            resolve(self._name)
            self._encounters = encounters_of_seed(
                scenario(self._name, self.aircraft), seed, first, count
            )
        except EncounterError as error:
            raise ValueError(str(error)) from error
        self._left = list(range(count))
        self._next()

    def _next(self) -> None:
        while self._left and not self.flying:
            number = self._left.pop(0)
            encounter = take(self._encounters, [number])
            self.begin(encounter, f"{self._name} {self._first + number}", self._first + number)
        if not self.flying:
            print(table(self.logs), flush=True)
            self.finished, self.code = True, 0 if keep_promises(self.logs) else 1

    def _end(self, failure: str) -> None:
        super()._end(failure)
        if self.logs[-1].duration == 0.0:
            # Runner or monitor are not there.
            self._left.clear()
        self._next()


main = partial(process.main, Series, "simulator", simulator.__doc__)
