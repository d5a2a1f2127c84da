"""JSBSim behind names that are checked: one aircraft, silent, every property resolved once.

JSBSim answers 0 for a property that does not exist and creates it where one writes to it; here both
are errors.
"""

import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from envs.c208.conditions import NOMINAL, Loading, check_loading
from envs.c208.facts import DATA, VARIANTS
from envs.c208.model import aircraft

if TYPE_CHECKING:
    import jsbsim

STEP = 1.0 / 60.0  # of the physics, s


class FdmError(RuntimeError):
    """JSBSim cannot be loaded, or does not know a name."""


_silence: list["jsbsim.FGLogger"] = []  # JSBSim keeps no reference of its own


def _jsbsim() -> ModuleType:
    """Return JSBSim, silent."""
    import jsbsim

    if not _silence:
        silent_methods = {
            name: lambda *_: None
            for name in ("set_level", "file_location", "message", "format", "flush")
        }
        _silence.append(type("Silence", (jsbsim.FGLogger,), silent_methods)())
        jsbsim.set_logger(_silence[0])
    return jsbsim


class Fdm:
    """A JSBSim executive with one aircraft, a variant of :data:`envs.c208.facts.VARIANTS` under a
    loading.

    Raises:
        FdmError: the variant is unknown, a file is missing, or JSBSim does not load the aircraft.
        ValueError: the loading is outside what the model stands for.
    """

    def __init__(self, variant: str = "ex", loading: Loading = NOMINAL) -> None:
        if variant not in VARIANTS:
            raise FdmError(f"variant is {variant!r}; expected one of {', '.join(VARIANTS)}")
        self.variant, self.loading = VARIANTS[variant], check_loading(loading)
        needed = DATA / "engine" / f"{self.variant.engine}.xml"
        if not needed.is_file():
            raise FdmError(f"{needed} is missing; python -m envs.c208.model writes it")
        self.exec = _jsbsim().FGFDMExec(str(DATA))
        self.exec.set_engine_path("engine")
        self.exec.set_systems_path("systems")
        if loading == NOMINAL:
            self._load(DATA / "aircraft")
        else:
            with tempfile.TemporaryDirectory(prefix="c208-") as folder:
                home = Path(folder) / self.variant.name
                home.mkdir()
                (home / f"{self.variant.name}.xml").write_text(
                    aircraft(self.variant, loading), encoding="utf-8"
                )
                self._load(Path(folder))
        self.exec.set_dt(STEP)
        self._manager = self.exec.get_property_manager()
        self._nodes: dict[str, jsbsim.FGPropertyNode] = {}

    def _load(self, folder: Path) -> None:
        self.exec.set_aircraft_path(str(folder))
        if not self.exec.load_model(self.variant.name):
            raise FdmError(
                f"JSBSim does not load {folder / self.variant.name}; python -m envs.c208.model "
                "writes it"
            )

    def node(self, name: str) -> "jsbsim.FGPropertyNode":
        """Return the node of a property; raises a FdmError where JSBSim has none of that name."""
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
        """Begin anew: initial conditions by their ``ic/`` names, controls by their ``fcs/`` names,
        engine running.

        The surfaces and the spool begin at their commands, without their lag.

        Raises:
            FdmError: a name is unknown, or JSBSim refuses the state.
        """
        # What blew in the last flight must not blow at the initial conditions of this one.
        self.set("atmosphere/turb-type", 0.0)
        self.set("atmosphere/turbulence/milspec/severity", 0.0)
        # 2: the models are reset, initial conditions not run yet. Commands set now reach servos
        # that have no past.
        self.exec.reset_to_initial_conditions(2)
        for name, number in initial.items():
            self.set(f"ic/{name}", number)
        self._control(controls)
        if not self.exec.run_ic():
            raise FdmError(f"JSBSim refuses the initial conditions {initial}")
        self._control(controls)

    def _control(self, controls: dict[str, float]) -> None:
        for name, number in controls.items():
            self.set(f"fcs/{name}", number)
        self.set("propulsion/set-running", -1)
