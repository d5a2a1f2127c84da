"""Write the constants of the proofs from the code: ``python proofs/constants.py >
proofs/Constants.v``.
"""

from fractions import Fraction

from agents.kernel.areas import NEARER
from agents.kernel.clearance import CLOSE, ROUNDING

CONSTANTS = {"CLOSE": CLOSE, "ROUNDING": ROUNDING, "NEARER": NEARER}


def text() -> str:
    """Return the Coq file."""
    lines = [
        "(* Made from the code by proofs/constants.py; tests/agents/test_proofs.py tells when it "
        "is old. *)"
    ]
    lines += ["", "From Coq Require Import Reals.", "Open Scope R_scope.", ""]
    for name, value in CONSTANTS.items():
        exact = Fraction(repr(value))
        lines.append(f"Definition {name} : R := {exact.numerator} / {exact.denominator}.")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(text(), end="")
