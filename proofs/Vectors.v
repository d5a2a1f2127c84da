(* Vectors of the plane as pairs of real numbers: length, projections, triangle. *)

From Coq Require Import Reals Lra Psatz.
Open Scope R_scope.

Definition norm (x y : R) : R := sqrt (x * x + y * y).

Lemma squares_pos x y : 0 <= x * x + y * y.
Proof. nra. Qed.

Lemma norm_pos x y : 0 <= norm x y.
Proof. apply sqrt_pos. Qed.

Lemma norm_square x y : norm x y * norm x y = x * x + y * y.
Proof. apply sqrt_sqrt, squares_pos. Qed.

Lemma le_of_square a b : 0 <= b -> a * a <= b * b -> a <= b.
Proof. nra. Qed.

Lemma norm_le x y m : 0 <= m -> x * x + y * y <= m * m -> norm x y <= m.
Proof. intros; apply le_of_square; [assumption|]; rewrite norm_square; assumption. Qed.

Lemma le_norm x y m : m * m <= x * x + y * y -> m <= norm x y.
Proof. intros; apply le_of_square; [apply norm_pos|]; rewrite norm_square; assumption. Qed.

(* Cauchy's inequality. *)
Lemma dot_le_norm a b x y : a * x + b * y <= norm a b * norm x y.
Proof.
  apply le_of_square.
  - apply Rmult_le_pos; apply norm_pos.
  - replace (norm a b * norm x y * (norm a b * norm x y))
      with ((norm a b * norm a b) * (norm x y * norm x y)) by ring.
    rewrite !norm_square.
    generalize (Rle_0_sqr (a * y - b * x)); unfold Rsqr; nra.
Qed.

Lemma dot_le_norm_unit a b x y : a * a + b * b = 1 -> a * x + b * y <= norm x y.
Proof.
  intros unit; generalize (dot_le_norm a b x y).
  unfold norm at 1; rewrite unit, sqrt_1; lra.
Qed.

Lemma norm_triangle x y z w : norm (x + z) (y + w) <= norm x y + norm z w.
Proof.
  apply norm_le.
  - generalize (norm_pos x y) (norm_pos z w); lra.
  - generalize (dot_le_norm x y z w) (norm_square x y) (norm_square z w); nra.
Qed.

Lemma norm_opp x y : norm (- x) (- y) = norm x y.
Proof. unfold norm; f_equal; ring. Qed.

Lemma norm_zero : norm 0 0 = 0.
Proof. unfold norm; rewrite Rmult_0_l, Rplus_0_l; apply sqrt_0. Qed.

Lemma norm_scale k x y : 0 <= k -> norm (k * x) (k * y) = k * norm x y.
Proof.
  intros; unfold norm.
  replace (k * x * (k * x) + k * y * (k * y)) with ((k * k) * (x * x + y * y)) by ring.
  rewrite sqrt_mult by nra; rewrite sqrt_square by assumption; reflexivity.
Qed.

(* What is near a point that is far away is itself far away. *)
Lemma norm_near x y z w e : norm (x - z) (y - w) <= e -> norm z w - e <= norm x y.
Proof.
  intros near; generalize (norm_triangle (z - x) (w - y) x y).
  replace (z - x + x) with z by ring; replace (w - y + y) with w by ring.
  replace (z - x) with (- (x - z)) by ring; replace (w - y) with (- (y - w)) by ring.
  rewrite norm_opp; lra.
Qed.

(* A vector is as long as its longest projection. *)
Lemma norm_by_projections x y m :
  0 <= m -> (forall a b, a * a + b * b = 1 -> a * x + b * y <= m) -> norm x y <= m.
Proof.
  intros pos each.
  destruct (Req_dec (norm x y) 0) as [zero | some]; [lra|].
  assert (0 < norm x y) by (generalize (norm_pos x y); lra).
  assert (square := norm_square x y).
  assert (unit : x / norm x y * (x / norm x y) + y / norm x y * (y / norm x y) = 1).
  { replace (x / norm x y * (x / norm x y) + y / norm x y * (y / norm x y))
      with ((x * x + y * y) / (norm x y * norm x y)) by (field; lra).
    rewrite square; field; nra. }
  generalize (each _ _ unit).
  replace (x / norm x y * x + y / norm x y * y) with ((x * x + y * y) / norm x y) by (field; lra).
  rewrite <- square; replace (norm x y * norm x y / norm x y) with (norm x y) by (field; lra).
  lra.
Qed.
