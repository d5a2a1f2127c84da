"""Writes the JSBSim aircraft and engines from the facts: ``python -m envs.c208.model`` renews the files that ship.

Frames as JSBSim has them: station, butt line and water line in inches, x aft; body axes x forward, y right, z down.
"""

import math
from pathlib import Path

import numpy as np

from envs.c208 import propulsion
from envs.c208.aerodynamics import aerodynamics
from envs.c208.conditions import NOMINAL, Loading, checked
from envs.c208.facts import VARIANTS, Variant, value
from envs.edge.command import Parser, run_cli
from envs.edge.files import write_file

__all__ = ["DATA", "aircraft", "current", "engine", "files", "main"]

DATA = Path(__file__).parent / "data"
"""Root of the JSBSim files that ship."""

_NEWTONS_PER_POUND = 4.4482216
_FOOT = 0.3048
_SLUG_PER_FT3 = 515.378819  # kg/m^3


def aircraft(variant: Variant, loading: Loading = NOMINAL) -> str:
    """Return the text of a JSBSim aircraft.

    Raises:
        ValueError: the loading is outside what the model stands for.
    """
    checked(loading)
    weight = loading.weight or variant.takeoff_weight
    station = value("mean_chord_leading_edge") + loading.centre_of_gravity * value("mean_chord")
    reference = value("mean_chord_leading_edge") + value("moment_reference") * value("mean_chord")
    scale = loading.inertia_factor * weight / value("inertia_weight")
    inertia = {
        axis: value(f"inertia_{name}") * scale for axis, name in zip("xyz", ("roll", "pitch", "yaw"), strict=True)
    }
    # The fuel is at the centre of gravity: burning it changes the weight alone.
    return f"""<?xml version="1.0"?>
<!-- Written by python -m envs.c208.model from envs/c208/facts.py: change the facts, not this file. -->
<fdm_config name="{variant.name}" version="2.0" release="BETA">
 <fileheader>
  <author>RLCAS toolkit</author>
  <description>Cessna 208B, {variant.rated_power:g} shp</description>
 </fileheader>
 <metrics>
  <wingarea unit="FT2"> {value("wing_area"):g} </wingarea>
  <wingspan unit="FT"> {value("wing_span"):g} </wingspan>
  <chord unit="FT"> {value("mean_chord") / 12.0:.5f} </chord>
  <htailarea unit="FT2"> {value("tail_area"):g} </htailarea>
  <htailarm unit="FT"> {value("tail_arm"):g} </htailarm>
  <vtailarea unit="FT2"> {value("fin_area"):g} </vtailarea>
  <vtailarm unit="FT"> {value("fin_arm"):g} </vtailarm>
  {_location("AERORP", reference)}
  {_location("EYEPOINT", station)}
  {_location("VRP", station)}
 </metrics>
 <mass_balance>
  <ixx unit="SLUG*FT2"> {inertia["x"]:.1f} </ixx>
  <iyy unit="SLUG*FT2"> {inertia["y"]:.1f} </iyy>
  <izz unit="SLUG*FT2"> {inertia["z"]:.1f} </izz>
  <emptywt unit="LBS"> {weight - value("fuel"):.2f} </emptywt>
  {_location("CG", station)}
 </mass_balance>
 <ground_reactions>
  <contact type="STRUCTURE" name="wheels">
   {_location("wheels", station)}
   <static_friction> 0.8 </static_friction>
   <dynamic_friction> 0.5 </dynamic_friction>
   <spring_coeff unit="LBS/FT"> 10000 </spring_coeff>
   <damping_coeff unit="LBS/FT/SEC"> 2000 </damping_coeff>
  </contact>
 </ground_reactions>
 <propulsion>
  <property value="0">c208/throttle</property>
  <engine file="{variant.engine}">
   <feed>0</feed>
   <thruster file="direct">
    {_location("thrust", station)}
    <orient unit="DEG"> <roll> 0 </roll> <pitch> 0 </pitch> <yaw> 0 </yaw> </orient>
   </thruster>
  </engine>
  <tank type="FUEL">
   {_location("tank", station)}
   <capacity unit="LBS"> 2246 </capacity>
   <contents unit="LBS"> {value("fuel"):g} </contents>
  </tank>
 </propulsion>
{_controls()}
{aerodynamics(loading)}
</fdm_config>
"""


def engine(variant: Variant) -> str:
    """Return the text of a JSBSim turbine whose thrust is that of the turboprop.

    JSBSim's thrust is idle + (maximum - idle) n^2 with n the spool's speed between idle and maximum, and its table
    of maximum thrust is a share of what lies between idle and the static rating.
    """
    idle, top = propulsion.tables(variant)
    rating = float(top[0, -2])
    first, second = idle / rating, (top - idle) / (rating - idle)
    lag = value("spool_time")
    target = "<sum><value>60</value><product><value>40</value><p>c208/throttle</p></product></sum>"
    consumption = value("specific_consumption") * _FOOT_POUNDS
    return f"""<?xml version="1.0"?>
<!-- Written by python -m envs.c208.model from envs/c208/facts.py: change the facts, not this file. -->
<turbine_engine name="{variant.engine}">
 <milthrust unit="LBS"> {rating / _NEWTONS_PER_POUND:.6f} </milthrust>
 <bypassratio> 0 </bypassratio>
 <tsfc>
  <product><value>{consumption:.8f}</value><max><p>velocities/vt-fps</p><value>100</value></max></product>
 </tsfc>
 <bleed> 0 </bleed>
 <idlen1> 60 </idlen1>
 <idlen2> 60 </idlen2>
 <maxn1> 100 </maxn1>
 <maxn2> 100 </maxn2>
 <augmented> 0 </augmented>
 <injected> 0 </injected>
{_table("IdleThrust", first)}
{_table("MilThrust", second)}
{_spool("N1", "Up", target, lag)}
{_spool("N1", "Down", target, lag)}
{_spool("N2", "Up", target, lag)}
{_spool("N2", "Down", target, lag)}
</turbine_engine>
"""


# Fuel per power as fuel per thrust: P = T V / (550 ft lb/s per hp x efficiency).
_FOOT_POUNDS = 1.0 / (550.0 * 0.75)


def _location(name: str, station: float) -> str:
    return f'<location name="{name}" unit="IN"> <x> {station:.4f} </x> <y> 0 </y> <z> 0 </z> </location>'


def _table(name: str, values: np.ndarray) -> str:
    columns = "  ".join(f"{density / _SLUG_PER_FT3:.8f}" for density in propulsion.DENSITIES)
    rows = "\n".join(
        f"    {speed / _FOOT:.6f}  " + "  ".join(f"{number:.8f}" for number in row)
        for speed, row in zip(propulsion.SPEEDS, values, strict=True)
    )
    return f""" <function name="{name}">
  <table>
   <independentVar lookup="row">velocities/vt-fps</independentVar>
   <independentVar lookup="column">atmosphere/rho-slugs_ft3</independentVar>
   <tableData>
                {columns}
{rows}
   </tableData>
  </table>
 </function>"""


def _spool(shaft: str, direction: str, target: str, lag: float) -> str:
    """Return the rate at which a shaft seeks its target, percent a second: proportional to the distance from it."""
    here = f"<p>propulsion/engine/{shaft.lower()}</p>"
    return f""" <function name="{shaft}Spool{direction}">
  <sum>
   <value>0.02</value>
   <product><value>{1.0 / lag:g}</value><abs><difference>{target}{here}</difference></abs></product>
  </sum>
 </function>"""


def _controls() -> str:
    def surface(name: str, low: float, high: float) -> str:
        return f"""  <channel name="{name}">
   <aerosurface_scale name="fcs/{name}-surface">
    <input>fcs/{name}-cmd-norm</input>
    <range> <min> {math.radians(low):.8f} </min> <max> {math.radians(high):.8f} </max> </range>
    <output>fcs/{name}-pos-rad</output>
   </aerosurface_scale>
  </channel>"""

    surfaces = (
        surface("elevator", -value("elevator_up"), value("elevator_down")),
        surface("aileron", -value("aileron"), value("aileron")),
        surface("rudder", -value("rudder"), value("rudder")),
    )
    middle = "\n".join(surfaces)
    return f""" <flight_control name="surfaces">
{middle}
  <channel name="spool">
   <pure_gain name="fcs/spool-demand">
    <input>fcs/throttle-pos-norm</input>
    <gain> 1 </gain>
    <output>c208/throttle</output>
   </pure_gain>
  </channel>
  <channel name="flaps">
   <pure_gain name="fcs/flaps-demand-deg">
    <input>fcs/flap-cmd-norm</input>
    <gain> {value("flaps"):g} </gain>
    <output>fcs/flap-pos-deg</output>
   </pure_gain>
  </channel>
 </flight_control>"""


def files() -> dict[Path, str]:
    """Return the files that ship and their text."""
    found = {DATA / "engine" / "direct.xml": '<?xml version="1.0"?>\n<direct name="Direct">\n</direct>\n'}
    for variant in VARIANTS.values():
        found[DATA / "aircraft" / variant.name / f"{variant.name}.xml"] = aircraft(variant)
        found[DATA / "engine" / f"{variant.engine}.xml"] = engine(variant)
    return found


def current() -> bool:
    """Return whether the files that ship are what the facts give."""
    return all(path.is_file() and path.read_text(encoding="utf-8") == text for path, text in files().items())


def main() -> int:
    """Write the files that ship; return the exit code."""
    Parser(prog="python -m envs.c208.model", description=__doc__).parse_args()
    for path, text in files().items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, text)
        print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    run_cli(main)
