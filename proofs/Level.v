(* When an intruder need not count: while it is above, or below, by the vertical separation V, however its altitude and
   the ownship's differ from what is believed, within their errors. And when an area need not: while the ownship is below
   its floor or above its ceiling. *)

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

(* How far the ownship may be above a level (side 1) or below it (side -1) at most, t after the request. *)
Definition over_level (side own climb e ec level t : R) : R := side * (own + climb * t - level) + (e + ec * t).

Theorem not_over_level side own climb e ec level t altitude :
  side = 1 \/ side = -1 -> Rabs (altitude - (own + climb * t)) <= e + ec * t ->
  over_level side own climb e ec level t < 0 -> side * (altitude - level) < 0.
Proof.
  unfold over_level; intros sides mine short.
  unfold Rabs in mine; destruct sides; subst side; destruct (Rcase_abs _) in mine; lra.
Qed.

(* The times at which it may be are one window, which ends or begins at the quotient of gap and rate. *)
Definition gap_at_request (side own e level : R) : R := side * (own - level) + e.
Definition gap_rate (side climb ec : R) : R := side * climb + ec.
Definition level_time (gap rate : R) : R := - gap / rate.

Theorem level_window side own climb e ec level t :
  let gap := gap_at_request side own e level in
  let rate := gap_rate side climb ec in
  (0 < rate /\ t < level_time gap rate) \/ (rate < 0 /\ level_time gap rate < t) \/ (rate = 0 /\ gap < 0) ->
  over_level side own climb e ec level t < 0.
Proof.
  intros gap rate cases; unfold level_time in cases.
  replace (over_level side own climb e ec level t) with (gap + rate * t)
    by (unfold over_level, gap, rate, gap_at_request, gap_rate; ring).
  assert (met : rate <> 0 -> rate * (- gap / rate) = - gap) by (intros; field; assumption).
  destruct cases as [[grows early] | [[shrinks late] | [steady_ below]]].
  - assert (rate * t < rate * (- gap / rate)) by (apply Rmult_lt_compat_l; assumption).
    rewrite met in H by lra; lra.
  - assert (rate * t < rate * (- gap / rate)).
    { generalize (Rmult_lt_compat_l (- rate) (- gap / rate) t); lra. }
    rewrite met in H by lra; lra.
  - rewrite steady_; lra.
Qed.
