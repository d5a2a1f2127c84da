(* When an intruder need not count: while it is above, or below, by the vertical separation V, however its altitude and
   the ownship's differ from what is believed, within their errors. *)

From Coq Require Import Reals Lra Psatz.
Open Scope R_scope.

(* How far the intruder is above the ownship (side 1) or below (side -1) at least, t after the request: altitudes and
   climbs of both are off by at most e and ec. *)
Definition apart_at (side own climb e ec other rise f fc t : R) : R :=
  side * (other + rise * t - (own + climb * t)) - (e + ec * t) - (f + fc * t).

Theorem apart_vertically side own climb e ec other rise f fc V b u t at_own at_other :
  side = 1 \/ side = -1 -> b <= t <= u ->
  Rabs (at_own - (own + climb * t)) <= e + ec * t ->
  Rabs (at_other - (other + rise * t)) <= f + fc * t ->
  V <= apart_at side own climb e ec other rise f fc b ->
  V <= apart_at side own climb e ec other rise f fc u ->
  V <= side * (at_other - at_own).
Proof.
  intros sides inside mine theirs first last.
  assert (between : V <= apart_at side own climb e ec other rise f fc t).
  { unfold apart_at in *.
    set (c := side * (rise - climb) - ec - fc).
    replace (side * (other + rise * b - (own + climb * b)) - (e + ec * b) - (f + fc * b))
      with (side * (other - own) - e - f + c * b) in first by (unfold c; ring).
    replace (side * (other + rise * u - (own + climb * u)) - (e + ec * u) - (f + fc * u))
      with (side * (other - own) - e - f + c * u) in last by (unfold c; ring).
    replace (side * (other + rise * t - (own + climb * t)) - (e + ec * t) - (f + fc * t))
      with (side * (other - own) - e - f + c * t) by (unfold c; ring).
    destruct (Rle_dec 0 c); nra. }
  unfold apart_at in between.
  unfold Rabs in mine, theirs.
  destruct sides; subst side; destruct (Rcase_abs _) in mine; destruct (Rcase_abs _) in theirs; lra.
Qed.
