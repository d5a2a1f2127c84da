(* SAFE in space: at every time of the plan an intruder is as far away as it has to be, or it is above or below. Safe.v
   proves the first for the times in which the intruder counts, Level.v the second for a piece of the profile. What is
   left is that these times cover the plan. The same for areas; and the plan's floor and ceiling. *)

From Coq Require Import Reals Lra Psatz List.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Bound Motion Signed Constants Level Climb Safe.
Import ListNotations.
Open Scope R_scope.

(* ---- closed intervals cover a time ---- *)

(* No interval begins later than those before it have ended. *)
Fixpoint covered (b : R) (intervals : list (R * R)) (last : R) : Prop :=
  match intervals with
  | [] => False
  | (f, u) :: rest => f <= b /\ (last <= u \/ covered (Rmax b u) rest last)
  end.

Theorem covered_somewhere b intervals last t :
  covered b intervals last -> b <= t <= last -> exists f u, In (f, u) intervals /\ f <= t <= u.
Proof.
  revert b; induction intervals as [|[f u] rest IH]; simpl; intros b cover inside; [contradiction|].
  destruct cover as [begun goes_on].
  destruct (Rle_dec t u) as [here | past].
  - exists f, u; split; [left; reflexivity|lra].
  - destruct goes_on as [ends | others]; [lra|].
    destruct (IH _ others) as [g [v [member within]]].
    { split; [apply Rmax_lub; lra|lra]. }
    exists g, v; split; [right; assumption|assumption].
Qed.

(* ---- the ownship on its profile ---- *)

Record profile := Profile {
  pacceleration : R;  (* of changes of climb *)
  plevel : R; pclimb : R;  (* at the request *)
  pcorners : list corner;
  prounding : R;  (* of its corners, at most *)
  pfollower : R  (* how far the aircraft is from its rounded profile at most: errors of follower and altimeter *)
}.

Definition on_profile (p : profile) (t : R) : R := linear (plevel p) (pclimb p) (pcorners p) t.

Record flyable (p : profile) : Prop := {
  quick : 0 < pacceleration p;
  tolerant : 0 <= prounding p;
  corners_spaced : spaced (pacceleration p) 0 0 (pcorners p);
  corners_near : forall k, In k (pcorners p) -> rounding (pacceleration p) (change k) <= prounding p
}.

(* What is assumed of the aircraft. *)
Definition follows (p : profile) (own_z : R -> R) (horizon : R) : Prop :=
  forall t, 0 <= t <= horizon ->
  Rabs (own_z t - flown (pacceleration p) (plevel p) (pclimb p) (pcorners p) t) <= pfollower p.

Definition own_error (p : profile) : R := prounding p + pfollower p.

Lemma near_profile p own_z horizon t :
  flyable p -> follows p own_z horizon -> 0 <= t <= horizon -> Rabs (own_z t - on_profile p t) <= own_error p.
Proof.
  intros [pos some wide small] near inside.
  assert (held := near t inside).
  assert (rounded := flown_near_linear _ (plevel p) (pclimb p) 0 0 _ _ t pos some wide small).
  unfold on_profile, own_error.
  set (f := flown _ _ _ _ t) in *; set (l := linear _ _ _ t) in *.
  replace (own_z t - l) with (own_z t - f + (f - l)) by ring.
  apply Rle_trans with (1 := Rabs_triang _ _); lra.
Qed.

(* Floor (side 1, level m) and ceiling (side -1, level -m) are kept if the profile's ends and corners keep them, with
   the errors to spare. *)
Theorem keeps_level p own_z horizon side m t :
  side = 1 \/ side = -1 -> flyable p -> follows p own_z horizon -> 0 <= t <= horizon ->
  m + own_error p <= side * on_profile p 0 ->
  (forall k, In k (pcorners p) -> corner_time k <= horizon -> m + own_error p <= side * on_profile p (corner_time k)) ->
  m + own_error p <= side * on_profile p horizon ->
  m <= side * own_z t.
Proof.
  intros sides able near inside first corners_keep end_keeps.
  apply (keeps_near_profile side m (own_error p) (own_z t) (on_profile p t) sides
    (near_profile p own_z horizon t able near inside)).
  destruct able as [pos _ wide _].
  apply (linear_keeps side _ _ _ _ 0 horizon); try assumption.
  apply (spaced_ordered (pacceleration p) 0); assumption.
Qed.

(* A piece of the profile, between corners. *)
Record piece := Piece { pfrom : R; puntil : R; pline : R; prise : R  (* its line: altitude at the request, climb *) }.

Definition piece_of (p : profile) (q : piece) : Prop :=
  exists so_far later,
    pcorners p = so_far ++ later /\
    (forall k, In k so_far -> corner_time k <= pfrom q) /\ (forall k, In k later -> puntil q <= corner_time k) /\
    pline q = piece_level (plevel p) so_far /\ prise q = piece_climb (pclimb p) so_far.

Definition piece_time (q : piece) : R * R := (pfrom q, puntil q).

Lemma near_piece p q own_z horizon t :
  flyable p -> follows p own_z horizon -> piece_of p q -> 0 <= t <= horizon -> pfrom q <= t <= puntil q ->
  Rabs (own_z t - (pline q + prise q * t)) <= own_error p + 0 * t.
Proof.
  intros able near [so_far [later [all [past [ahead [line rise]]]]]] inside within.
  rewrite line, rise, <- (piece_is_line (plevel p) (pclimb p) so_far later t).
  - rewrite <- all, Rmult_0_l, Rplus_0_r; apply (near_profile p own_z horizon); assumption.
  - intros k member; generalize (past k member); lra.
  - intros k member; generalize (ahead k member); lra.
Qed.

(* ---- intruders ---- *)

(* The altitude of an intruder: it changes evenly, within an error that grows evenly. *)
Record altitude := Altitude {
  zlevel : R; zclimb : R; zerror : R; zgrowth : R;
  zseparation : R  (* vertical, to be kept from it *)
}.

Definition within_altitude (z : altitude) (other_z : R -> R) (horizon : R) : Prop :=
  forall t, 0 <= t <= horizon -> Rabs (other_z t - (zlevel z + zclimb z * t)) <= zerror z + zgrowth z * t.

Definition apart_on (p : profile) (z : altitude) (side : R) (q : piece) (t : R) : R :=
  apart_at side (pline q) (prise q) (own_error p) 0 (zlevel z) (zclimb z) (zerror z) (zgrowth z) t.

(* Above (side 1) or below (side -1) at both ends of a piece. *)
Definition apart_in (p : profile) (z : altitude) (side : R) (q : piece) : Prop :=
  (side = 1 \/ side = -1) /\ piece_of p q /\
  zseparation z <= apart_on p z side q (pfrom q) /\ zseparation z <= apart_on p z side q (puntil q).

Theorem piece_apart p z side q own_z other_z horizon t :
  flyable p -> follows p own_z horizon -> within_altitude z other_z horizon -> apart_in p z side q ->
  0 <= t <= horizon -> pfrom q <= t <= puntil q -> zseparation z <= Rabs (other_z t - own_z t).
Proof.
  intros able near known [sides [part [first last]]] inside within.
  assert (apart := apart_vertically side (pline q) (prise q) (own_error p) 0
    (zlevel z) (zclimb z) (zerror z) (zgrowth z) (zseparation z) (pfrom q) (puntil q) t (own_z t) (other_z t) sides
    within (near_piece p q own_z horizon t able near part inside within) (known t inside) first last).
  generalize (Rle_abs (other_z t - own_z t)) (Rle_abs (- (other_z t - own_z t))); rewrite Rabs_Ropp.
  destruct sides; subst side; lra.
Qed.

(* An intruder that counts in several times stands once for each of them in the traffic of Safe.v. *)
Definition counting (i : intruder) (window : R * R) : intruder :=
  Intruder (ix i) (iy i) (ipsi i) (ispeed i) (irate i) (ilasts i) (istd i) (ivstd i) (iage i) (iseparation i)
    (fst window) (snd window).

(* The times in which it counts, and those in which it is above or below, cover the plan. *)
Definition covers (p : profile) (i : intruder) (z : altitude) (traffic : list intruder) (horizon : R) : Prop :=
  exists intervals, covered 0 intervals horizon /\
  forall w, In w intervals ->
    In (counting i w) traffic \/ exists side q, piece_time q = w /\ apart_in p z side q.

Theorem safe_in_space r L T slack position_error eps horizon own_x0 own_y0 own_speed arcs traffic areas
    p i z own_z other_z :
  checked r L T slack position_error eps horizon own_x0 own_y0 own_speed arcs traffic areas ->
  flyable p -> follows p own_z horizon ->
  within_altitude z other_z horizon -> covers p i z traffic horizon ->
  forall t A, 0 <= t <= horizon -> In A arcs -> during A t ->
    (exists w, fst w <= t <= snd w /\
      let away := norm (ix i - own_x0) (iy i - own_y0) in
      iseparation i - ROUNDING - eps <= distance A i t /\
      need r (counting i w) away t - CLOSE - eps <= distance A i t) \/
    zseparation z <= Rabs (other_z t - own_z t).
Proof.
  intros C able near known [intervals [cover proven]] t A inside member now.
  destruct (covered_somewhere 0 intervals horizon t cover inside) as [f [u [interval within]]].
  destruct (proven (f, u) interval) as [stands | [side [q [time apart]]]].
  - left; exists (f, u); split; [assumption|].
    destruct (safe _ _ _ _ _ _ _ _ _ _ _ _ _ C t inside) as [_ kept].
    destruct (kept A member now) as [others _].
    apply (others (counting i (f, u)) stands within).
  - right; injection time as from until.
    apply (piece_apart p z side q own_z other_z horizon); try assumption; lra.
Qed.

(* ---- areas ---- *)

Definition counting_area (z : area) (window : R * R) : area :=
  Region (ashape z) (aout z) (avx z) (avy z) (agrowth z) (aclearance z) (astart z) (fst window) (snd window).

(* The ownship is below the floor of an area (side 1), or above its ceiling (side -1), at both ends of a piece. *)
Definition off_level (p : profile) (side level : R) (q : piece) : Prop :=
  (side = 1 \/ side = -1) /\ piece_of p q /\
  over_level side (pline q) (prise q) (own_error p) 0 level (pfrom q) < 0 /\
  over_level side (pline q) (prise q) (own_error p) 0 level (puntil q) < 0.

Theorem piece_off_level p side level q own_z horizon t :
  flyable p -> follows p own_z horizon -> off_level p side level q ->
  0 <= t <= horizon -> pfrom q <= t <= puntil q -> side * (own_z t - level) < 0.
Proof.
  intros able near [sides [part [first last]]] inside within.
  apply (not_over_level side (pline q) (prise q) (own_error p) 0 level t (own_z t) sides
    (near_piece p q own_z horizon t able near part inside within)).
  unfold over_level in *.
  set (g := side * (pline q - level) + own_error p); set (c := side * prise q).
  replace (side * (pline q + prise q * pfrom q - level) + (own_error p + 0 * pfrom q)) with (g + c * pfrom q) in first
    by (unfold g, c; ring).
  replace (side * (pline q + prise q * puntil q - level) + (own_error p + 0 * puntil q)) with (g + c * puntil q) in last
    by (unfold g, c; ring).
  replace (side * (pline q + prise q * t - level) + (own_error p + 0 * t)) with (g + c * t) by (unfold g, c; ring).
  destruct (Rle_dec 0 c); nra.
Qed.

(* The area is valid from b to last. The times in which it counts, and those in which the ownship is below its floor or
   above its ceiling, cover all of it. *)
Theorem area_in_space r L T slack position_error eps horizon own_x0 own_y0 own_speed arcs traffic areas
    p z start floor ceiling own_z b last intervals :
  checked r L T slack position_error eps horizon own_x0 own_y0 own_speed arcs traffic areas ->
  flyable p -> follows p own_z horizon ->
  clear_of z own_x0 own_y0 0 start -> 0 <= b -> last <= horizon ->
  covered b intervals last ->
  (forall w, In w intervals ->
    In (counting_area z w) areas \/
    exists q, piece_time q = w /\ (off_level p 1 floor q \/ off_level p (-1) ceiling q)) ->
  forall t A, b <= t <= last -> In A arcs -> during A t ->
    (exists w, fst w <= t <= snd w /\
      clear_of z (own_px A t) (own_py A t) t (area_required r (counting_area z w) start - eps)) \/
    own_z t < floor \/ ceiling < own_z t.
Proof.
  intros C able near begun after before cover proven t A inside member now.
  assert (planned : 0 <= t <= horizon) by lra.
  destruct (covered_somewhere b intervals last t cover inside) as [f [u [interval within]]].
  destruct (proven (f, u) interval) as [stands | [q [time off]]].
  - left; exists (f, u); split; [assumption|].
    destruct (safe _ _ _ _ _ _ _ _ _ _ _ _ _ C t planned) as [_ kept].
    destruct (kept A member now) as [_ [places _]].
    apply (places (counting_area z (f, u)) start stands within begun).
  - right; injection time as from until.
    destruct off as [below | above]; [left|right].
    + generalize (piece_off_level p 1 floor q own_z horizon t able near below planned); lra.
    + generalize (piece_off_level p (-1) ceiling q own_z horizon t able near above planned); lra.
Qed.
