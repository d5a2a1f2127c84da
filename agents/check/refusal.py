"""Refusing a certificate: for what it states, or for the work that its proof takes."""

_MOST_WORK = 300_000  # parts of arcs that are looked at, or what takes as long: some 20 s


class RefusedError(ValueError):
    """The certificate does not prove its plan; the message says why."""


def demand(holds: bool, sentence: str) -> None:
    """Refuse the certificate unless something holds."""
    if not holds:
        raise RefusedError(sentence)


class Work:
    """What is left of the work that a certificate may ask for, in parts of arcs."""

    def __init__(self, most: int = _MOST_WORK) -> None:
        self.most = most
        self.remaining = most

    def spend(self, parts: int) -> None:
        """Take off some work; refuse the certificate where nothing is left."""
        self.remaining -= parts
        demand(self.remaining >= 0, f"its proof takes more than {self.most} parts of arcs")
