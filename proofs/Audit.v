(* What the theorem rests on: nothing but the axioms of Coq's real numbers. *)

Require Import Safe.

Print Assumptions safe.
Print Assumptions advanced_x.
Print Assumptions advanced_y.
