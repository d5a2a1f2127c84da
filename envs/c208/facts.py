"""What is known of the Cessna 208B, and what had to be estimated: the only numbers that the model is made of.

Every fact names its source. "Estimate" means that no published figure was found and says what stands behind the
number instead; "fit" names the published point that determined it. Published performance is in :data:`POINTS`; each
point says whether the model was fitted to it or is merely checked against it.
"""

from typing import Literal, NamedTuple

__all__ = [
    "FACTS",
    "POINTS",
    "VARIANTS",
    "Fact",
    "Point",
    "Variant",
    "value",
]

_HANDBOOK = "estimate: handbook methods (lifting line, DATCOM) on the three-view's geometry"


class Fact(NamedTuple):
    """One number of the airframe."""

    value: float
    unit: str
    source: str


FACTS: dict[str, Fact] = {
    # Geometry
    "wing_area": Fact(279.4, "ft2", "pilot's operating handbook 208B, section 1, three-view"),
    "wing_span": Fact(52.083, "ft", "pilot's operating handbook 208B, section 1: 52 ft 1 in"),
    "mean_chord": Fact(66.4, "in", "community flight-simulator data; agrees with the handbook's aft limit, section 6"),
    "mean_chord_leading_edge": Fact(177.57, "in aft of datum", "estimate: from the aft limit, 40.33 % of the chord"),
    "tail_area": Fact(70.04, "ft2", "pilot's operating handbook 208B, section 1, three-view"),
    "tail_arm": Fact(19.7, "ft", "estimate: scaled from the three-view, 19.4 to 20 ft"),
    "fin_area": Fact(38.4, "ft2", "Jane's All the World's Aircraft, as quoted in SUAVE"),
    "fin_arm": Fact(19.0, "ft", "estimate: scaled from the three-view"),
    # Control surfaces
    "elevator_up": Fact(25.0, "deg", "pilot's operating handbook 208B, section 7"),
    "elevator_down": Fact(20.0, "deg", "pilot's operating handbook 208B, section 7"),
    "aileron": Fact(20.5, "deg", "mean of 25 up and 16 down, pilot's operating handbook 208B, section 7"),
    "rudder": Fact(25.0, "deg", "pilot's operating handbook 208B, section 7"),
    "flaps": Fact(30.0, "deg", "pilot's operating handbook 208B, section 7: up, 10, 20, 30"),
    "servo_bandwidth": Fact(15.0, "rad/s", "estimate: electric autopilot servos of this class reach 2 to 3 Hz"),
    "servo_rate": Fact(60.0, "deg/s", "estimate: full travel in about a second"),
    # Mass
    "fuel": Fact(1200.0, "lb", "estimate: about half of the usable 2246 lb"),
    "inertia_weight": Fact(8000.0, "lb", "weight at which the moments of inertia hold; they vary in proportion"),
    "inertia_roll": Fact(10_500.0, "slug ft2", "estimate: Roskam's radii of gyration 0.25, 0.38, 0.39; +-40 %"),
    "inertia_pitch": Fact(15_500.0, "slug ft2", "as inertia_roll"),
    "inertia_yaw": Fact(20_700.0, "slug ft2", "as inertia_roll"),
    # Lift
    "lift_zero": Fact(0.25, "", "estimate: wing incidence 2 deg 37 min at the root, -0 deg 36 min at the tip"),
    "lift_slope": Fact(5.75, "1/rad", "estimate: lifting line, aspect ratio 9.7, and the tail's share"),
    "lift_max": Fact(1.575, "", "fit: stall at 78 KCAS, flaps up; the tail's download is in the balance"),
    "lift_rounding": Fact(0.12, "", "estimate: lift below its maximum at which the slope begins to fall"),
    "lift_flaps": Fact(0.965, "", "estimate: 0.9 x 1.3 (Fowler, Raymer) x 1.1 chord x 0.75 of the area flapped"),
    "lift_flaps_10": Fact(0.45, "of 30 deg", "estimate: slotted flaps gain most at small angles"),
    "lift_flaps_20": Fact(0.80, "of 30 deg", "as lift_flaps_10"),
    "lift_pitch_rate": Fact(8.0, "1/rad", _HANDBOOK),
    "lift_elevator": Fact(0.54, "1/rad", _HANDBOOK),
    # Drag
    "drag_zero": Fact(0.0261, "", "fit: 173 KTAS with cargo pod at 609 shp, 10 000 ft, less the pod's share"),
    "drag_pod": Fact(0.0045, "", "estimate: 0.65 m2 of frontal area at a drag coefficient of 0.18"),
    "drag_induced": Fact(0.0415, "", "estimate: Oswald factor 0.79, a strut-braced high wing"),
    "drag_flaps": Fact(0.055, "", "estimate: Roskam, slotted flaps at 30 deg on 70 % of the span"),
    "drag_sideslip": Fact(0.45, "1/rad2", "estimate: slab-sided fuselage, after Hoerner"),
    "drag_stall": Fact(1.6, "1/rad2", "estimate: growth with the square of what the angle exceeds the stall's by"),
    # Pitch, about 30 % of the mean chord
    "moment_reference": Fact(0.30, "of mean chord", "where the moments below hold"),
    "pitch_zero": Fact(0.085, "", _HANDBOOK),
    "pitch_alpha": Fact(-1.30, "1/rad", _HANDBOOK),
    "pitch_rate": Fact(-27.0, "1/rad", _HANDBOOK),
    "pitch_alpha_rate": Fact(-9.5, "1/rad", _HANDBOOK),
    "pitch_elevator": Fact(-1.90, "1/rad", _HANDBOOK),
    "pitch_flaps": Fact(-0.08, "", "estimate: forward shift of downwash offsets most of the flaps' own moment"),
    # Side force, roll and yaw
    "side_beta": Fact(-0.65, "1/rad", _HANDBOOK),
    "side_rudder": Fact(0.19, "1/rad", _HANDBOOK),
    "roll_beta": Fact(-0.085, "1/rad", _HANDBOOK + "; dihedral 3 deg, high wing"),
    "roll_rate": Fact(-0.50, "1/rad", _HANDBOOK),
    "roll_yaw_rate": Fact(0.25, "1/rad, times lift", _HANDBOOK),
    "roll_aileron": Fact(0.11, "1/rad", _HANDBOOK + "; with the spoilers"),
    "roll_rudder": Fact(0.010, "1/rad", _HANDBOOK),
    "yaw_beta": Fact(0.090, "1/rad", _HANDBOOK),
    "yaw_rate": Fact(-0.12, "1/rad", _HANDBOOK),
    "yaw_roll_rate": Fact(-0.08, "1/rad, times lift", _HANDBOOK),
    "yaw_rudder": Fact(-0.078, "1/rad", _HANDBOOK),
    "yaw_aileron": Fact(-0.02, "1/rad, times lift", _HANDBOOK),
    # Propulsion
    "propeller_diameter": Fact(106.0, "in", "type certificate data sheet A37CE: McCauley 3GFR34C703/106GA-0"),
    "propeller_speed": Fact(1900.0, "rpm", "type certificate data sheet A37CE: governed maximum"),
    "propeller_losses": Fact(
        0.80, "", "estimate: share of the power that reaches the disc; rest: blade drag, swirl, hub"
    ),
    "washed_area": Fact(0.481, "m2", "fit: climb of the EX; drag area in the slipstream, 0.7 of the whole"),
    "idle_power": Fact(0.06, "of rated", "estimate: shaft power at flight idle"),
    "profile_power": Fact(0.012, "", "estimate: power coefficient of the blades at zero thrust, governed speed"),
    "spool_time": Fact(1.0, "s", "estimate: idle to 95 % of power in 3.6 s; at most 5 s by 14 CFR 33.73"),
    "specific_consumption": Fact(0.645, "lb/(hp h)", "pilot's operating handbook: 396 lb/h at 614 shp"),
    "cruise_power_share": Fact(0.883, "of thermodynamic", "fit: 185 KTAS with cargo pod at 10 000 ft"),
    # Limits
    "speed_max_operating": Fact(175.0, "KIAS", "pilot's operating handbook 208B, section 2: VMO"),
}
"""The airframe, both variants."""


def value(name: str) -> float:
    """Return a fact's number.

    Raises:
        KeyError: there is no such fact.
    """
    return FACTS[name].value


class Variant(NamedTuple):
    """One of the two airplanes that share the airframe."""

    name: str
    """Of the JSBSim aircraft."""
    engine: str
    """Name of the JSBSim engine."""
    rated_power: float
    """shp, flat-rated."""
    thermodynamic_power: float
    """shp at sea level density if nothing were flat-rated; falls in proportion to the density."""
    takeoff_weight: float
    """lb."""
    source: str


VARIANTS: dict[str, Variant] = {
    "ex": Variant(
        "c208b_ex",
        "pt6a_140",
        867.0,
        1075.0,
        8807.0,
        "rated power and weight: handbook 208B (867 shp); thermodynamic power: estimate, the maker's 1075 shp class",
    ),
    "675": Variant(
        "c208b",
        "pt6a_114a",
        675.0,
        837.0,
        8750.0,
        "rated power and weight: handbook 208B (675 shp); thermodynamic power: estimate, same ratio as the EX",
    ),
}


class Point(NamedTuple):
    """A published point of performance."""

    name: str
    quantity: Literal["cruise", "climb", "stall", "glide"]
    variant: str
    pod: bool
    weight: float
    """lb."""
    altitude: float
    """Pressure altitude, ft."""
    temperature: float
    """Above the standard atmosphere, K."""
    setting: float
    """Cruise: shaft power, shp; climb and glide: calibrated airspeed, kt; stall: flaps, deg, at idle."""
    value: float
    """Cruise: KTAS; climb: ft/min; stall: KCAS; glide: least share of the best lift-to-drag ratio."""
    tolerance: float
    """Cruise and climb: share of the value; stall: kt; glide: nothing below the value."""
    use: Literal["fit", "check"]
    source: str


# Maximum cruise power of the EX if the air had sea level density, shp.
_CRUISE = VARIANTS["ex"].thermodynamic_power * value("cruise_power_share")

POINTS: tuple[Point, ...] = (
    Point(
        *("EX, pod, 609 shp", "cruise", "ex", True, 8807.0, 10_000.0, -5.2, 609.0, 173.0, 0.015, "fit"),
        "pilot's operating handbook 208B (867 shp): -10 C, 1600 rpm, 2000 ft lb",
    ),
    Point(
        *("EX, pod, maximum cruise", "cruise", "ex", True, 8807.0, 10_000.0, 0.0, _CRUISE * 0.7385, 185.0),
        *(0.015, "fit", "information manual 208BIMCUS-00"),
    ),
    Point(
        *("EX, clean, maximum cruise", "cruise", "ex", False, 8807.0, 10_000.0, 0.0, _CRUISE * 0.7385, 195.0),
        *(0.03, "check", "Textron Aviation's published maximum cruise"),
    ),
    Point(
        *("EX, pod, maximum cruise", "cruise", "ex", True, 8807.0, 20_000.0, 0.0, _CRUISE * 0.5328, 175.0),
        *(0.03, "check", "information manual 208BIMCUS-00"),
    ),
    Point(
        *("675, pod, 614 shp", "cruise", "675", True, 8750.0, 8_000.0, 0.0, 614.0, 171.0, 0.03, "check"),
        "pilot's operating handbook 208B (675 shp): 1750 rpm, 1843 ft lb; pod: estimate, agrees with the EX's",
    ),
    Point(
        *("EX, clean, sea level", "climb", "ex", False, 8807.0, 0.0, 0.0, 108.0, 1330.0, 0.03, "fit"),
        "Textron Aviation's published climb; 1275 ft/min is quoted too",
    ),
    Point(
        *("675, clean, sea level", "climb", "675", False, 8750.0, 0.0, 0.0, 104.0, 975.0, 0.08, "check"),
        "Cessna's published climb, from memory",
    ),
    Point(
        *("675, flaps up", "stall", "675", False, 8750.0, 0.0, 0.0, 0.0, 78.0, 1.0, "fit"),
        "Twin and Turbine, December 2011: 63 KIAS, 78 KCAS",
    ),
    Point(
        *("EX, flaps 30", "stall", "ex", False, 8807.0, 0.0, 0.0, 30.0, 61.0, 3.0, "check"),
        "61 KCAS, the limit of part 23 for single engines, at maximum weight",
    ),
    Point(
        *("675, clean, best glide speed", "glide", "675", False, 8750.0, 5_000.0, 0.0, 95.0, 0.95, 0.0, "check"),
        "pilot's operating handbook 208B: best glide 95 KIAS; that speed is near the best of the model",
    ),
)
"""Published performance."""
