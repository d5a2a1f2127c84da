"""What is known of the Cessna 208B, and what had to be estimated: the only numbers that the model
is made of.

They stand with their sources in ``data/facts.csv``. An "estimate" has no published figure, and the
source says what it rests on instead; a "fit" names the published point that determined it.
Published performance is in ``data/points.csv``; each point says whether the model
was fitted to it or is merely checked against it.
"""

import csv
from pathlib import Path
from typing import Any, Literal, NamedTuple

DATA = Path(__file__).parent / "data"  # root of the files that ship
FOOT, POUND, SLUG_PER_FT3 = 0.3048, 4.4482216, 515.378819  # m, N and kg/m^3
GRAVITY = 9.80665  # m/s^2


class Fact(NamedTuple):
    """One number of the airframe."""

    value: float
    unit: str
    source: str


def _rows(name: str) -> list[dict[str, str]]:
    with (DATA / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


FACTS = {
    row["name"]: Fact(float(row["value"]), row["unit"], row["source"]) for row in _rows("facts.csv")
}
"""The airframe, both variants."""


def value(name: str) -> float:
    """Return a fact's number; raises a KeyError where there is no such fact."""
    return FACTS[name].value


class Variant(NamedTuple):
    """One of the two airplanes that share the airframe."""

    name: str  # of the JSBSim aircraft
    engine: str  # name of the JSBSim engine
    rated_power: float  # shp, flat-rated: pilot's operating handbook 208B
    thermodynamic_power: float
    """shp if nothing were flat-rated, in proportion to the density; at sea level an estimate after
    the maker's class, 1075 shp, for the EX, and in the same ratio for the other."""
    takeoff_weight: float  # lb: pilot's operating handbook 208B


VARIANTS = {
    "ex": Variant("c208b_ex", "pt6a_140", 867.0, 1075.0, 8807.0),
    "675": Variant("c208b", "pt6a_114a", 675.0, 837.0, 8750.0),
}


class Point(NamedTuple):
    """A published point of performance."""

    name: str
    quantity: Literal["cruise", "climb", "stall", "glide"]
    variant: str
    pod: bool
    weight: float  # lb
    altitude: float  # pressure altitude, ft
    temperature: float  # above the standard atmosphere, K
    setting: float
    """Cruise: shaft power, shp; climb and glide: calibrated airspeed, kt; stall: flaps, deg, at
    idle."""
    value: float
    """Cruise: KTAS; climb: ft/min; stall: KCAS; glide: least share of the best lift-to-drag
    ratio."""
    tolerance: float
    """Cruise and climb: share of the value; stall: kt; glide: nothing below the value."""
    use: Literal["fit", "check"]
    source: str


# Maximum cruise power of the EX if the air had sea level density, shp.
_SETTING_UNITS = {
    "of cruise power": VARIANTS["ex"].thermodynamic_power * value("cruise_power_share")
}


def _point(row: dict[str, str]) -> Point:
    fields: dict[str, Any] = {name: row[name] for name in Point._fields}
    for name in ("weight", "altitude", "temperature", "setting", "value", "tolerance"):
        fields[name] = float(row[name])
    fields["setting"] *= _SETTING_UNITS.get(row["setting_unit"], 1.0)
    fields["pod"] = row["pod"] == "yes"
    return Point(**fields)


POINTS = tuple(map(_point, _rows("points.csv")))  # published performance
