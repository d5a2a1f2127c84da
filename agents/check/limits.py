"""The limits of the flight through the air, in every wind within its uncertainty."""

from typing import NamedTuple

from .balls import TWO, Ball, ball, real
from .certificate import Certificate
from .refusal import demand


class AirLimits(NamedTuple):
    """Limits of the flight through the air, m/s, m/s^2, rad/s."""

    speed_min: Ball
    speed_max: Ball
    acceleration_min: Ball
    acceleration_max: Ball
    yaw_rate_max: Ball


def air_limits(certificate: Certificate) -> AirLimits:
    """Return the limits in the air mass of the stated wind that hold the stated ones in every wind
    within its uncertainty.
    """
    stated = AirLimits(*map(ball, certificate.limits))
    sigmas, std = certificate.requirement.sigmas, certificate.wind.std
    if std == 0.0 or sigmas == 0.0:
        return stated
    return narrowed(stated, ball(sigmas) * ball(std))


def narrowed(stated: AirLimits, error: Ball) -> AirLimits:
    """Return limits that hold the stated ones though the wind is off by an error, m/s.

    With an error e the airspeed differs by e at most, the acceleration along the path by e times
    the turn rate, and the turn rate is (v r + a e / v) / (v - e) at most. Turns take half of the
    weaker acceleration at most.
    """
    twice = TWO * error
    weakest, strongest = stated.acceleration_min, stated.acceleration_max
    gain = real(max(strongest.hi, -weakest.lo))
    # What could be slower is kept from that.
    speeds = stated.speed_min, twice, gain / stated.yaw_rate_max
    slow = max(speeds, key=lambda speed: speed.hi)
    least = slow + error
    demand(least.lo > 0, "the lowest airspeed is not positive")
    # r = r_max v / (v + e) - a e / (v + e)^2
    turn = stated.yaw_rate_max * slow / least - gain * error / (least * least)
    half = real(min(strongest.lo, -weakest.hi)) / twice
    turn = half if half.hi < turn.hi else turn
    demand(turn.lo > 0, "the wind is too uncertain for the aircraft to turn")
    lost = turn * error
    return AirLimits(
        speed_min=least,
        speed_max=stated.speed_max - error,
        acceleration_min=weakest + lost,
        acceleration_max=strongest - lost,
        yaw_rate_max=turn,
    )
