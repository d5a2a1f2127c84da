(* The lower bound of the distance in a part of the flight, as agents/kernel/chords.py computes it (chord_of), and
   the four simpler ones of agents/check/chord.py. (x0, y0) and (x1, y1): the relative position at the part's beginning and
   end; sagitta: a h^2 / 8. A test translates the definitions of this file and compares them with the code. *)

From Coq Require Import Reals Lra Psatz.
Require Import Vectors.
Open Scope R_scope.

Definition TINY : R := 1 / 1000000000000.
(* Squares of relative motions below this, m^2, count as this. *)

Definition share (x0 y0 x1 y1 : R) : R :=
  Rmin (Rmax (- (x0 * (x1 - x0) + y0 * (y1 - y0)) / Rmax ((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0)) TINY) 0) 1.

Definition nearest (x0 y0 x1 y1 : R) : R :=
  norm (x0 + share x0 y0 x1 y1 * (x1 - x0)) (y0 + share x0 y0 x1 y1 * (y1 - y0)).

Definition opening (x0 y0 x1 y1 : R) : R :=
  if Rle_dec 1 (share x0 y0 x1 y1)
  then - (x1 * (x1 - x0) + y1 * (y1 - y0)) / Rmax (norm x1 y1) (1 / 1000000000)
  else if Rle_dec (share x0 y0 x1 y1) 0
  then (x0 * (x1 - x0) + y0 * (y1 - y0)) / Rmax (norm x0 y0) (1 / 1000000000)
  else 0.

Definition loss (sagitta open : R) : R :=
  Rmax (4 * sagitta - Rmax open 0) 0 * Rmax (4 * sagitta - Rmax open 0) 0 / (16 * sagitta).

Definition bound (x0 y0 x1 y1 sagitta : R) : R :=
  nearest x0 y0 x1 y1 - loss sagitta (opening x0 y0 x1 y1).

(* The chord's point a share s of the way. *)
Definition on_x (x0 x1 s : R) : R := x0 + s * (x1 - x0).

Lemma loss_pos sagitta open : 0 < sagitta -> 0 <= loss sagitta open.
Proof.
  intros; unfold loss; set (m := Rmax _ 0).
  apply Rmult_le_pos; [apply Rmult_le_pos; apply Rmax_r|].
  left; apply Rinv_0_lt_compat; lra.
Qed.

(* Along a chord that opens by g at least, what the sagitta takes is at most the loss. *)
Lemma loss_enough sagitta g s :
  0 < sagitta -> 0 <= s <= 1 -> - loss sagitta g <= Rmax g 0 * s - 4 * sagitta * s * (1 - s).
Proof.
  intros pos inside; unfold loss.
  assert (0 <= Rmax g 0) by apply Rmax_r.
  set (o := Rmax g 0) in *.
  destruct (Rle_dec 0 (4 * sagitta - o)).
  - rewrite (Rmax_left (4 * sagitta - o) 0) by assumption.
    apply Rmult_le_reg_l with (16 * sagitta); [lra|].
    replace (16 * sagitta * - ((4 * sagitta - o) * (4 * sagitta - o) / (16 * sagitta)))
      with (- ((4 * sagitta - o) * (4 * sagitta - o))) by (field; lra).
    generalize (Rle_0_sqr (8 * sagitta * s - (4 * sagitta - o))); unfold Rsqr; nra.
  - rewrite (Rmax_right (4 * sagitta - o) 0) by lra.
    replace (- (0 * 0 / (16 * sagitta))) with 0 by (field; lra).
    assert (0 <= s * (o - 4 * sagitta)) by (apply Rmult_le_pos; lra).
    assert (0 <= sagitta * (s * s)) by (apply Rmult_le_pos; [lra|nra]).
    lra.
Qed.

Lemma loss_sagitta sagitta g s :
  0 < sagitta -> 0 <= s <= 1 -> g <= 0 -> 4 * sagitta * s * (1 - s) <= loss sagitta g.
Proof.
  intros pos inside small.
  generalize (loss_enough sagitta g s pos inside).
  rewrite Rmax_right by assumption; lra.
Qed.

Lemma loss_monotone sagitta g h : 0 < sagitta -> g <= h -> loss sagitta h <= loss sagitta g.
Proof.
  intros pos order; unfold loss.
  assert (Rmax g 0 <= Rmax h 0) by (apply Rle_max_compat_r; assumption).
  assert (Rmax (4 * sagitta - Rmax h 0) 0 <= Rmax (4 * sagitta - Rmax g 0) 0) by (apply Rle_max_compat_r; lra).
  assert (0 <= Rmax (4 * sagitta - Rmax h 0) 0) by apply Rmax_r.
  apply Rmult_le_compat_r; [left; apply Rinv_0_lt_compat; lra|].
  apply Rmult_le_compat; assumption.
Qed.

(* From an end of the chord at which it does not approach, it opens by its projection. *)
Lemma opens x y dx dy s g :
  0 <= s -> 0 < norm x y -> g <= (x * dx + y * dy) / norm x y ->
  norm x y + g * s <= norm (x + s * dx) (y + s * dy).
Proof.
  intros pos far projection.
  assert (square := norm_square x y).
  generalize (dot_le_norm x y (x + s * dx) (y + s * dy)); intros cauchy.
  assert (g * norm x y <= x * dx + y * dy).
  { replace (x * dx + y * dy) with ((x * dx + y * dy) / norm x y * norm x y) by (field; lra).
    apply Rmult_le_compat_r; lra. }
  apply Rmult_le_reg_l with (norm x y); [assumption|].
  assert (s * (g * norm x y) <= s * (x * dx + y * dy)) by (apply Rmult_le_compat_l; assumption).
  nra.
Qed.

Lemma guarded_opening d m : 0 <= d -> 0 < m -> d / Rmax m (1 / 1000000000) <= d / m.
Proof.
  intros; apply Rmult_le_compat_l; [assumption|].
  apply Rinv_le_contravar; [assumption|apply Rmax_l].
Qed.

Lemma share_inside x0 y0 x1 y1 : 0 <= share x0 y0 x1 y1 <= 1.
Proof.
  unfold share; split; [apply Rmin_glb; [apply Rmax_r|lra]|apply Rmin_r].
Qed.

(* How far the code's nearest point of the chord can be from being nearest: only where the relative motion in the part
   is below a micrometre. *)
Definition DEGENERATE : R := 1 / 1000000.

Lemma TINY_square : DEGENERATE * DEGENERATE = TINY.
Proof. unfold DEGENERATE, TINY; field. Qed.

Lemma nearest_is_nearest x0 y0 x1 y1 s :
  0 <= s <= 1 -> nearest x0 y0 x1 y1 - DEGENERATE <= norm (on_x x0 x1 s) (on_x y0 y1 s).
Proof.
  intros inside; unfold on_x, nearest.
  assert (within := share_inside x0 y0 x1 y1).
  set (c := share x0 y0 x1 y1) in *.
  set (dx := x1 - x0) in *; set (dy := y1 - y0) in *.
  destruct (Rle_dec TINY (dx * dx + dy * dy)) as [long | short].
  - (* the exact minimum of a square *)
    enough (norm (x0 + c * dx) (y0 + c * dy) <= norm (x0 + s * dx) (y0 + s * dy)).
    { assert (0 < DEGENERATE) by (unfold DEGENERATE; lra); lra. }
    apply norm_le; [apply norm_pos|]; rewrite norm_square.
    assert (0 < TINY) by (unfold TINY; lra).
    set (q := dx * dx + dy * dy) in *; set (p := x0 * dx + y0 * dy).
    enough (c * (c * q + 2 * p) <= s * (s * q + 2 * p)) by (unfold p, q in *; nra).
    assert (exact : c = Rmin (Rmax (- p / q) 0) 1).
    { unfold c, share; fold dx dy; fold p q; rewrite (Rmax_left q TINY) by assumption; reflexivity. }
    assert (quotient : - p / q * q = - p) by (field; lra).
    set (z := - p / q) in *.
    assert (choice : (c - z) * (c - z) <= (s - z) * (s - z)).
    { rewrite exact; unfold Rmin, Rmax.
      generalize (Rle_0_sqr (s - z)); unfold Rsqr; intros.
      destruct (Rle_dec z 0); [destruct (Rle_dec 0 1); nra|destruct (Rle_dec z 1)].
      - replace (z - z) with 0 by ring; lra.
      - assert (0 <= (1 - s) * (2 * z - s - 1)) by (apply Rmult_le_pos; lra); nra. }
    replace p with (- (z * q)) by lra.
    assert (0 <= q * ((s - z) * (s - z) - (c - z) * (c - z))) by (apply Rmult_le_pos; lra).
    nra.
  - apply norm_near.
    replace (x0 + s * dx - (x0 + c * dx)) with ((s - c) * dx) by ring.
    replace (y0 + s * dy - (y0 + c * dy)) with ((s - c) * dy) by ring.
    apply norm_le; [unfold DEGENERATE; lra|].
    rewrite TINY_square.
    assert ((s - c) * (s - c) <= 1) by nra.
    assert (0 <= dx * dx + dy * dy) by nra.
    nra.
Qed.

(* What lies at most the sagitta of a share s from the chord is at least the bound away. *)
Theorem bound_sound x0 y0 x1 y1 sagitta s px py :
  0 < sagitta -> 0 <= s <= 1 ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * sagitta * s * (1 - s) ->
  bound x0 y0 x1 y1 sagitta - DEGENERATE <= norm px py.
Proof.
  intros pos inside close.
  assert (away := norm_near _ _ _ _ _ close).
  enough (bound x0 y0 x1 y1 sagitta - DEGENERATE <= norm (on_x x0 x1 s) (on_x y0 y1 s) - 4 * sagitta * s * (1 - s)) by lra.
  assert (near := nearest_is_nearest x0 y0 x1 y1 s inside).
  assert (small : 0 < DEGENERATE) by (unfold DEGENERATE; lra).
  unfold bound.
  set (g := opening x0 y0 x1 y1).
  destruct (Rle_dec g 0) as [closing | open].
  { generalize (loss_sagitta sagitta g s pos inside closing); lra. }
  assert (0 < TINY) by (unfold TINY; lra).
  assert (within := share_inside x0 y0 x1 y1).
  assert (start : share x0 y0 x1 y1 <= 0 -> nearest x0 y0 x1 y1 = norm x0 y0).
  { intros; unfold nearest; replace (share x0 y0 x1 y1) with 0 by lra; f_equal; ring. }
  assert (finish : 1 <= share x0 y0 x1 y1 -> nearest x0 y0 x1 y1 = norm x1 y1).
  { intros; unfold nearest; replace (share x0 y0 x1 y1) with 1 by lra; f_equal; ring. }
  assert (guard : forall d m, 0 < d / Rmax m (1 / 1000000000) -> 0 < d).
  { intros d m positive; apply Rnot_le_lt; intros negative.
    assert (0 < Rmax m (1 / 1000000000)) by (generalize (Rmax_r m (1 / 1000000000)); lra).
    assert (0 < / Rmax m (1 / 1000000000)) by (apply Rinv_0_lt_compat; assumption).
    unfold Rdiv in positive; nra. }
  assert (zero : forall x y dx dy, 0 < x * dx + y * dy -> 0 < norm x y).
  { intros x y dx dy positive; destruct (Req_dec (norm x y) 0) as [none | some].
    - generalize (dot_le_norm x y dx dy); rewrite none; lra.
    - generalize (norm_pos x y); lra. }
  unfold on_x in *; unfold g, opening in *.
  destruct (Rle_dec 1 (share x0 y0 x1 y1)) as [last | notlast];
    [|destruct (Rle_dec (share x0 y0 x1 y1) 0) as [first | notfirst]; [|lra]].
  - rewrite finish by assumption.
    set (o := - (x1 * (x1 - x0) + y1 * (y1 - y0)) / Rmax (norm x1 y1) (1 / 1000000000)) in *.
    assert (positive : 0 < - (x1 * (x1 - x0) + y1 * (y1 - y0))) by (apply guard with (norm x1 y1); fold o; lra).
    assert (0 < norm x1 y1) by (apply zero with (x0 - x1) (y0 - y1); lra).
    assert (grow := opens x1 y1 (x0 - x1) (y0 - y1) (1 - s) o).
    replace (x1 + (1 - s) * (x0 - x1)) with (x0 + s * (x1 - x0)) in grow by ring.
    replace (y1 + (1 - s) * (y0 - y1)) with (y0 + s * (y1 - y0)) in grow by ring.
    assert (0 <= 1 - s <= 1) as other by lra.
    generalize (loss_enough sagitta o (1 - s) pos other); rewrite (Rmax_left o 0) by lra.
    enough (o <= (x1 * (x0 - x1) + y1 * (y0 - y1)) / norm x1 y1) by lra.
    replace (x1 * (x0 - x1) + y1 * (y0 - y1)) with (- (x1 * (x1 - x0) + y1 * (y1 - y0))) by ring.
    apply guarded_opening; lra.
  - rewrite start by assumption.
    set (o := (x0 * (x1 - x0) + y0 * (y1 - y0)) / Rmax (norm x0 y0) (1 / 1000000000)) in *.
    assert (positive : 0 < x0 * (x1 - x0) + y0 * (y1 - y0)) by (apply guard with (norm x0 y0); fold o; lra).
    assert (0 < norm x0 y0) by (apply zero with (x1 - x0) (y1 - y0); lra).
    assert (grow := opens x0 y0 (x1 - x0) (y1 - y0) s o).
    generalize (loss_enough sagitta o s pos inside); rewrite (Rmax_left o 0) by lra.
    enough (o <= (x0 * (x1 - x0) + y0 * (y1 - y0)) / norm x0 y0) by lra.
    apply guarded_opening; lra.
Qed.

(* The checker's bounds: from an end at which the range opens, from the line through both, and from how far one gets. *)
Definition cross_bound (x0 y0 x1 y1 sagitta : R) : R :=
  Rabs (x0 * (y1 - y0) - y0 * (x1 - x0)) / norm (x1 - x0) (y1 - y0) - sagitta.

Theorem start_sound x0 y0 x1 y1 sagitta s px py :
  0 < sagitta -> 0 <= s <= 1 -> 0 < norm x0 y0 ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * sagitta * s * (1 - s) ->
  forall g, 0 <= g -> g <= (x0 * (x1 - x0) + y0 * (y1 - y0)) / norm x0 y0 -> norm x0 y0 - loss sagitta g <= norm px py.
Proof.
  intros pos inside far close g open projection.
  assert (away := norm_near _ _ _ _ _ close).
  assert (grow := opens x0 y0 (x1 - x0) (y1 - y0) s g).
  generalize (loss_enough sagitta g s pos inside); rewrite (Rmax_left g 0) by assumption.
  unfold on_x in away; lra.
Qed.

Theorem end_sound x0 y0 x1 y1 sagitta s px py :
  0 < sagitta -> 0 <= s <= 1 -> 0 < norm x1 y1 ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * sagitta * s * (1 - s) ->
  forall g, 0 <= g -> g <= (x1 * (x0 - x1) + y1 * (y0 - y1)) / norm x1 y1 -> norm x1 y1 - loss sagitta g <= norm px py.
Proof.
  intros pos inside far close g open projection.
  apply (start_sound x1 y1 x0 y0 sagitta (1 - s) px py pos); try assumption; [lra|].
  replace (on_x x1 x0 (1 - s)) with (on_x x0 x1 s) by (unfold on_x; ring).
  replace (on_x y1 y0 (1 - s)) with (on_x y0 y1 s) by (unfold on_x; ring).
  lra.
Qed.

Theorem cross_sound x0 y0 x1 y1 sagitta s px py :
  0 < sagitta -> 0 <= s <= 1 -> 0 < norm (x1 - x0) (y1 - y0) ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * sagitta * s * (1 - s) ->
  cross_bound x0 y0 x1 y1 sagitta <= norm px py.
Proof.
  intros pos inside far close.
  assert (away := norm_near _ _ _ _ _ close).
  assert (4 * sagitta * s * (1 - s) <= sagitta).
  { generalize (Rle_0_sqr (2 * s - 1)); unfold Rsqr; nra. }
  unfold cross_bound, on_x in *.
  set (dx := x1 - x0) in *; set (dy := y1 - y0) in *.
  enough (Rabs (x0 * dy - y0 * dx) <= norm dx dy * norm (x0 + s * dx) (y0 + s * dy)).
  { assert (Rabs (x0 * dy - y0 * dx) / norm dx dy <= norm (x0 + s * dx) (y0 + s * dy)).
    { apply Rmult_le_reg_l with (norm dx dy); [assumption|].
      replace (norm dx dy * (Rabs (x0 * dy - y0 * dx) / norm dx dy)) with (Rabs (x0 * dy - y0 * dx)) by (field; lra).
      assumption. }
    lra. }
  assert (flip : norm (- dy) dx = norm dx dy) by (unfold norm; f_equal; ring).
  assert (one := dot_le_norm (- dy) dx (x0 + s * dx) (y0 + s * dy)).
  assert (two := dot_le_norm (- dy) dx (- (x0 + s * dx)) (- (y0 + s * dy))).
  rewrite norm_opp in two; rewrite flip in one, two.
  apply Rabs_le; nra.
Qed.

Theorem reach_sound x0 y0 x1 y1 sagitta s px py :
  0 < sagitta -> 0 <= s <= 1 ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * sagitta * s * (1 - s) ->
  norm x0 y0 - norm (x1 - x0) (y1 - y0) - sagitta <= norm px py.
Proof.
  intros pos inside close.
  assert (away := norm_near _ _ _ _ _ close).
  assert (4 * sagitta * s * (1 - s) <= sagitta).
  { generalize (Rle_0_sqr (2 * s - 1)); unfold Rsqr; nra. }
  enough (norm x0 y0 - norm (x1 - x0) (y1 - y0) <= norm (on_x x0 x1 s) (on_x y0 y1 s)) by lra.
  apply norm_near; unfold on_x.
  replace (x0 + s * (x1 - x0) - x0) with (s * (x1 - x0)) by ring.
  replace (y0 + s * (y1 - y0) - y0) with (s * (y1 - y0)) by ring.
  rewrite norm_scale by lra.
  generalize (norm_pos (x1 - x0) (y1 - y0)); nra.
Qed.

Theorem reach_sound_end x0 y0 x1 y1 sagitta s px py :
  0 < sagitta -> 0 <= s <= 1 ->
  norm (px - on_x x0 x1 s) (py - on_x y0 y1 s) <= 4 * sagitta * s * (1 - s) ->
  norm x1 y1 - norm (x1 - x0) (y1 - y0) - sagitta <= norm px py.
Proof.
  intros pos inside close.
  generalize (reach_sound x1 y1 x0 y0 sagitta (1 - s) px py pos).
  replace (on_x x1 x0 (1 - s)) with (on_x x0 x1 s) by (unfold on_x; ring).
  replace (on_x y1 y0 (1 - s)) with (on_x y0 y1 s) by (unfold on_x; ring).
  replace (norm (x0 - x1) (y0 - y1)) with (norm (x1 - x0) (y1 - y0)) by (unfold norm; f_equal; ring).
  intros other; apply other; lra.
Qed.
