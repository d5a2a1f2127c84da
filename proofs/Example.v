(* The hypotheses of the theorems can be met: a straight plan of ten seconds beside an intruder on a parallel course and
   a disc to be kept out of. And in space: the intruder counts for five seconds, then the plan is below it. *)

From Coq Require Import Reals Lra Psatz List.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Bound Motion Signed Constants Level Climb Safe Space.
Import ListNotations.
Open Scope R_scope.

Definition A : arc := Arc 0 10 0 0 0 80 0 0.
Definition i : intruder := Intruder 0 3000 0 80 0 0 0 0 0 1000 0 10.
Definition z : area := Region (Disc 0 (-5000) 1000) true 0 0 0 100 4000 0 10.
Definition r : requirement := Requirement 0 0.
Definition L : limits := Limits 30 100 (-1) 1 (1 / 10).
Definition T : tolerance := Tolerance 0 0 0.

Lemma own_straight t : own_px A t = 80 * t /\ own_py A t = 0.
Proof.
  unfold own_px, own_py, own_x, own_y, travelled; simpl.
  rewrite (RInt_ext _ (fun _ => 80)), (RInt_ext (own_vy _ _ _ _) (fun _ => 0)).
  - rewrite !RInt_const; unfold scal; simpl; unfold mult; simpl; split; ring.
  - intros; unfold own_vy; rewrite Rmult_0_l, Rplus_0_l, sin_0; apply Rmult_0_r.
  - intros; unfold own_vx; rewrite !Rmult_0_l, !Rplus_0_r, cos_0; apply Rmult_1_r.
Qed.

Lemma other_straight t : other_px i t = 80 * t /\ other_py i t = 3000.
Proof.
  unfold other_px, other_py, other_x, other_y, travelled; simpl.
  rewrite (RInt_ext _ (fun _ => 80)), (RInt_ext (other_vy _ _ _ _) (fun _ => 0)).
  - rewrite !RInt_const; unfold scal; simpl; unfold mult; simpl; split; ring.
  - intros; unfold other_vy, course; rewrite Rmult_0_l, Rplus_0_l, sin_0; apply Rmult_0_r.
  - intros; unfold other_vx, course; rewrite Rmult_0_l, Rplus_0_r, cos_0; apply Rmult_1_r.
Qed.

Lemma axis x y : 0 <= y -> x = 0 -> norm x y = y.
Proof. intros pos zero; unfold norm; rewrite zero, Rmult_0_l, Rplus_0_l; apply sqrt_square; assumption. Qed.

Theorem example : checked r L T 0 0 0 10 0 0 80 [A] [i] [z].
Proof.
  constructor; simpl.
  - lra.
  - lra.
  - intros B [here | []]; subst B; simpl; lra.
  - unfold during; simpl; lra.
  - lra.
  - split; [|exact I]; unfold Rmin, Rmax; repeat destruct (Rle_dec _ _); lra.
  - split; [|exact I]; replace (80 - 80) with 0 by ring; rewrite Rabs_R0; lra.
  - intros B [here | []]; subst B; simpl; lra.
  - intros B [here | []]; subst B; simpl; rewrite Rabs_R0; lra.
  - intros B j [here | []] [there | []]; subst B j; simpl.
    exists [10]; simpl; repeat split; try lra; intros _.
    destruct (own_straight 0) as [x0 y0]; destruct (own_straight 10) as [x1 y1].
    destruct (other_straight 0) as [u0 v0]; destruct (other_straight 10) as [u1 v1].
    exists (own_px A 0), (own_py A 0), (own_px A 10), (own_py A 10).
    exists (sagitta (relative_acceleration A i) (10 - 0)).
    exists (norm (other_px i 0 - own_px A 0) (other_py i 0 - own_py A 0)
      - norm (other_px i 10 - own_px A 10 - (other_px i 0 - own_px A 0))
          (other_py i 10 - own_py A 10 - (other_py i 0 - own_py A 0)) - sagitta (relative_acceleration A i) (10 - 0)).
    assert (self : forall x y, norm (x - x) (y - y) = 0).
    { intros x y; replace (x - x) with 0 by ring; replace (y - y) with 0 by ring; apply norm_zero. }
    rewrite !self; repeat split; try lra; [apply by_reach|].
    rewrite x0, y0, x1, y1, u0, v0, u1, v1.
    rewrite (axis (80 * 0 - 80 * 0)), (axis (80 * 10 - 80 * 10 - (80 * 0 - 80 * 0))) by lra.
    assert (small : sagitta (relative_acceleration A i) (10 - 0) <= 1).
    { unfold sagitta, relative_acceleration, other_acceleration, own_acceleration, quickest; simpl.
      destruct (Rlt_dec 0 0); [lra|].
      rewrite Rmult_0_r, norm_zero; unfold TINY, Rmax; destruct (Rle_dec _ _); lra. }
    unfold required_at, required_with_tolerance, need, at_request, required, growth; simpl.
    destruct (Rlt_dec 0 0); [lra|].
    rewrite !Rmult_0_l, !Rplus_0_r.
    assert (away : norm (0 - 0) (3000 - 0) = 3000).
    { replace (3000 - 0) with 3000 by ring; apply axis; lra. }
    rewrite away; unfold CLOSE, ROUNDING, Rmax, Rmin; repeat destruct (Rle_dec _ _); lra.
  - intros y [here | []]; subst y; exact I.
  - intros y s [here | []]; subst y; unfold clear_of; simpl.
    rewrite !Rmult_0_r, !Rminus_0_r, Rplus_0_l || idtac.
    replace (0 - 0 * 0 - 0) with 0 by ring.
    replace (0 - 0 * 0 - -5000) with 5000 by ring.
    rewrite (axis 0 5000) by lra; lra.
  - intros B y [here | []] [there | []]; subst B y.
    exists [10]; simpl; repeat split; try lra; intros _.
    destruct (own_straight 0) as [x0 y0]; destruct (own_straight 10) as [x1 y1].
    exists (own_px A 0), (own_py A 0), (own_px A 10), (own_py A 10), ((4000 + 4000 - norm (-800) 0) / 2).
    assert (self : forall x y, norm (x - x) (y - y) = 0).
    { intros x y; replace (x - x) with 0 by ring; replace (y - y) with 0 by ring; apply norm_zero. }
    rewrite !self; split; [lra|split; [lra|split]].
    + rewrite x0, y0, x1, y1; simpl.
      replace (norm (-800) 0) with (norm (80 * 0 - 0 * 0 - (80 * 10 - 0 * 10)) (0 - 0 * 0 - (0 - 0 * 10)))
        by (unfold norm; f_equal; ring).
      apply by_ends; simpl.
      * replace (80 * 0 - 0 * 0 - 0) with 0 by ring; replace (0 - 0 * 0 - -5000) with 5000 by ring.
        rewrite (axis 0 5000) by lra; lra.
      * replace (80 * 10 - 0 * 10 - 0) with 800 by ring; replace (0 - 0 * 10 - -5000) with 5000 by ring.
        enough (5000 <= norm 800 5000) by lra; apply le_norm; lra.
    + assert (straight : area_sagitta (own_acceleration (speed A) (omega A) (alpha A) (duration A)) (10 - 0) = 0).
      { unfold area_sagitta, own_acceleration; simpl; rewrite Rmult_0_r, norm_zero; field. }
      rewrite straight; unfold area_required, area_need_with_tolerance, area_need, gain; simpl.
      assert (way : norm (-800) 0 <= 800) by (apply norm_le; lra).
      destruct (Rlt_dec 0 0); [lra|].
      unfold CLOSE, ROUNDING, NEARER, Rmax, Rmin; repeat destruct (Rle_dec _ _); lra.
Qed.

(* ---- in space ---- *)

Definition descent : profile := Profile 10 1000 0 [Corner 1 (-20)] 5 0.
Definition level : altitude := Altitude 1000 0 0 0 50.

Lemma parts_weaker (P Q : R -> R -> Prop) b ends last :
  (forall c e, P c e -> Q c e) -> parts P b ends last -> parts Q b ends last.
Proof.
  intros weaker; revert b; induction ends as [|e rest IH]; simpl; intros b pass; [assumption|].
  destruct pass as [order [until [test others]]]; repeat split; auto.
Qed.

Theorem example_in_space :
  let traffic := [counting i (0, 5)] in
  checked r L T 0 0 0 10 0 0 80 [A] traffic [z] /\
  flyable descent /\ follows descent (flown 10 1000 0 [Corner 1 (-20)]) 10 /\
  within_altitude level (fun _ => 1000) 10 /\ covers descent i level traffic 10.
Proof.
  intros traffic; split; [|split; [|split; [|split]]].
  - assert (passing := parts_pass _ _ _ _ _ _ _ _ _ _ _ _ _ example).
    destruct example; constructor; try assumption.
    intros B j here [there | []]; subst j.
    destruct (passing B i here (or_introl eq_refl)) as [ends pass].
    exists ends; apply parts_weaker with (2 := pass).
    intros c e test [from until]; apply test; unfold counts; simpl in *; lra.
  - assert (second : Rabs (-20) / (2 * 10) = 1) by (rewrite Rabs_left by lra; field).
    constructor; simpl; [lra|lra| |].
    + split; [|exact I]; rewrite Rabs_R0, Rplus_0_l; lra.
    + intros k [here | []]; subst k; unfold rounding; simpl; lra.
  - intros t _; simpl; unfold Rminus; rewrite Rplus_opp_r, Rabs_R0; lra.
  - intros t _; simpl; replace (1000 - (1000 + 0 * t)) with 0 by ring; rewrite Rabs_R0; lra.
  - exists [(0, 5); (5, 10)]; split.
    + simpl; split; [lra|right; split; [apply Rmax_r|left; lra]].
    + intros w [here | [here | []]]; subst w; [left; left; reflexivity|right].
      exists 1, (Piece 5 10 1020 (-20)); split; [reflexivity|].
      unfold apart_in, apart_on, apart_at, own_error; simpl; repeat split; try (left; reflexivity); try lra.
      exists [Corner 1 (-20)], []; simpl; repeat split; try lra; intros k; [|intros []].
      intros [here | []]; subst k; simpl; lra.
Qed.
