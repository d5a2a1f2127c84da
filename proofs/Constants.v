(* Made from the code by proofs/constants.py; tests/agents/test_proofs.py tells when it is old. *)

From Coq Require Import Reals.
Open Scope R_scope.

Definition CLOSE : R := 1 / 1000.
Definition ROUNDING : R := 1 / 1000000.
Definition NEARER : R := 1 / 100.
