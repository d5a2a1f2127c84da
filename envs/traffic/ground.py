"""Whether an aircraft that is said to be on the ground can be there.

Transponders, receivers and people set that flag wrongly, and an aircraft in flight must not be left
out for it. Transponders themselves put it aside from 100 kt on (ICAO Annex 10, volume IV); light
aircraft and drones fly more slowly. So what is to be kept away from counts from where nothing
taxies any more; a record says what has happened, and has aircraft on runways.
"""

from envs.traffic.track_units import KNOT

TAXI_MAX = 50.0 * KNOT
"""What is faster over the ground flies, or is about to, m/s: nothing taxies so fast."""

ROLL_MAX = 200.0 * KNOT
"""What is faster is on no runway, m/s: what takes off or has landed is slower."""

CLIMB_MAX = 1.5
"""What climbs or descends faster flies, m/s: errors of a standing aircraft's are smaller."""

FIELD_MAX = 5_000.0
"""What is higher flies, m above anything that altitudes are measured from: no airfield is."""


def flies(
    speed: float | None,
    climb: float | None,
    altitude: float | None,
    *,
    fastest: float = TAXI_MAX,
) -> bool:
    """Return whether speed over the ground or climb, m/s, or altitude, m, contradict that an
    aircraft is on the ground; None: unknown, which contradicts nothing. What is no number does.

    Args:
        speed, climb, altitude: of the aircraft.
        fastest: on the ground, m/s.
    """
    # NaN fails every comparison.
    return (
        (speed is not None and not speed <= fastest)
        or (climb is not None and not abs(climb) <= CLIMB_MAX)
        or (altitude is not None and not altitude <= FIELD_MAX)
    )
