"""JSBSim behind names that are checked: one aircraft, silent, every property resolved once.

JSBSim answers 0 for a property that does not exist and creates it where one writes to it; here both are errors.
"""

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from envs.c208.conditions import NOMINAL, Loading, checked
from envs.c208.facts import VARIANTS, Variant
from envs.c208.model import DATA, aircraft

if TYPE_CHECKING:
    import jsbsim

__all__ = ["STEP", "Fdm", "FdmError"]

STEP = 1.0 / 60.0
"""Of the physics, s."""


class FdmError(RuntimeError):
    """JSBSim could not be had, or a name that it does not know."""


_silence: list[Any] = []  # JSBSim keeps no reference of its own


def _jsbsim() -> Any:
    """Return the module jsbsim, whose messages are dropped."""
    import jsbsim

    if not _silence:

        class Silence(jsbsim.FGLogger):
            """Takes JSBSim's messages and drops them."""

            def set_level(self, level: Any) -> None:
                pass

            def file_location(self, filename: str, line: int) -> None:
                pass

            def message(self, message: str) -> None:
                pass

            def format(self, format: Any) -> None:  # noqa: A002 - JSBSim's name
                pass

            def flush(self) -> None:
                pass

        _silence.append(Silence())
        jsbsim.set_logger(_silence[0])
    return jsbsim


class Fdm:
    """A JSBSim executive with one aircraft.

    Args:
        variant: name in :data:`envs.c208.facts.VARIANTS`.
        loading: weight and other differences from the files that ship.
        root: of the JSBSim files.

    Raises:
        FdmError: the variant is unknown, a file is missing, or JSBSim does not load the aircraft.
        ValueError: the loading is outside what the model stands for.
    """

    def __init__(self, variant: str = "ex", loading: Loading = NOMINAL, root: Path = DATA) -> None:
        self.variant = self.variant_of(variant)
        checked(loading)
        self.loading = loading
        needed = root / "engine" / f"{self.variant.engine}.xml"
        if not needed.is_file():
            raise FdmError(f"{needed} is missing; python -m envs.c208.model writes it")
        self.exec = _jsbsim().FGFDMExec(str(root))
        self.exec.set_engine_path("engine")
        self.exec.set_systems_path("systems")
        if loading == NOMINAL:
            self._load(root / "aircraft")
        else:
            with tempfile.TemporaryDirectory(prefix="c208-") as folder:
                home = Path(folder) / self.variant.name
                home.mkdir()
                (home / f"{self.variant.name}.xml").write_text(aircraft(self.variant, loading), encoding="utf-8")
                self._load(Path(folder))
        self.exec.set_dt(STEP)
        self._manager = self.exec.get_property_manager()
        self._nodes: dict[str, jsbsim.FGPropertyNode] = {}

    @staticmethod
    def variant_of(name: str) -> Variant:
        """Return the variant of a name.

        Raises:
            FdmError: there is none.
        """
        if name not in VARIANTS:
            raise FdmError(f"variant is {name!r}; expected one of {', '.join(VARIANTS)}")
        return VARIANTS[name]

    def _load(self, folder: Path) -> None:
        self.exec.set_aircraft_path(str(folder))
        if not self.exec.load_model(self.variant.name):
            raise FdmError(f"JSBSim does not load {folder / self.variant.name}; python -m envs.c208.model writes it")

    def node(self, name: str) -> "jsbsim.FGPropertyNode":
        """Return the node of a property.

        Raises:
            FdmError: JSBSim has no property of that name.
        """
        if name not in self._nodes:
            node = self._manager.get_node(name)
            if node is None or not node:
                raise FdmError(f"JSBSim has no property {name!r}")
            self._nodes[name] = node
        return self._nodes[name]

    def get(self, name: str) -> float:
        """Return a property's value."""
        return self.node(name).get_double_value()

    def set(self, name: str, number: float) -> None:
        """Set a property that exists."""
        self.node(name).set_double_value(number)

    def initialise(self, initial: dict[str, float], controls: dict[str, float]) -> None:
        """Begin anew: initial conditions by their ``ic/`` names, controls by their ``fcs/`` names, engine running.

        The surfaces and the spool begin at their commands, without their lag.

        Raises:
            FdmError: a name is unknown, or JSBSim refuses the state.
        """
        # What blew in the last flight must not blow at the initial conditions of this one.
        self.set("atmosphere/turb-type", 0.0)
        self.set("atmosphere/turbulence/milspec/severity", 0.0)
        # 2: the models are reset, initial conditions not run yet. Commands set now reach servos that have no past.
        self.exec.reset_to_initial_conditions(2)
        for name, number in initial.items():
            self.set(f"ic/{name}", number)
        for name, number in controls.items():
            self.set(f"fcs/{name}", number)
        self.set("propulsion/set-running", -1)
        if not self.exec.run_ic():
            raise FdmError(f"JSBSim refuses the initial conditions {initial}")
        for name, number in controls.items():
            self.set(f"fcs/{name}", number)
        self.set("propulsion/set-running", -1)
