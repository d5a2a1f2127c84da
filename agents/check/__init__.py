"""Check a plan's certificate: ``python -m agents.check FILE`` (exit 0 accepted, 1 refused, 2
unreadable or bad usage).

It imports nothing else of the project: the folder can be copied out and run alone. What decides is
computed in balls (:mod:`agents.check.balls`) and follows the theorem ``safe`` of proofs/Safe.v:
legs are flown exactly; in each part of an arc the relative motion leaves its chord by at most
a h^2 / 8; an arc is left out where both can fly less than they are too far apart
(``left_out_soundly``). At every real time of an accepted plan every intruder is the required
distance less 1.002 mm away, and the separation itself less 3 micrometres
(docs/explanation/safe-theorem.md).

A plan that climbs and descends keeps a profile of altitude, and is proven by the theorem
``safe_in_space`` of proofs/Space.v.

Read it in this order: :mod:`certificate <agents.check.certificate>` (what is stated),
:mod:`reading <agents.check.reading>`, :mod:`leg <agents.check.leg>`,
:mod:`separation <agents.check.separation>`, :mod:`area <agents.check.area>`,
:mod:`profile <agents.check.profile>`, :mod:`altitude <agents.check.altitude>`, and
:mod:`proof <agents.check.proof>`, which asks them all.
"""

from .certificate import FORMAT
from .command import main
from .proof import accept
from .refusal import RefusedError, Work

__all__ = ["FORMAT", "RefusedError", "Work", "accept", "main"]
