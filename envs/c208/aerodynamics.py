"""Lift, drag and moments of the true aircraft as JSBSim's functions, from the facts.

They act at 30 % of the mean chord; JSBSim carries the moments to the centre of gravity. Positive deflections:
elevator with the trailing edge down, rudder left, aileron to roll right.
"""

import numpy as np

from envs.c208.conditions import Loading
from envs.c208.facts import value

__all__ = ["aerodynamics", "lift_curve", "stall_angle"]


def lift_curve(slope_factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return angles of attack (rad) and lift coefficients, flaps up, elevator at rest: straight, rounded, falling."""
    slope, top, rounding = value("lift_slope") * slope_factor, value("lift_max"), value("lift_rounding")
    knee = (top - rounding - value("lift_zero")) / slope
    # A parabola that continues the line and is level at the top.
    reach = 2.0 * rounding / slope
    share = np.linspace(0.0, 1.0, 7)
    rounded = top - rounding + slope * reach * (share - 0.5 * share**2)
    beyond = np.array([0.05, 0.10, 0.20, 0.35, 0.70, 1.2])
    falling = np.array([-0.06, -0.16, -0.35, -0.50, -0.65, -1.2])
    alpha = np.concatenate([[-0.8, -0.35, -0.25], knee + reach * share, knee + reach + beyond])
    lift = np.concatenate([[-0.6, -1.05, value("lift_zero") - 0.25 * slope], rounded, top + falling])
    return alpha, lift


def stall_angle(slope_factor: float = 1.0) -> float:
    """Return the angle of attack of the greatest lift, rad."""
    alpha, lift = lift_curve(slope_factor)
    return float(alpha[np.argmax(lift)])


def aerodynamics(loading: Loading) -> str:
    """Return the aerodynamic section of the JSBSim aircraft."""
    alpha, lift = lift_curve(loading.lift_slope_factor)
    curve = "\n".join(f"      {a:.6f}  {c:.6f}" for a, c in zip(alpha, lift, strict=True))
    part_10, part_20 = value("lift_flaps_10"), value("lift_flaps_20")
    zero = value("drag_zero") * loading.drag_factor + (value("drag_pod") if loading.pod else 0.0)
    stall = stall_angle(loading.lift_slope_factor)
    area, span, chord = "aero/qbar-area", "aero/bi2vel", "aero/ci2vel"
    wing, mean = "metrics/bw-ft", "metrics/cbarw-ft"
    beta, roll, yaw = "aero/beta-rad", "velocities/p-aero-rad_sec", "velocities/r-aero-rad_sec"
    pitch, climb = "velocities/q-aero-rad_sec", "aero/alphadot-rad_sec"
    elevator, aileron, rudder = (f"fcs/{name}-pos-rad" for name in ("elevator", "aileron", "rudder"))
    total = "aero/c208/lift"
    square = f"<product><value>{value('drag_induced'):g}</value><p>{total}</p><p>{total}</p></product>"
    slip = f"<product><value>{value('drag_sideslip'):g}</value><p>{beta}</p><p>{beta}</p></product>"
    excess = f"<max><value>0</value><difference><p>aero/alpha-rad</p><value>{stall:.6f}</value></difference></max>"
    return f""" <aerodynamics>
  <function name="aero/c208/flaps">
   <table>
    <independentVar>fcs/flap-pos-deg</independentVar>
    <tableData>
      0   0
      10  {part_10:g}
      20  {part_20:g}
      30  1
    </tableData>
   </table>
  </function>
  <function name="aero/c208/basic-lift">
   <table>
    <independentVar>aero/alpha-rad</independentVar>
    <tableData>
{curve}
    </tableData>
   </table>
  </function>
  <function name="aero/c208/lift">
   <sum>
    <p>aero/c208/basic-lift</p>
    {_term("lift_flaps", "aero/c208/flaps")}
    {_term("lift_pitch_rate", pitch, chord)}
    {_term("lift_elevator", elevator)}
   </sum>
  </function>
  <function name="aero/c208/drag">
   <sum>
    <value>{zero:g}</value>
    {square}
    {slip}
    {_term("drag_flaps", "aero/c208/flaps")}
    <product><value>{value("drag_stall"):g}</value>{excess}{excess}</product>
   </sum>
  </function>
  <axis name="LIFT">
   <function name="aero/force/lift"> <product> <p>{area}</p> <p>{total}</p> </product> </function>
  </axis>
  <axis name="DRAG">
   <function name="aero/force/drag"> <product> <p>{area}</p> <p>aero/c208/drag</p> </product> </function>
  </axis>
  <axis name="SIDE">
   <function name="aero/force/side"> <product> <p>{area}</p> <sum>
    {_term("side_beta", beta)}
    {_term("side_rudder", rudder)}
   </sum> </product> </function>
  </axis>
  <axis name="ROLL">
   <function name="aero/moment/roll"> <product> <p>{area}</p> <p>{wing}</p> <sum>
    {_term("roll_beta", beta)}
    {_term("roll_rate", roll, span)}
    {_term("roll_yaw_rate", yaw, span, total)}
    {_term("roll_aileron", aileron)}
    {_term("roll_rudder", rudder)}
   </sum> </product> </function>
  </axis>
  <axis name="PITCH">
   <function name="aero/moment/pitch"> <product> <p>{area}</p> <p>{mean}</p> <sum>
    <value>{value("pitch_zero"):g}</value>
    {_term("pitch_alpha", "aero/alpha-rad")}
    {_term("pitch_rate", pitch, chord)}
    {_term("pitch_alpha_rate", climb, chord)}
    {_term("pitch_elevator", elevator)}
    {_term("pitch_flaps", "aero/c208/flaps")}
   </sum> </product> </function>
  </axis>
  <axis name="YAW">
   <function name="aero/moment/yaw"> <product> <p>{area}</p> <p>{wing}</p> <sum>
    {_term("yaw_beta", beta)}
    {_term("yaw_rate", yaw, span)}
    {_term("yaw_roll_rate", roll, span, total)}
    {_term("yaw_rudder", rudder)}
    {_term("yaw_aileron", aileron, total)}
   </sum> </product> </function>
  </axis>
 </aerodynamics>"""


def _term(fact: str, *factors: str) -> str:
    return f"<product><value>{value(fact):g}</value>" + "".join(f"<p>{name}</p>" for name in factors) + "</product>"
