"""Which aircraft a policy was trained for, and the refusal of others."""

from agents.policy.file import PolicyFile
from envs.aircraft import Aircraft, Ratios, ratios
from envs.edge.command import InputError

__all__ = ["OutsideDomainError", "check_domain"]

_TOLERANCE = 0.01  # of a ratio; an aircraft is never known better


class OutsideDomainError(InputError):
    """An aircraft that the policy was not trained for; the message names the number and its range."""


def check_domain(content: PolicyFile, aircraft: Aircraft) -> None:
    """Refuse an aircraft outside the family of a policy file.

    A file of schema 1 knows the ratios of its own aircraft alone.

    Raises:
        OutsideDomainError: one of :class:`envs.aircraft.Ratios` is out of the family's range.
    """
    trained = ratios(content.aircraft.limits, content.aircraft.separation)
    for name, value in ratios(aircraft.limits, aircraft.separation)._asdict().items():
        alone = getattr(trained, name)
        low, high = content.metadata["family"][name] if content.of_set else (alone, alone)
        if not low - _TOLERANCE * abs(low) <= value <= high + _TOLERANCE * abs(high):
            units = dict(zip(Ratios._fields, ("V", "V^2/D", "V^2/D", "D"), strict=True))[name]
            raise OutsideDomainError(
                f"outside_domain: {name} is {value:.3g} {units}; expected {low:.3g} to {high:.3g}, what the policy was "
                f"trained for (D: separation {aircraft.separation:g} m; V: {aircraft.limits.speed_max:g} m/s)"
            )
