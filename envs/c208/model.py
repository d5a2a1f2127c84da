"""Writes the JSBSim aircraft and engines from the facts: ``python -m envs.c208.model`` renews the
files that ship.

``data/aircraft.template.xml`` and ``data/engine.template.xml`` name the facts; what follows from
several of them is worked out here. Frames as JSBSim has them: station, butt line and water line in
inches, x aft; body axes x forward, y right, z down. The forces act at 30 % of the mean chord;
JSBSim carries the moments to the centre of gravity. Positive deflections: elevator with the
trailing edge down, rudder left, aileron to roll right.
"""

import math
from pathlib import Path

import numpy as np

from commands.command import Parser, run_cli
from commands.files import write_file
from envs.c208 import propulsion
from envs.c208.conditions import NOMINAL, Loading, check_loading
from envs.c208.facts import DATA, FACTS, FOOT, POUND, SLUG_PER_FT3, VARIANTS, Variant, value

_WRITTEN = "Written by python -m envs.c208.model: change the facts or the template, not this file."


def lift_curve(slope_factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return angles of attack (rad) and lift coefficients, flaps up, elevator at rest: straight,
    rounded, falling.
    """
    slope = value("lift_slope") * slope_factor
    top, rounding = value("lift_max"), value("lift_rounding")
    knee = (top - rounding - value("lift_zero")) / slope
    # A parabola that continues the line and is level at the top.
    reach = 2.0 * rounding / slope
    share = np.linspace(0.0, 1.0, 7)
    rounded = top - rounding + slope * reach * (share - 0.5 * share**2)
    beyond = np.array([0.05, 0.10, 0.20, 0.35, 0.70, 1.2])
    falling = np.array([-0.06, -0.16, -0.35, -0.50, -0.65, -1.2])
    alpha = np.concatenate([[-0.8, -0.35, -0.25], knee + reach * share, knee + reach + beyond])
    lift = np.concatenate(
        [[-0.6, -1.05, value("lift_zero") - 0.25 * slope], rounded, top + falling]
    )
    return alpha, lift


def stall_angle(slope_factor: float = 1.0) -> float:
    """Return the angle of attack of the greatest lift, rad."""
    alpha, lift = lift_curve(slope_factor)
    return float(alpha[np.argmax(lift)])


def aircraft(variant: Variant, loading: Loading = NOMINAL) -> str:
    """Return the text of a JSBSim aircraft; a ValueError for a loading outside what the model
    stands for.
    """
    check_loading(loading)
    weight = loading.weight or variant.takeoff_weight
    chord, leading_edge = value("mean_chord"), value("mean_chord_leading_edge")
    scale = loading.inertia_factor * weight / value("inertia_weight")
    curve = zip(*lift_curve(loading.lift_slope_factor), strict=True)
    travels = {
        "elevator": (value("elevator_up"), value("elevator_down")),
        "aileron": (value("aileron"), value("aileron")),
        "rudder": (value("rudder"), value("rudder")),
    }
    return _fill(
        "aircraft",
        variant,
        chord_ft=chord / 12.0,
        reference=leading_edge + value("moment_reference") * chord,
        # The fuel is at the centre of gravity: burning it changes the weight alone.
        station=leading_edge + loading.centre_of_gravity * chord,
        empty_weight=weight - value("fuel"),
        drag_clean=value("drag_zero") * loading.drag_factor
        + (value("drag_pod") if loading.pod else 0.0),
        stall=stall_angle(loading.lift_slope_factor),
        lift_curve="\n".join(f"      {alpha:.6f}  {lift:.6f}" for alpha, lift in curve),
        **{
            f"{axis}_inertia": value(f"inertia_{axis}") * scale for axis in ("roll", "pitch", "yaw")
        },
        **{f"{name}_low": -math.radians(low) for name, (low, _) in travels.items()},
        **{f"{name}_high": math.radians(high) for name, (_, high) in travels.items()},
    )


def engine(variant: Variant) -> str:
    """Return the text of a JSBSim turbine whose thrust is that of the turboprop.

    JSBSim's thrust is idle + (maximum - idle) n^2 with n the spool's speed between idle and
    maximum, and its table of maximum thrust is a share of what lies between idle and the static
    rating. A spool seeks its target at a rate in proportion to its distance from it.
    """
    idle, top = propulsion.tables(variant)
    rating = float(top[0, -2])
    return _fill(
        "engine",
        variant,
        rating=rating / POUND,
        # Fuel per power as fuel per thrust: P = T V / (550 ft lb/s per hp x efficiency).
        consumption=value("specific_consumption") * (1.0 / (550.0 * 0.75)),
        spool_rate=1.0 / value("spool_time"),
        idle_thrust=_table(idle / rating),
        maximum_thrust=_table((top - idle) / (rating - idle)),
    )


def _fill(template: str, variant: Variant, **numbers: float | str) -> str:
    """Return a template with the facts and numbers in their places."""
    text = (DATA / f"{template}.template.xml").read_text(encoding="utf-8")
    facts = {name: fact.value for name, fact in FACTS.items()}
    return text.format(**facts | numbers, variant=variant, written=_WRITTEN)


def _table(values: np.ndarray) -> str:
    lines = [
        "                "
        + "  ".join(f"{density / SLUG_PER_FT3:.8f}" for density in propulsion.DENSITIES)
    ]
    for speed, row in zip(propulsion.SPEEDS, values, strict=True):
        lines.append(f"    {speed / FOOT:.6f}  " + "  ".join(f"{number:.8f}" for number in row))
    return "\n".join(lines)


def files() -> dict[Path, str]:
    """Return the files that ship and their text."""
    texts = {
        DATA / "engine" / "direct.xml": '<?xml version="1.0"?>\n<direct name="Direct">\n</direct>\n'
    }
    for variant in VARIANTS.values():
        texts[DATA / "aircraft" / variant.name / f"{variant.name}.xml"] = aircraft(variant)
        texts[DATA / "engine" / f"{variant.engine}.xml"] = engine(variant)
    return texts


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
