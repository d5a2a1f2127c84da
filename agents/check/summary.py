"""What an accepted certificate proves, in sentences."""

import math

from .certificate import Certificate, Heights, Limits, Origin, Profile, Wind
from .reading import least_vertical


def summary(certificate: Certificate) -> list[str]:
    """Return what is proven, in sentences."""
    requirement = certificate.requirement
    lines = [
        separation_sentence(certificate),
        excluded_sentence(certificate.excluded),
        f"required: {requirement.separation:g} m and a margin of {requirement.margin:g} m, "
        f"{requirement.sigmas:g} sigmas of uncertainty",
    ]
    own = [
        f"{number}: {report.separation:g} m"
        for number, report in enumerate(certificate.reports)
        if report.separation != requirement.separation
    ]
    if own:
        lines.append(f"separations of their own: intruders {', '.join(own)}")
    lines.append(limits_sentence(certificate.limits))
    if certificate.profile is not None:
        lines.append(climbs_sentence(certificate.profile, least_vertical(certificate)))
    if certificate.areas:
        lines.append(f"areas: {len(certificate.areas)}; their clearances are kept while they count")
    if certificate.wind != Wind(0.0, 0.0, 0.0):
        lines.append(wind_sentence(certificate.wind))
    lines.append(origin_sentence(certificate.request))
    return lines


def separation_sentence(certificate: Certificate) -> str:
    """Say how near the intruders come."""
    if not certificate.reports:
        return (
            f"intruders: none; the flight is proven until {certificate.end:.1f} s after the request"
        )
    # Of an intruder that never counts nothing is claimed.
    least = min((bound for bound in certificate.bounds if bound > 0.0), default=0.0)
    sentence = (
        f"intruders: {len(certificate.reports)}; none comes closer than {least:.3f} m until "
        f"{certificate.end:.1f} s after the request"
    )
    timed = sorted({row.number for row in certificate.apart})
    if timed:
        vertical = min(row.heights.vertical for row in certificate.apart)
        numbers = ", ".join(map(str, timed))
        sentence += f", but while {vertical:g} m or more above or below: {numbers}"
    return sentence


def excluded_sentence(excluded: list[Heights]) -> str:
    """Say how many intruders are left out, and how far they are above or below."""
    sentence = f"left out: {len(excluded)}"
    if excluded:
        least = min(heights.vertical for heights in excluded)
        sentence += f", {least:g} m or more above or below"
    return sentence


def limits_sentence(limits: Limits) -> str:
    """Say which limits the flight keeps."""
    return (
        f"limits: {limits.speed_min:g} to {limits.speed_max:g} m/s, "
        f"{limits.acceleration_min:g} to {limits.acceleration_max:g} m/s^2, "
        f"{math.degrees(limits.yaw_rate_max):g} deg/s"
    )


def climbs_sentence(profile: Profile, vertical: float | None) -> str:
    """Say between which altitudes the plan climbs and descends, how fast, and what vertical
    separation it keeps.
    """
    low, high = min(profile.altitudes), max(profile.altitudes)
    separation = "nobody is passed above or below"
    if vertical is not None:
        separation = f"{vertical:g} m above or below others"
    levels = [
        f"{name} {level:g} m"
        for name, level in (("floor", profile.floor), ("ceiling", profile.ceiling))
        if level is not None
    ]
    return ", ".join(
        [
            f"climbs: waypoints at {low:.1f} to {high:.1f} m within {profile.margin:g} m",
            f"{profile.climb_max:g} m/s up and {profile.descent_max:g} m/s down at most",
            f"{profile.acceleration:g} m/s^2",
            *levels,
            separation,
        ]
    )


def wind_sentence(wind: Wind) -> str:
    """Say in which wind it is flown."""
    return (
        f"wind: {wind.east:g} m/s towards the east, {wind.north:g} m/s towards the north, "
        f"{wind.std:g} m/s one sigma of both"
    )


def origin_sentence(origin: Origin) -> str:
    """Say which flight the certificate belongs to."""
    place = "unknown"
    if origin.latitude is not None and origin.longitude is not None:
        place = f"{origin.latitude:.6f}, {origin.longitude:.6f}"
    time = "unknown" if origin.time_ns is None else f"{origin.time_ns} ns"
    return f"policy: {origin.policy or 'unknown'}; time: {time}; origin: {place}"
