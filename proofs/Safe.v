(* The theorem behind the word SAFE: if every part of every arc passes the validator's check against every intruder and
   every area that counts then, then at every real time of the plan every intruder that counts is as far as it has to be,
   every area that counts is kept out of, or in, by its clearance, and speed, acceleration and turn rate stay within their
   limits. When an intruder or an area need not count is told in Level.v, and what both say together in Space.v. *)

From Coq Require Import Reals Lra Psatz List.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Bound Motion Signed Constants.
Import ListNotations.
Open Scope R_scope.

Record arc := Arc {
  begin : R; duration : R;  (* s *)
  ax : R; ay : R; psi : R; speed : R;  (* at its beginning *)
  omega : R; alpha : R  (* turn rate, acceleration *)
}.

Record intruder := Intruder {  (* at the request *)
  ix : R; iy : R; ipsi : R; ispeed : R;
  irate : R; ilasts : R;  (* its turn *)
  istd : R; ivstd : R;  (* one sigma of position and velocity in its report *)
  iage : R;  (* of the report *)
  iseparation : R;  (* to be kept from it *)
  ifrom : R; iuntil : R  (* when it counts; else it is above or below *)
}.

Record area := Region {  (* at the request *)
  ashape : shape; aout : bool;  (* to be kept out of, or else in *)
  avx : R; avy : R; agrowth : R;  (* velocity against the air, growth to all sides *)
  aclearance : R;
  astart : R;  (* the signed distance of the ownship is no more *)
  afrom : R; auntil : R  (* when it counts; else it is not valid, or above, or below *)
}.

Record requirement := Requirement { margin : R; sigmas : R }.

Record limits := Limits { speed_min : R; speed_max : R; acc_min : R; acc_max : R; rate_max : R }.

Record tolerance := Tolerance { tol_speed : R; tol_acc : R; tol_rate : R }.

(* ---- where everybody is at time t after the request ---- *)

Definition own_px (A : arc) (t : R) : R := own_x (ax A) (psi A) (speed A) (omega A) (alpha A) (t - begin A).
Definition own_py (A : arc) (t : R) : R := own_y (ay A) (psi A) (speed A) (omega A) (alpha A) (t - begin A).
Definition other_px (i : intruder) (t : R) : R := other_x (ix i) (ipsi i) (ispeed i) (irate i) (ilasts i) t.
Definition other_py (i : intruder) (t : R) : R := other_y (iy i) (ipsi i) (ispeed i) (irate i) (ilasts i) t.

Definition distance (A : arc) (i : intruder) (t : R) : R :=
  norm (other_px i t - own_px A t) (other_py i t - own_py A t).

Definition during (A : arc) (t : R) : Prop := begin A <= t <= begin A + duration A.

(* ---- what is asked for ---- *)

Definition required (separation margin sigmas std away : R) : R :=
  Rmax separation (Rmin (separation + margin + sigmas * std) away).

(* One error of the velocity lasts from the report on: before the request and after it. *)
Definition growth (sigmas std vstd age t : R) : R :=
  sigmas * (norm std (vstd * (age + t)) - norm std (vstd * age)).

Definition wanted (separation margin sigmas std : R) : R := separation + margin + sigmas * std.

(* How far an intruder is at the request matters only where it counts then. *)
Definition at_request (separation margin sigmas std away first : R) : R :=
  if Rlt_dec 0 first then wanted separation margin sigmas std else required separation margin sigmas std away.

Definition need (r : requirement) (i : intruder) (away t : R) : R :=
  at_request (iseparation i) (margin r) (sigmas r) (norm (istd i) (ivstd i * Rabs (iage i))) away (ifrom i)
    + growth (sigmas r) (istd i) (ivstd i) (Rabs (iage i)) t.

Definition counts (i : intruder) (b e : R) : Prop := ifrom i <= e /\ b <= iuntil i.

Definition required_with_tolerance (need separation : R) : R := Rmax (need - CLOSE) (separation - ROUNDING).

Definition required_at (r : requirement) (i : intruder) (away t : R) : R := required_with_tolerance (need r i away t) (iseparation i).

Lemma spread_monotone std vstd t u : 0 <= t <= u -> norm std (vstd * t) <= norm std (vstd * u).
Proof.
  intros order; unfold norm; apply sqrt_le_1_alt.
  assert (0 <= vstd * vstd) by nra.
  assert (t * t <= u * u) by nra.
  nra.
Qed.

Lemma growth_monotone s std vstd age t u :
  0 <= s -> 0 <= age -> 0 <= t <= u -> growth s std vstd age t <= growth s std vstd age u.
Proof.
  intros pos old order; unfold growth.
  apply Rmult_le_compat_l; [assumption|].
  assert (0 <= age + t <= age + u) as later by lra.
  generalize (spread_monotone std vstd _ _ later); lra.
Qed.

Lemma owes_monotone r i away t u :
  0 <= sigmas r -> 0 <= t <= u -> required_at r i away t <= required_at r i away u.
Proof.
  intros pos order; unfold required_at, required_with_tolerance, need.
  apply Rle_max_compat_r.
  generalize (growth_monotone (sigmas r) (istd i) (ivstd i) _ t u pos (Rabs_pos (iage i)) order); lra.
Qed.

Lemma required_separation s m k std away : s <= required s m k std away.
Proof. apply Rmax_l. Qed.

Lemma growth_pos s std vstd age t : 0 <= s -> 0 <= age -> 0 <= t -> 0 <= growth s std vstd age t.
Proof.
  intros; unfold growth; apply Rmult_le_pos; [assumption|].
  assert (0 <= age <= age + t) as later by lra.
  generalize (spread_monotone std vstd _ _ later); lra.
Qed.

(* What is kept is never below the separation less ROUNDING, nor below what is needed less CLOSE. *)
Lemma owes_separation r i away t : iseparation i - ROUNDING <= required_at r i away t.
Proof. apply Rmax_r. Qed.

Lemma owes_need r i away t : need r i away t - CLOSE <= required_at r i away t.
Proof. apply Rmax_l. Qed.

(* A part that is clear of the whole need, as the validator's first look finds, required_at no more. *)
Lemma owed_below_need r i away t :
  0 <= sigmas r -> 0 <= margin r -> 0 <= t -> required_at r i away t <= need r i away t.
Proof.
  intros pos spare later; unfold required_at, required_with_tolerance.
  apply Rmax_lub; unfold CLOSE, ROUNDING; [lra|].
  unfold need, at_request, wanted.
  generalize (growth_pos (sigmas r) (istd i) (ivstd i) _ t pos (Rabs_pos (iage i)) later).
  generalize (required_separation (iseparation i) (margin r) (sigmas r) (norm (istd i) (ivstd i * Rabs (iage i))) away).
  generalize (Rmult_le_pos _ _ pos (norm_pos (istd i) (ivstd i * Rabs (iage i)))).
  destruct (Rlt_dec 0 (ifrom i)); lra.
Qed.

(* ---- one part ---- *)

Definition relative_acceleration (A : arc) (i : intruder) : R :=
  own_acceleration (speed A) (omega A) (alpha A) (duration A) + other_acceleration (ispeed i) (irate i) (ilasts i).

Definition sagitta (relative_acceleration h : R) : R := Rmax (relative_acceleration * (1 / 8 * (h * h))) TINY.

(* The ways to see that the distance in a part is at least m; the last is the validator's. *)
Inductive clear (x0 y0 x1 y1 b : R) : R -> Prop :=
| by_start g : 0 < norm x0 y0 -> 0 <= g -> g <= (x0 * (x1 - x0) + y0 * (y1 - y0)) / norm x0 y0 ->
    clear x0 y0 x1 y1 b (norm x0 y0 - loss b g)
| by_end g : 0 < norm x1 y1 -> 0 <= g -> g <= (x1 * (x0 - x1) + y1 * (y0 - y1)) / norm x1 y1 ->
    clear x0 y0 x1 y1 b (norm x1 y1 - loss b g)
| by_line : 0 < norm (x1 - x0) (y1 - y0) -> clear x0 y0 x1 y1 b (cross_bound x0 y0 x1 y1 b)
| by_reach : clear x0 y0 x1 y1 b (norm x0 y0 - norm (x1 - x0) (y1 - y0) - b)
| by_reach_end : clear x0 y0 x1 y1 b (norm x1 y1 - norm (x1 - x0) (y1 - y0) - b)
| by_validator : clear x0 y0 x1 y1 b (bound x0 y0 x1 y1 b - DEGENERATE).

Lemma clear_sound x0 y0 x1 y1 b m s px py :
  0 < b -> 0 <= s <= 1 -> clear x0 y0 x1 y1 b m ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * b * s * (1 - s) -> m <= norm px py.
Proof.
  intros pos inside how close; destruct how.
  - apply (start_sound x0 y0 x1 y1 b s); assumption.
  - apply (end_sound x0 y0 x1 y1 b s); assumption.
  - apply (cross_sound x0 y0 x1 y1 b s); assumption.
  - apply (reach_sound x0 y0 x1 y1 b s); assumption.
  - apply (reach_sound_end x0 y0 x1 y1 b s); assumption.
  - apply (bound_sound x0 y0 x1 y1 b s); assumption.
Qed.

(* A part from b to e passes: own positions at its ends are known up to position_error, and the bound from them, with a sagitta that
   is large enough, is enough but for eps. *)
Definition passes (r : requirement) (A : arc) (i : intruder) (away position_error eps b e : R) : Prop :=
  exists xb yb xe ye B m,
    sagitta (relative_acceleration A i) (e - b) <= B /\
    norm (xb - own_px A b) (yb - own_py A b) <= position_error /\
    norm (xe - own_px A e) (ye - own_py A e) <= position_error /\
    clear (other_px i b - xb) (other_py i b - yb) (other_px i e - xe) (other_py i e - ye) B m /\
    required_at r i away e - eps <= m - position_error.

Lemma relative_moves A i :
  moves (fun t => other_px i t - own_px A t) (fun t => other_py i t - own_py A t)
    (fun t => other_vx (ipsi i) (ispeed i) (irate i) (ilasts i) t
      - own_vx (psi A) (speed A) (omega A) (alpha A) (t - begin A))
    (fun t => other_vy (ipsi i) (ispeed i) (irate i) (ilasts i) t
      - own_vy (psi A) (speed A) (omega A) (alpha A) (t - begin A)).
Proof.
  apply moves_minus; [apply other_moves|].
  assert (own := own_moves (ax A) (ay A) (psi A) (speed A) (omega A) (alpha A)).
  intros t; destruct (own (t - begin A)) as [mx my]; unfold own_px, own_py.
  assert (shift : is_derive (fun u => u - begin A) t 1) by (auto_derive; [exact I|ring]).
  split.
  - generalize (is_derive_comp _ (fun u => u - begin A) t _ _ mx shift).
    unfold scal; simpl; unfold mult; simpl; rewrite Rmult_1_l; trivial.
  - generalize (is_derive_comp _ (fun u => u - begin A) t _ _ my shift).
    unfold scal; simpl; unfold mult; simpl; rewrite Rmult_1_l; trivial.
Qed.

Lemma relative_steady A i b e :
  0 <= begin A -> 0 <= speed A -> 0 <= speed A + alpha A * duration A ->
  begin A <= b -> e <= begin A + duration A ->
  steady (fun t => other_vx (ipsi i) (ispeed i) (irate i) (ilasts i) t
      - own_vx (psi A) (speed A) (omega A) (alpha A) (t - begin A))
    (fun t => other_vy (ipsi i) (ispeed i) (irate i) (ilasts i) t
      - own_vy (psi A) (speed A) (omega A) (alpha A) (t - begin A)) (relative_acceleration A i) b e.
Proof.
  intros begun first last from until.
  unfold relative_acceleration; rewrite Rplus_comm.
  apply (steady_minus _ _ (fun t => own_vx (psi A) (speed A) (omega A) (alpha A) (t - begin A))
    (fun t => own_vy (psi A) (speed A) (omega A) (alpha A) (t - begin A))).
  - apply other_steady; lra.
  - intros s t one two three.
    replace (t - s) with (t - begin A - (s - begin A)) by ring.
    apply (own_steady (psi A) (speed A) (omega A) (alpha A) (duration A)); try assumption; lra.
Qed.

Lemma relative_acceleration_pos A i : 0 <= relative_acceleration A i.
Proof.
  unfold relative_acceleration, other_acceleration; generalize (norm_pos (alpha A) (quickest (speed A) (alpha A) (duration A) * omega A)).
  unfold own_acceleration; destruct (Rlt_dec 0 (ilasts i)); [generalize (Rabs_pos (ispeed i * irate i))|]; lra.
Qed.

(* The checker leaves out an arc at whose beginning an intruder is farther than both can fly in it. *)
Theorem left_out_soundly A i near b e B :
  0 <= speed A -> 0 <= speed A + alpha A * duration A -> 0 <= ispeed i ->
  begin A <= b -> b <= e -> e <= begin A + duration A -> near <= distance A i b ->
  let flown := (quickest (speed A) (alpha A) (duration A) + ispeed i) * (e - b) in
  near - flown <= distance A i e /\
  exists m, clear (other_px i b - own_px A b) (other_py i b - own_py A b)
    (other_px i e - own_px A e) (other_py i e - own_py A e) B m /\ near - flown - B <= m.
Proof.
  intros first last forward from order until far both.
  set (x := fun t => other_px i t - own_px A t); set (y := fun t => other_py i t - own_py A t).
  assert (fast : 0 <= quickest (speed A) (alpha A) (duration A)).
  { unfold quickest; generalize (Rmax_l (speed A) (speed A + alpha A * duration A)); lra. }
  assert (way : norm (x e - x b) (y e - y b) <= both).
  { assert (motion := relative_moves A i).
    apply (flown _ _ _ _ (quickest (speed A) (alpha A) (duration A) + ispeed i) b e) in motion; [assumption|lra|lra|].
    intros t inside.
    unfold Rminus at 1 3; apply Rle_trans with (1 := norm_triangle _ _ _ _); rewrite norm_opp.
    unfold other_vx, other_vy, own_vx, own_vy.
    assert (0 <= t - begin A <= duration A) as now by lra.
    assert (own := quickest_bound _ _ _ _ first last now).
    rewrite !speed_norm by lra; lra. }
  unfold distance in *; fold (x b) (y b) (x e) (y e) in *.
  assert (back := norm_near (x e) (y e) (x b) (y b) both way).
  split; [lra|].
  exists (norm (x b) (y b) - norm (x e - x b) (y e - y b) - B); split; [apply by_reach|lra].
Qed.

Theorem part_safe r A i away position_error eps b e t :
  0 <= sigmas r -> 0 <= begin A -> 0 <= speed A -> 0 <= speed A + alpha A * duration A ->
  begin A <= b -> b < e -> e <= begin A + duration A ->
  passes r A i away position_error eps b e -> b <= t <= e -> required_at r i away t - eps <= distance A i t.
Proof.
  intros pos begun first last from order until [xb [yb [xe [ye [B [m [wide [atb [ate [how enough]]]]]]]]]] inside.
  apply Rle_trans with (required_at r i away e - eps).
  { generalize (owes_monotone r i away t e pos); lra. }
  apply Rle_trans with (1 := enough).
  assert (tiny : 0 < TINY) by (unfold TINY; lra).
  unfold sagitta in wide.
  assert (B_pos : 0 < B) by (generalize (Rmax_r (relative_acceleration A i * (1 / 8 * ((e - b) * (e - b)))) TINY); lra).
  set (s := (t - b) / (e - b)).
  assert (s_in : 0 <= s <= 1).
  { unfold s; split.
    - apply Rmult_le_pos; [lra|left; apply Rinv_0_lt_compat; lra].
    - apply Rmult_le_reg_r with (e - b); [lra|]; replace ((t - b) / (e - b) * (e - b)) with (t - b) by (field; lra); lra. }
  assert (arch := chord _ _ _ _ (relative_acceleration A i) b e t (relative_acceleration_pos A i) order inside (relative_moves A i)
    (relative_steady A i b e begun first last from until)).
  fold s in arch; simpl in arch.
  assert (arch' : relative_acceleration A i / 2 * (t - b) * (e - t) <= 4 * B * s * (1 - s)).
  { replace (relative_acceleration A i / 2 * (t - b) * (e - t)) with (4 * (relative_acceleration A i * (1 / 8 * ((e - b) * (e - b)))) * s * (1 - s))
      by (unfold s; field; lra).
    assert (0 <= s * (1 - s)) by (apply Rmult_le_pos; lra).
    assert (relative_acceleration A i * (1 / 8 * ((e - b) * (e - b))) <= B)
      by (generalize (Rmax_l (relative_acceleration A i * (1 / 8 * ((e - b) * (e - b)))) TINY); lra).
    rewrite !(Rmult_assoc (4 * _)); apply Rmult_le_compat_r; lra. }
  (* the point shifted by the errors of the ends *)
  set (gx := (1 - s) * (xb - own_px A b) + s * (xe - own_px A e)).
  set (gy := (1 - s) * (yb - own_py A b) + s * (ye - own_py A e)).
  assert (off : norm gx gy <= position_error).
  { unfold gx, gy.
    apply Rle_trans with (1 := norm_triangle _ _ _ _).
    rewrite !norm_scale by lra.
    assert ((1 - s) * norm (xb - own_px A b) (yb - own_py A b) <= (1 - s) * position_error) by (apply Rmult_le_compat_l; lra).
    assert (s * norm (xe - own_px A e) (ye - own_py A e) <= s * position_error) by (apply Rmult_le_compat_l; lra).
    lra. }
  assert (far := clear_sound _ _ _ _ B m s
    (other_px i t - own_px A t - gx) (other_py i t - own_py A t - gy) B_pos s_in how).
  assert (m <= norm (other_px i t - own_px A t - gx) (other_py i t - own_py A t - gy)).
  { apply far; apply Rle_trans with (2 := arch'); apply Rle_trans with (2 := arch); right.
    unfold on_x, gx, gy; f_equal; ring. }
  unfold distance.
  generalize (norm_near (other_px i t - own_px A t) (other_py i t - own_py A t)
    (other_px i t - own_px A t - gx) (other_py i t - own_py A t - gy) position_error).
  replace (other_px i t - own_px A t - (other_px i t - own_px A t - gx)) with gx by ring.
  replace (other_py i t - own_py A t - (other_py i t - own_py A t - gy)) with gy by ring.
  intros near; specialize (near off); lra.
Qed.

(* ---- areas ---- *)

(* What the growth of an area adds to signed distances, for each second. *)
Definition gain (out : bool) (growth : R) : R := if out then - growth else growth.

(* The signed distance of a place from an area, t after the request, is m or more. *)
Definition clear_of (z : area) (px py t m : R) : Prop :=
  keeps (aout z) (ashape z) (px - avx z * t) (py - avy z * t) (m - gain (aout z) (agrowth z) * t).

(* A plan that begins inside the clearance must come no nearer, but for NEARER. *)
Definition area_need (wanted start first : R) : R :=
  if Rlt_dec 0 first then wanted else Rmin (Rmax (start - NEARER) 0) wanted.

Definition area_need_with_tolerance (need : R) : R := Rmax (need - CLOSE) (- ROUNDING).

Definition area_required (r : requirement) (z : area) (start : R) : R :=
  area_need_with_tolerance (area_need (aclearance z + margin r) start (afrom z)).

Lemma area_required_monotone r z s u : s <= u -> area_required r z s <= area_required r z u.
Proof.
  intros order; unfold area_required, area_need_with_tolerance, area_need.
  apply Rle_max_compat_r.
  destruct (Rlt_dec 0 (afrom z)); [lra|].
  apply Rplus_le_compat_r, Rle_min_compat_r, Rle_max_compat_r; lra.
Qed.

Definition area_sagitta (acceleration h : R) : R := acceleration / 8 * (h * h).

Definition area_passes (r : requirement) (A : arc) (z : area) (position_error eps b e : R) : Prop :=
  exists xb yb xe ye m,
    norm (xb - own_px A b) (yb - own_py A b) <= position_error /\
    norm (xe - own_px A e) (ye - own_py A e) <= position_error /\
    chord_keeps (aout z) (ashape z) (xb - avx z * b) (yb - avy z * b) (xe - avx z * e) (ye - avy z * e) m /\
    area_required r z (astart z) - eps
      <= m + Rmin (gain (aout z) (agrowth z) * b) (gain (aout z) (agrowth z) * e)
        - area_sagitta (own_acceleration (speed A) (omega A) (alpha A) (duration A)) (e - b) - position_error.

Lemma seen_moves A vx vy :
  moves (fun t => own_px A t - vx * t) (fun t => own_py A t - vy * t)
    (fun t => own_vx (psi A) (speed A) (omega A) (alpha A) (t - begin A) - vx)
    (fun t => own_vy (psi A) (speed A) (omega A) (alpha A) (t - begin A) - vy).
Proof.
  assert (own := own_moves (ax A) (ay A) (psi A) (speed A) (omega A) (alpha A)).
  apply (moves_minus (own_px A) (own_py A) _ _ (fun t => vx * t) (fun t => vy * t) (fun _ => vx) (fun _ => vy)).
  - intros t; destruct (own (t - begin A)) as [mx my]; unfold own_px, own_py.
    assert (shift : is_derive (fun u => u - begin A) t 1) by (auto_derive; [exact I|ring]).
    split.
    + generalize (is_derive_comp _ (fun u => u - begin A) t _ _ mx shift).
      unfold scal; simpl; unfold mult; simpl; rewrite Rmult_1_l; trivial.
    + generalize (is_derive_comp _ (fun u => u - begin A) t _ _ my shift).
      unfold scal; simpl; unfold mult; simpl; rewrite Rmult_1_l; trivial.
  - intros t; split; auto_derive; try exact I; ring.
Qed.

Lemma seen_steady A vx vy b e :
  0 <= speed A -> 0 <= speed A + alpha A * duration A -> begin A <= b -> e <= begin A + duration A ->
  steady (fun t => own_vx (psi A) (speed A) (omega A) (alpha A) (t - begin A) - vx)
    (fun t => own_vy (psi A) (speed A) (omega A) (alpha A) (t - begin A) - vy)
    (own_acceleration (speed A) (omega A) (alpha A) (duration A)) b e.
Proof.
  intros first last from until s t one two three.
  match goal with |- norm ?p ?q <= _ => set (x := p); set (y := q) end.
  replace x with (own_vx (psi A) (speed A) (omega A) (alpha A) (t - begin A)
    - own_vx (psi A) (speed A) (omega A) (alpha A) (s - begin A)) by (unfold x; ring).
  replace y with (own_vy (psi A) (speed A) (omega A) (alpha A) (t - begin A)
    - own_vy (psi A) (speed A) (omega A) (alpha A) (s - begin A)) by (unfold y; ring).
  replace (t - s) with (t - begin A - (s - begin A)) by ring.
  apply (own_steady (psi A) (speed A) (omega A) (alpha A) (duration A)); try assumption; lra.
Qed.

Theorem area_part_safe r A z position_error eps b e t :
  well_formed (ashape z) -> 0 <= speed A -> 0 <= speed A + alpha A * duration A ->
  begin A <= b -> b < e -> e <= begin A + duration A ->
  area_passes r A z position_error eps b e -> b <= t <= e ->
  clear_of z (own_px A t) (own_py A t) t (area_required r z (astart z) - eps).
Proof.
  intros ends first last from order until [xb [yb [xe [ye [m [at_b [at_e [held enough]]]]]]]] inside.
  assert (kept := part_keeps (aout z) (ashape z) _ _ _ _ (own_acceleration (speed A) (omega A) (alpha A) (duration A))
    position_error b e (xb - avx z * b) (yb - avy z * b) (xe - avx z * e) (ye - avy z * e) m t ends (norm_pos _ _)
    order inside (seen_moves A (avx z) (avy z)) (seen_steady A (avx z) (avy z) b e first last from until)).
  simpl in kept.
  replace (xb - avx z * b - (own_px A b - avx z * b)) with (xb - own_px A b) in kept by ring.
  replace (yb - avy z * b - (own_py A b - avy z * b)) with (yb - own_py A b) in kept by ring.
  replace (xe - avx z * e - (own_px A e - avx z * e)) with (xe - own_px A e) in kept by ring.
  replace (ye - avy z * e - (own_py A e - avy z * e)) with (ye - own_py A e) in kept by ring.
  unfold clear_of; apply keeps_less with (2 := kept at_b at_e held).
  unfold area_sagitta in enough.
  set (g := gain (aout z) (agrowth z)) in *.
  assert (Rmin (g * b) (g * e) <= g * t).
  { destruct (Rle_dec 0 g).
    - apply Rle_trans with (1 := Rmin_l _ _); apply Rmult_le_compat_l; lra.
    - apply Rle_trans with (1 := Rmin_r _ _); nra. }
  lra.
Qed.

(* An area is left out that cannot be reached: nothing in it comes nearer than both fly and it grows. *)
Theorem area_out_of_reach z x y vx vy fastest start horizon m t :
  well_formed (ashape z) -> 0 <= fastest -> 0 <= t <= horizon ->
  moves x y vx vy -> (forall u, 0 <= u <= horizon -> norm (vx u) (vy u) <= fastest) ->
  clear_of z (x 0) (y 0) 0 start ->
  m + (fastest + norm (avx z) (avy z) + Rmax (- gain (aout z) (agrowth z)) 0) * horizon <= start ->
  clear_of z (x t) (y t) t m.
Proof.
  intros ends pos inside motion slow begun far; unfold clear_of in *.
  set (g := gain (aout z) (agrowth z)) in *.
  assert (way : norm (x t - x 0) (y t - y 0) <= fastest * (t - 0)).
  { apply (flown x y vx vy fastest 0 t); [assumption|lra|assumption|]; intros u u_in; apply slow; lra. }
  assert (drift : norm (avx z * t) (avy z * t) = t * norm (avx z) (avy z)).
  { rewrite (Rmult_comm (avx z)), (Rmult_comm (avy z)); apply norm_scale; lra. }
  rewrite !Rmult_0_r, !Rminus_0_r in begun.
  assert (moved : norm (x 0 - (x t - avx z * t)) (y 0 - (y t - avy z * t)) <= fastest * t + t * norm (avx z) (avy z)).
  { assert (sum := norm_triangle (- (x t - x 0)) (- (y t - y 0)) (avx z * t) (avy z * t)).
    rewrite norm_opp, drift in sum.
    replace (- (x t - x 0) + avx z * t) with (x 0 - (x t - avx z * t)) in sum by ring.
    replace (- (y t - y 0) + avy z * t) with (y 0 - (y t - avy z * t)) in sum by ring.
    lra. }
  apply keeps_less with (2 := keeps_near _ _ _ _ _ _ _ _ ends moved begun).
  assert (0 <= norm (avx z) (avy z)) by apply norm_pos.
  assert (0 <= Rmax (- g) 0) by apply Rmax_r.
  assert (- g <= Rmax (- g) 0) by apply Rmax_l.
  set (q := fastest + norm (avx z) (avy z) + Rmax (- g) 0) in *.
  assert (q * t <= q * horizon) by (apply Rmult_le_compat_l; unfold q; lra).
  assert (- g * t <= Rmax (- g) 0 * t) by (apply Rmult_le_compat_r; lra).
  unfold q in *; lra.
Qed.

(* ---- the parts of an arc, and the arcs of a plan, leave no gap ---- *)

Fixpoint parts (test : R -> R -> Prop) (b : R) (ends : list R) (last : R) : Prop :=
  match ends with
  | [] => b = last
  | e :: rest => b < e /\ e <= last /\ test b e /\ parts test e rest last
  end.

Lemma parts_cover test b ends last t :
  parts test b ends last -> b < last -> b <= t <= last ->
  exists c e, b <= c /\ c < e /\ e <= last /\ c <= t <= e /\ test c e.
Proof.
  revert b; induction ends as [|e rest IH]; simpl; intros b pass order inside; [lra|].
  destruct pass as [before [within [this others]]].
  destruct (Rle_dec t e).
  - exists b, e; repeat split; try assumption; lra.
  - destruct (IH e others) as [c [f [one [two [three [four five]]]]]]; [lra|lra|].
    exists c, f; repeat split; try assumption; lra.
Qed.

Fixpoint joined (t : R) (arcs : list arc) (last : R) : Prop :=
  match arcs with
  | [] => t = last
  | A :: rest => begin A = t /\ 0 < duration A /\ joined (t + duration A) rest last
  end.

Lemma joined_begins t arcs last A : joined t arcs last -> In A arcs -> t <= begin A /\ 0 < duration A.
Proof.
  revert t; induction arcs as [|B rest IH]; simpl; intros t chain []; destruct chain as [at_ [long others]].
  - subst; lra.
  - destruct (IH _ others H); lra.
Qed.

Lemma arcs_cover t arcs last u :
  joined t arcs last -> t < last -> t <= u <= last -> exists A, In A arcs /\ during A u.
Proof.
  revert t; induction arcs as [|A rest IH]; simpl; intros t chain order inside; [lra|].
  destruct chain as [at_ [long others]].
  destruct (Rle_dec u (t + duration A)).
  - exists A; unfold during; split; [left; reflexivity|rewrite at_; lra].
  - destruct (IH _ others) as [B [one two]]; [lra|lra|].
    exists B; split; [right|]; assumption.
Qed.

(* ---- speeds: the bounds follow the most moderate speed so far ---- *)

Fixpoint speeds (L : limits) (tol so_far_low so_far_high : R) (arcs : list arc) : Prop :=
  match arcs with
  | [] => True
  | A :: rest =>
      let low := Rmax so_far_low (speed A) in
      let high := Rmin so_far_high (speed A) in
      Rmin (speed_min L) low - tol <= speed A + alpha A * duration A <= Rmax (speed_max L) high + tol
      /\ speeds L tol low high rest
  end.

Fixpoint speeds_join (slack before : R) (arcs : list arc) : Prop :=
  match arcs with
  | [] => True
  | A :: rest => Rabs (speed A - before) <= slack /\ speeds_join slack (speed A + alpha A * duration A) rest
  end.

Lemma speeds_ends L tol slack v0 low high before arcs A :
  v0 <= low -> high <= v0 -> 0 <= tol ->
  Rmin (speed_min L) v0 - tol <= before <= Rmax (speed_max L) v0 + tol ->
  speeds L tol low high arcs -> speeds_join slack before arcs -> In A arcs ->
  Rmin (speed_min L) v0 - tol - slack <= speed A <= Rmax (speed_max L) v0 + tol + slack /\
  Rmin (speed_min L) v0 - tol <= speed A + alpha A * duration A <= Rmax (speed_max L) v0 + tol.
Proof.
  intros l h pos; revert low high before l h.
  induction arcs as [|B rest IH]; simpl; intros low high before l h prior pass meet member; [contradiction|].
  destruct pass as [this others]; destruct meet as [join joins]; destruct member as [here | later]; cycle 1.
  - apply (IH (Rmax low (speed B)) (Rmin high (speed B)) (speed B + alpha B * duration B)); try assumption.
    + generalize (Rmax_l low (speed B)); lra.
    + generalize (Rmin_l high (speed B)); lra.
    + assert (Rmin (speed_min L) v0 <= Rmin (speed_min L) (Rmax low (speed B))).
      { apply Rle_min_compat_l; generalize (Rmax_l low (speed B)); lra. }
      assert (Rmax (speed_max L) (Rmin high (speed B)) <= Rmax (speed_max L) v0).
      { apply Rle_max_compat_l; generalize (Rmin_l high (speed B)); lra. }
      lra.
  - subst B.
    assert (Rmin (speed_min L) v0 <= Rmin (speed_min L) (Rmax low (speed A))).
    { apply Rle_min_compat_l; generalize (Rmax_l low (speed A)); lra. }
    assert (Rmax (speed_max L) (Rmin high (speed A)) <= Rmax (speed_max L) v0).
    { apply Rle_max_compat_l; generalize (Rmin_l high (speed A)); lra. }
    unfold Rabs in join; destruct (Rcase_abs (speed A - before)); lra.
Qed.

(* ---- the theorem ---- *)

Record checked (r : requirement) (L : limits) (T : tolerance) (slack position_error eps horizon : R)
    (own_x0 own_y0 own_speed : R) (arcs : list arc) (traffic : list intruder) (areas : list area) : Prop := {
  sigmas_pos : 0 <= sigmas r;
  tolerances : 0 <= tol_speed T;
  forwards : forall A, In A arcs -> 0 <= speed A /\ 0 <= speed A + alpha A * duration A;
  no_gap : joined 0 arcs horizon;
  some : 0 < horizon;
  speeds_kept : speeds L (tol_speed T) own_speed own_speed arcs;
  speeds_met : speeds_join slack own_speed arcs;
  gentle : forall A, In A arcs -> acc_min L - tol_acc T <= alpha A <= acc_max L + tol_acc T;
  turning : forall A, In A arcs -> Rabs (omega A) <= rate_max L + tol_rate T;
  parts_pass : forall A i, In A arcs -> In i traffic -> exists ends,
    parts (fun b e => counts i b e -> passes r A i (norm (ix i - own_x0) (iy i - own_y0)) position_error eps b e)
      (begin A) ends (begin A + duration A);
  whole : forall z, In z areas -> well_formed (ashape z);
  starts : forall z s, In z areas -> clear_of z own_x0 own_y0 0 s -> s <= astart z;
  areas_pass : forall A z, In A arcs -> In z areas -> exists ends,
    parts (fun b e => afrom z <= e /\ b <= auntil z -> area_passes r A z position_error eps b e)
      (begin A) ends (begin A + duration A)
}.

Theorem safe r L T slack position_error eps horizon own_x0 own_y0 own_speed arcs traffic areas :
  checked r L T slack position_error eps horizon own_x0 own_y0 own_speed arcs traffic areas ->
  forall t, 0 <= t <= horizon ->
  (exists A, In A arcs /\ during A t) /\
  forall A, In A arcs -> during A t ->
    (forall i, In i traffic -> ifrom i <= t <= iuntil i ->
      let away := norm (ix i - own_x0) (iy i - own_y0) in
      iseparation i - ROUNDING - eps <= distance A i t /\
      need r i away t - CLOSE - eps <= distance A i t) /\
    (forall z start, In z areas -> afrom z <= t <= auntil z -> clear_of z own_x0 own_y0 0 start ->
      clear_of z (own_px A t) (own_py A t) t (area_required r z start - eps)) /\
    Rmin (speed_min L) own_speed - tol_speed T - slack <= speed A + alpha A * (t - begin A)
      <= Rmax (speed_max L) own_speed + tol_speed T + slack /\
    acc_min L - tol_acc T <= alpha A <= acc_max L + tol_acc T /\
    Rabs (omega A) <= rate_max L + tol_rate T.
Proof.
  intros C t inside; split; [apply (arcs_cover 0 arcs horizon); destruct C; assumption|].
  intros A member now.
  destruct (joined_begins 0 arcs horizon A (no_gap _ _ _ _ _ _ _ _ _ _ _ _ _ C) member) as [begun long].
  assert (bounds : Rmin (speed_min L) own_speed - tol_speed T <= own_speed <= Rmax (speed_max L) own_speed + tol_speed T).
  { generalize (Rmin_r (speed_min L) own_speed) (Rmax_r (speed_max L) own_speed) (tolerances _ _ _ _ _ _ _ _ _ _ _ _ _ C).
    lra. }
  destruct (speeds_ends L (tol_speed T) slack own_speed own_speed own_speed own_speed arcs A) as [one two];
    try (destruct C; assumption); try lra.
  destruct (forwards _ _ _ _ _ _ _ _ _ _ _ _ _ C A member) as [forward forward_end].
  assert (slack_pos : 0 <= slack).
  { destruct arcs as [|B rest]; [destruct member|].
    destruct (speeds_met _ _ _ _ _ _ _ _ _ _ _ _ _ C) as [join _].
    generalize (Rabs_pos (speed B - own_speed)); lra. }
  split; [|split; [|split; [|split]]].
  - intros i member_k meant away.
    destruct (parts_pass _ _ _ _ _ _ _ _ _ _ _ _ _ C A i member member_k) as [ends pass].
    destruct (parts_cover _ _ _ _ t pass) as [b [e [from [order [until [at_ test]]]]]]; [lra|exact now|].
    assert (enough := part_safe r A i away position_error eps b e t (sigmas_pos _ _ _ _ _ _ _ _ _ _ _ _ _ C)).
    assert (kept : required_at r i away t - eps <= distance A i t).
    { apply enough; try assumption; try lra; apply test; unfold counts; lra. }
    generalize (owes_separation r i away t) (owes_need r i away t); lra.
  - intros z start member_z meant begun_.
    destruct (areas_pass _ _ _ _ _ _ _ _ _ _ _ _ _ C A z member member_z) as [ends pass].
    destruct (parts_cover _ _ _ _ t pass) as [b [e [from [order [until [at_ test]]]]]]; [lra|exact now|].
    assert (kept : clear_of z (own_px A t) (own_py A t) t (area_required r z (astart z) - eps)).
    { apply (area_part_safe r A z position_error eps b e); try assumption; try lra.
      - apply (whole _ _ _ _ _ _ _ _ _ _ _ _ _ C); assumption.
      - apply test; lra. }
    unfold clear_of in *; apply keeps_less with (2 := kept).
    assert (more := area_required_monotone r z start (astart z) (starts _ _ _ _ _ _ _ _ _ _ _ _ _ C z start member_z begun_)).
    lra.
  - unfold during in now.
    set (u := t - begin A).
    assert (u_in : 0 <= u <= duration A) by (unfold u; lra).
    destruct (Rle_dec 0 (alpha A)); split; nra.
  - apply (gentle _ _ _ _ _ _ _ _ _ _ _ _ _ C); assumption.
  - apply (turning _ _ _ _ _ _ _ _ _ _ _ _ _ C); assumption.
Qed.

(* ---- a report of some age and the intruder at the request fly the same ---- *)

Definition advanced_lasts (lasts age : R) : R := Rmax (lasts - age) 0.

Lemma advanced_course p w lasts age t :
  0 <= t -> course (course p w lasts age) w (advanced_lasts lasts age) t = course p w lasts (t + age).
Proof.
  intros; unfold course, advanced_lasts.
  rewrite Rplus_assoc, <- Rmult_plus_distr_l; do 2 f_equal.
  unfold Rmin, Rmax.
  destruct (Rle_dec age lasts); destruct (Rle_dec (lasts - age) 0); destruct (Rle_dec t _);
    destruct (Rle_dec (t + age) lasts); lra.
Qed.

Theorem advanced_x x p v w lasts age t :
  0 <= t ->
  other_x (other_x x p v w lasts age) (course p w lasts age) v w (advanced_lasts lasts age) t
  = other_x x p v w lasts (t + age).
Proof.
  intros later; unfold other_x at 1 3; unfold other_x, travelled.
  rewrite Rplus_assoc; f_equal.
  rewrite <- (RInt_Chasles (other_vx p v w lasts) 0 age (t + age));
    try (apply @ex_RInt_continuous; intros; apply other_vx_continuous).
  unfold plus; simpl; f_equal.
  assert (shift := RInt_comp_lin (other_vx p v w lasts) 1 age 0 t).
  rewrite Rmult_0_r, Rplus_0_l, Rmult_1_l in shift.
  rewrite <- shift.
  2: { apply @ex_RInt_continuous; intros; apply other_vx_continuous. }
  apply RInt_ext; intros u between; rewrite Rmin_left, Rmax_right in between by lra.
  unfold scal; simpl; unfold mult; simpl; rewrite !Rmult_1_l.
  unfold other_vx; rewrite advanced_course by lra; reflexivity.
Qed.

Theorem advanced_y y p v w lasts age t :
  0 <= t ->
  other_y (other_y y p v w lasts age) (course p w lasts age) v w (advanced_lasts lasts age) t
  = other_y y p v w lasts (t + age).
Proof.
  intros later; unfold other_y at 1 3; unfold other_y, travelled.
  rewrite Rplus_assoc; f_equal.
  rewrite <- (RInt_Chasles (other_vy p v w lasts) 0 age (t + age));
    try (apply @ex_RInt_continuous; intros; apply other_vy_continuous).
  unfold plus; simpl; f_equal.
  assert (shift := RInt_comp_lin (other_vy p v w lasts) 1 age 0 t).
  rewrite Rmult_0_r, Rplus_0_l, Rmult_1_l in shift.
  rewrite <- shift.
  2: { apply @ex_RInt_continuous; intros; apply other_vy_continuous. }
  apply RInt_ext; intros u between; rewrite Rmin_left, Rmax_right in between by lra.
  unfold scal; simpl; unfold mult; simpl; rewrite !Rmult_1_l.
  unfold other_vy; rewrite advanced_course by lra; reflexivity.
Qed.
