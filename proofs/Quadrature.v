(* How far the code's positions along an arc are from the integral of the velocity: Gauss-Legendre's rule of four nodes,
   on the velocity of constant turn rate and acceleration, errs by at most

     4 / 9 (h / 2)^9 |omega|^7 (|omega| |v_m| / 40320 + |alpha| / 5040),

   v_m being the speed half-way. Seen from the middle of the arc, whose course is the axis, the velocity along it is v_m
   times a cosine and across it alpha u times a sine but for odd functions, which the rule and the integral take to be 0. *)

From Coq Require Import Reals Lra Psatz.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Motion.
Open Scope R_scope.

(* ---- the series of cosine and sine bound them ---- *)

Lemma grows (f df : R -> R) x :
  (forall t, is_derive f t (df t)) -> f 0 = 0 -> (forall c, 0 <= c -> 0 <= df c) -> 0 <= x -> 0 <= f x.
Proof.
  intros derive zero rises pos.
  destruct (mean_value f df 0 x pos derive) as [c [inside value]].
  rewrite zero in value.
  assert (0 <= df c * (x - 0)) by (apply Rmult_le_pos; [apply rises; lra|lra]).
  lra.
Qed.

Definition c2 (x : R) : R := 1 - x * x / 2.
Definition c4 (x : R) : R := c2 x + x * x * (x * x) / 24.
Definition c6 (x : R) : R := c4 x - x * x * (x * x) * (x * x) / 720.
Definition s3 (x : R) : R := x - x * (x * x) / 6.
Definition s5 (x : R) : R := s3 x + x * (x * x) * (x * x) / 120.

Lemma sin_1 x : 0 <= x -> 0 <= x - sin x.
Proof. intros; generalize (sin_below x H); lra. Qed.

Lemma cos_2 x : 0 <= x -> 0 <= cos x - c2 x.
Proof.
  unfold c2; apply (grows (fun x => cos x - (1 - x * x / 2)) (fun x => x - sin x)).
  - intros; auto_derive; [exact I|field].
  - rewrite cos_0; field.
  - apply sin_1.
Qed.

Lemma sin_3 x : 0 <= x -> 0 <= sin x - s3 x.
Proof.
  unfold s3; apply (grows (fun x => sin x - (x - x * (x * x) / 6)) (fun x => cos x - c2 x)).
  - intros; unfold c2; auto_derive; [exact I|field].
  - rewrite sin_0; field.
  - apply cos_2.
Qed.

Lemma cos_4 x : 0 <= x -> 0 <= c4 x - cos x.
Proof.
  unfold c4, c2; apply (grows (fun x => 1 - x * x / 2 + x * x * (x * x) / 24 - cos x) (fun x => sin x - s3 x)).
  - intros; unfold s3; auto_derive; [exact I|field].
  - rewrite cos_0; field.
  - apply sin_3.
Qed.

Lemma sin_5 x : 0 <= x -> 0 <= s5 x - sin x.
Proof.
  unfold s5, s3;
    apply (grows (fun x => x - x * (x * x) / 6 + x * (x * x) * (x * x) / 120 - sin x) (fun x => c4 x - cos x)).
  - intros; unfold c4, c2; auto_derive; [exact I|field].
  - rewrite sin_0; field.
  - apply cos_4.
Qed.

Lemma cos_6 x : 0 <= x -> 0 <= cos x - c6 x.
Proof.
  unfold c6, c4, c2; apply (grows (fun x => cos x - (1 - x * x / 2 + x * x * (x * x) / 24
    - x * x * (x * x) * (x * x) / 720)) (fun x => s5 x - sin x)).
  - intros; unfold s5, s3; auto_derive; [exact I|field].
  - rewrite cos_0; field.
  - apply sin_5.
Qed.

Lemma sin_7 x : 0 <= x -> 0 <= sin x - s5 x + x * (x * x) * (x * x) * (x * x) / 5040.
Proof.
  unfold s5, s3; apply (grows (fun x => sin x - (x - x * (x * x) / 6 + x * (x * x) * (x * x) / 120)
    + x * (x * x) * (x * x) * (x * x) / 5040) (fun x => cos x - c6 x)).
  - intros; unfold c6, c4, c2; auto_derive; [exact I|field].
  - rewrite sin_0; field.
  - apply cos_6.
Qed.

Lemma cos_8 x : 0 <= x -> 0 <= c6 x + x * x * (x * x) * (x * x) * (x * x) / 40320 - cos x.
Proof.
  unfold c6, c4, c2; apply (grows (fun x => 1 - x * x / 2 + x * x * (x * x) / 24 - x * x * (x * x) * (x * x) / 720
    + x * x * (x * x) * (x * x) * (x * x) / 40320 - cos x)
    (fun x => sin x - s5 x + x * (x * x) * (x * x) * (x * x) / 5040)).
  - intros; unfold s5, s3; auto_derive; [exact I|field].
  - rewrite cos_0; field.
  - apply sin_7.
Qed.

(* As even functions they hold on both sides. *)
Lemma cos_series x : 0 <= cos x - c6 x <= x * x * (x * x) * (x * x) * (x * x) / 40320.
Proof.
  destruct (Rle_dec 0 x).
  - generalize (cos_6 x r) (cos_8 x r); lra.
  - assert (0 <= - x) by lra; generalize (cos_6 (- x) H) (cos_8 (- x) H).
    rewrite cos_neg; unfold c6, c4, c2; lra.
Qed.

Lemma sin_series x : 0 <= x * (s5 x - sin x) <= x * x * (x * x) * (x * x) * (x * x) / 5040.
Proof.
  assert (one : forall y, 0 <= y -> 0 <= y * (s5 y - sin y) <= y * y * (y * y) * (y * y) * (y * y) / 5040).
  { intros y pos; generalize (sin_5 y pos) (sin_7 y pos); intros; split; [apply Rmult_le_pos; lra|].
    replace (y * y * (y * y) * (y * y) * (y * y) / 5040) with (y * (y * (y * y) * (y * y) * (y * y) / 5040)) by field.
    apply Rmult_le_compat_l; lra. }
  destruct (Rle_dec 0 x); [apply one; assumption|].
  assert (0 <= - x) by lra; generalize (one (- x) H).
  rewrite sin_neg; unfold s5, s3; lra.
Qed.

(* ---- the rule: nodes +-sqrt p, +-sqrt q of weights w, 1 - w on [-1, 1] ---- *)

Definition z : R := sqrt (6 / 5).
Definition p : R := (3 - 2 * z) / 7.
Definition q : R := (3 + 2 * z) / 7.
Definition w : R := (18 + 5 * z) / 36.

Lemma z_square : z * z = 6 / 5.
Proof. unfold z; apply sqrt_sqrt; lra. Qed.

Lemma z_bounds : 1095 / 1000 <= z <= 1096 / 1000.
Proof. generalize z_square (sqrt_pos (6 / 5)); fold z; intros; split; nra. Qed.

(* Of an even function given by its squared argument. *)
Definition rule (g : R -> R) : R := 2 * (w * g p + (1 - w) * g q).

Lemma p_pos : 0 <= p. Proof. unfold p; generalize z_bounds; lra. Qed.
Lemma q_pos : 0 <= q. Proof. unfold q; generalize z_bounds; lra. Qed.
Lemma w_pos : 0 <= w <= 1. Proof. unfold w; generalize z_bounds; lra. Qed.

Lemma rule_0 : rule (fun _ => 1) = 2.
Proof. unfold rule; ring. Qed.

Lemma rule_1 : rule (fun y => y) = 2 / 3.
Proof.
  unfold rule, p, q, w.
  match goal with |- ?a = _ => replace a with (2 / 3 + (z * z - 6 / 5) * (-10 / 63)) by field end.
  rewrite z_square; field.
Qed.

Lemma rule_2 : rule (fun y => y * y) = 2 / 5.
Proof.
  unfold rule, p, q, w.
  match goal with |- ?a = _ => replace a with (2 / 5 + (z * z - 6 / 5) * (4 / 147)) by field end.
  rewrite z_square; field.
Qed.

Lemma rule_3 : rule (fun y => y * y * y) = 2 / 7.
Proof.
  unfold rule, p, q, w.
  match goal with |- ?a = _ => replace a with (2 / 7 + (z * z - 6 / 5) * (110 / 1029 - 40 / 3087 * (z * z))) by field end.
  rewrite z_square; field.
Qed.

Lemma rule_4 : rule (fun y => y * y * y * y) = 258 / 1225.
Proof.
  unfold rule, p, q, w.
  match goal with |- ?a = _ =>
    replace a with (258 / 1225 + (z * z - 6 / 5) * (1432 / 12005 - 64 / 7203 * (z * z))) by field end.
  rewrite z_square; field.
Qed.

Lemma rule_order g h : (forall y, 0 <= y -> g y <= h y) -> rule g <= rule h.
Proof.
  intros order; unfold rule.
  assert (P := order p p_pos); assert (Q := order q q_pos); assert (W := w_pos).
  assert (w * g p <= w * h p) by (apply Rmult_le_compat_l; lra).
  assert ((1 - w) * g q <= (1 - w) * h q) by (apply Rmult_le_compat_l; lra).
  lra.
Qed.

(* ---- the even functions of an arc, on [-k, k] ---- *)

Lemma square_root_of_product x y : 0 <= y -> x * sqrt y * (x * sqrt y) = x * x * y.
Proof. intros; replace (x * sqrt y * (x * sqrt y)) with (x * x * (sqrt y * sqrt y)) by ring; rewrite sqrt_sqrt; lra. Qed.

Definition rule_cos (x : R) : R := rule (fun y => cos (x * sqrt y)).
Definition rule_sin (x : R) : R := rule (fun y => x * sqrt y * sin (x * sqrt y)).

Lemma close_to_both a b c m : 0 <= a - c <= m -> 0 <= b - c <= m -> Rabs (a - b) <= m.
Proof. intros; apply Rabs_le; lra. Qed.

Definition whole_c (x : R) : R := 2 - x * x / 3 + x * x * (x * x) / 60 - x * x * (x * x) * (x * x) / 2520.
Definition whole_s (x : R) : R := 2 / 3 * (x * x) - x * x * (x * x) / 15 + x * x * (x * x) * (x * x) / 420.

Lemma rule_cos_near x : 0 <= rule_cos x - whole_c x <= 2 / 9 * (x * x * (x * x) * (x * x) * (x * x)) / 40320.
Proof.
  assert (0 <= x * x * (x * x) * (x * x) * (x * x)).
  { replace (x * x * (x * x) * (x * x) * (x * x)) with (x * x * (x * x) * (x * x * (x * x))) by ring; nra. }
  assert (exact : whole_c x = rule (fun y => c6 (x * sqrt y))).
  { transitivity (rule (fun _ => 1) - x * x / 2 * rule (fun y => y) + x * x * (x * x) / 24 * rule (fun y => y * y)
      - x * x * (x * x) * (x * x) / 720 * rule (fun y => y * y * y)).
    - rewrite rule_0, rule_1, rule_2, rule_3; unfold whole_c; field.
    - unfold rule, c6, c4, c2; rewrite !square_root_of_product by (apply p_pos || apply q_pos); field. }
  split.
  - enough (whole_c x <= rule_cos x) by lra.
    rewrite exact; apply rule_order; intros; generalize (cos_series (x * sqrt y)); lra.
  - enough (rule_cos x <= whole_c x + x * x * (x * x) * (x * x) * (x * x) / 40320 * rule (fun y => y * y * y * y)).
    { rewrite rule_4 in H0; lra. }
    rewrite exact.
    apply Rle_trans with (rule (fun y => c6 (x * sqrt y) + x * x * (x * x) * (x * x) * (x * x) / 40320 * (y * y * y * y))).
    + apply rule_order; intros y pos; generalize (cos_series (x * sqrt y)); rewrite !square_root_of_product by assumption.
      lra.
    + right; unfold rule; ring.
Qed.

Lemma rule_sin_near x : 0 <= whole_s x - rule_sin x <= 2 / 9 * (x * x * (x * x) * (x * x) * (x * x)) / 5040.
Proof.
  assert (0 <= x * x * (x * x) * (x * x) * (x * x)).
  { replace (x * x * (x * x) * (x * x) * (x * x)) with (x * x * (x * x) * (x * x * (x * x))) by ring; nra. }
  assert (exact : whole_s x = rule (fun y => x * sqrt y * s5 (x * sqrt y))).
  { transitivity (x * x * rule (fun y => y) - x * x * (x * x) / 6 * rule (fun y => y * y)
      + x * x * (x * x) * (x * x) / 120 * rule (fun y => y * y * y)).
    - rewrite rule_1, rule_2, rule_3; unfold whole_s; field.
    - assert (term : forall y, 0 <= y -> x * sqrt y * s5 (x * sqrt y)
        = x * x * y - x * x * (x * x) / 6 * (y * y) + x * x * (x * x) * (x * x) / 120 * (y * y * y)).
      { intros y pos; generalize (square_root_of_product x y pos); unfold s5, s3.
        set (u := x * sqrt y); intros square.
        replace (u * (u - u * (u * u) / 6 + u * (u * u) * (u * u) / 120))
          with (u * u - u * u * (u * u) / 6 + u * u * (u * u) * (u * u) / 120) by field.
        rewrite square; field. }
      unfold rule; rewrite (term p p_pos), (term q q_pos); ring. }
  split.
  - enough (rule_sin x <= whole_s x) by lra.
    rewrite exact; apply rule_order; intros; generalize (sin_series (x * sqrt y)); lra.
  - enough (whole_s x <= rule_sin x + x * x * (x * x) * (x * x) * (x * x) / 5040 * rule (fun y => y * y * y * y)).
    { rewrite rule_4 in H0; lra. }
    rewrite exact.
    apply Rle_trans with (rule (fun y => x * sqrt y * sin (x * sqrt y)
      + x * x * (x * x) * (x * x) * (x * x) / 5040 * (y * y * y * y))).
    + apply rule_order; intros y pos; generalize (sin_series (x * sqrt y)); rewrite !square_root_of_product by assumption.
      lra.
    + right; unfold rule, rule_sin, rule; ring.
Qed.

Lemma continuous_of (f : R -> R) t : ex_derive f t -> continuous f t.
Proof. apply @ex_derive_continuous. Qed.

Ltac smooth := apply @ex_RInt_continuous; intros; apply continuous_of; auto_derive; exact I.

Lemma RInt_times (f : R -> R) a b e : ex_RInt f b e -> RInt (fun u => a * f u) b e = a * RInt f b e.
Proof. intros there; exact (RInt_scal f b e a there). Qed.

Lemma RInt_sum (f g : R -> R) b e :
  ex_RInt f b e -> ex_RInt g b e -> RInt (fun u => f u + g u) b e = RInt f b e + RInt g b e.
Proof. intros one two; exact (RInt_plus f g b e one two). Qed.

Lemma integral_cos_near o k :
  0 <= k -> 0 <= RInt (fun u => cos (o * u)) (- k) k - k * whole_c (o * k)
    <= k * (2 / 9 * (o * k * (o * k) * (o * k * (o * k)) * (o * k * (o * k)) * (o * k * (o * k)) / 40320)).
Proof.
  intros pos.
  assert (low : RInt (fun u => c6 (o * u)) (- k) k = k * whole_c (o * k)).
  { apply is_RInt_unique.
    replace (k * whole_c (o * k)) with (minus
      ((fun u => u - o * o * (u * u * u) / 6 + o * o * (o * o) * (u * u * u * u * u) / 120
        - o * o * (o * o) * (o * o) * (u * u * u * u * u * u * u) / 5040) k)
      ((fun u => u - o * o * (u * u * u) / 6 + o * o * (o * o) * (u * u * u * u * u) / 120
        - o * o * (o * o) * (o * o) * (u * u * u * u * u * u * u) / 5040) (- k)))
      by (unfold minus, plus, opp, whole_c; simpl; field).
    apply (is_RInt_derive (fun u => u - o * o * (u * u * u) / 6 + o * o * (o * o) * (u * u * u * u * u) / 120
        - o * o * (o * o) * (o * o) * (u * u * u * u * u * u * u) / 5040)).
    - intros; unfold c6, c4, c2; auto_derive; [exact I|field].
    - intros; apply continuous_of; unfold c6, c4, c2; auto_derive; exact I. }
  set (m := fun u => o * u * (o * u) * (o * u * (o * u)) * (o * u * (o * u)) * (o * u * (o * u)) / 40320).
  assert (high : RInt (fun u => c6 (o * u) + m u) (- k) k = k * whole_c (o * k)
    + k * (2 / 9 * (o * k * (o * k) * (o * k * (o * k)) * (o * k * (o * k)) * (o * k * (o * k)) / 40320))).
  { rewrite <- low.
    rewrite (RInt_plus (fun u => c6 (o * u)) m); [|unfold c6, c4, c2; smooth|unfold m; smooth].
    unfold plus; simpl; f_equal; apply is_RInt_unique.
    match goal with |- is_RInt _ _ _ ?v => replace v with (minus
      ((fun u => o * o * (o * o) * (o * o) * (o * o) * (u * u * u * u * u * u * u * u * u) / 362880) k)
      ((fun u => o * o * (o * o) * (o * o) * (o * o) * (u * u * u * u * u * u * u * u * u) / 362880) (- k)))
      by (unfold minus, plus, opp; simpl; field) end.
    apply (is_RInt_derive (fun u => o * o * (o * o) * (o * o) * (o * o) * (u * u * u * u * u * u * u * u * u) / 362880)).
    - intros; unfold m; auto_derive; [exact I|field].
    - intros; apply continuous_of; unfold m; auto_derive; exact I. }
  assert (- k <= k) by lra.
  assert (RInt (fun u => c6 (o * u)) (- k) k <= RInt (fun u => cos (o * u)) (- k) k).
  { apply RInt_le; [assumption|unfold c6, c4, c2; smooth|smooth|].
    intros u _; generalize (cos_series (o * u)); lra. }
  assert (RInt (fun u => cos (o * u)) (- k) k <= RInt (fun u => c6 (o * u) + m u) (- k) k).
  { apply RInt_le; [assumption|smooth|unfold m, c6, c4, c2; smooth|].
    intros u _; generalize (cos_series (o * u)); unfold m; lra. }
  lra.
Qed.

(* u times omega times the sine, so that the polynomials are those of omega u *)
Lemma integral_sin_near o k :
  0 <= k -> 0 <= k * whole_s (o * k) - RInt (fun u => o * u * sin (o * u)) (- k) k
    <= k * (2 / 9 * (o * k * (o * k) * (o * k * (o * k)) * (o * k * (o * k)) * (o * k * (o * k)) / 5040)).
Proof.
  intros pos.
  assert (high : RInt (fun u => o * u * s5 (o * u)) (- k) k = k * whole_s (o * k)).
  { apply is_RInt_unique.
    replace (k * whole_s (o * k)) with (minus
      ((fun u => o * o * (u * u * u) / 3 - o * o * (o * o) * (u * u * u * u * u) / 30
        + o * o * (o * o) * (o * o) * (u * u * u * u * u * u * u) / 840) k)
      ((fun u => o * o * (u * u * u) / 3 - o * o * (o * o) * (u * u * u * u * u) / 30
        + o * o * (o * o) * (o * o) * (u * u * u * u * u * u * u) / 840) (- k)))
      by (unfold minus, plus, opp, whole_s; simpl; field).
    apply (is_RInt_derive (fun u => o * o * (u * u * u) / 3 - o * o * (o * o) * (u * u * u * u * u) / 30
        + o * o * (o * o) * (o * o) * (u * u * u * u * u * u * u) / 840)).
    - intros; unfold s5, s3; auto_derive; [exact I|field].
    - intros; apply continuous_of; unfold s5, s3; auto_derive; exact I. }
  set (m := fun u => o * u * (o * u) * (o * u * (o * u)) * (o * u * (o * u)) * (o * u * (o * u)) / 5040).
  assert (most : RInt m (- k) k
    = k * (2 / 9 * (o * k * (o * k) * (o * k * (o * k)) * (o * k * (o * k)) * (o * k * (o * k)) / 5040))).
  { apply is_RInt_unique.
    match goal with |- is_RInt _ _ _ ?v => replace v with (minus
      ((fun u => o * o * (o * o) * (o * o) * (o * o) * (u * u * u * u * u * u * u * u * u) / 45360) k)
      ((fun u => o * o * (o * o) * (o * o) * (o * o) * (u * u * u * u * u * u * u * u * u) / 45360) (- k)))
      by (unfold minus, plus, opp; simpl; field) end.
    apply (is_RInt_derive (fun u => o * o * (o * o) * (o * o) * (o * o) * (u * u * u * u * u * u * u * u * u) / 45360)).
    - intros; unfold m; auto_derive; [exact I|field].
    - intros; apply continuous_of; unfold m; auto_derive; exact I. }
  assert (- k <= k) by lra.
  assert (RInt (fun u => o * u * sin (o * u)) (- k) k <= RInt (fun u => o * u * s5 (o * u)) (- k) k).
  { apply RInt_le; [assumption|smooth|unfold s5, s3; smooth|].
    intros u _; generalize (sin_series (o * u)); lra. }
  assert (RInt (fun u => o * u * s5 (o * u)) (- k) k <= RInt (fun u => plus (o * u * sin (o * u)) (m u)) (- k) k).
  { apply RInt_le; [assumption|unfold s5, s3; smooth|unfold m, plus; simpl; smooth|].
    intros u _; generalize (sin_series (o * u)); unfold m, plus; simpl; lra. }
  rewrite (RInt_plus (fun u => o * u * sin (o * u)) m) in H1; [|smooth|unfold m; smooth].
  unfold plus in H1; simpl in H1; lra.
Qed.

(* ---- an arc flown for h, seen from its middle: t = k + u, k = h / 2 ---- *)

Definition quadrature (omega alpha v h : R) : R :=
  2 / 9 * (h / 2) * (Rabs (v + alpha * (h / 2)) * (omega * (h / 2)) ^ 8 / 40320
    + Rabs alpha * (h / 2) * Rabs (omega * (h / 2)) ^ 7 / 5040).

(* What the code's sum is: nodes before and after the middle, with weights w and 1 - w. *)
Definition pair (f : R -> R) (k r : R) : R := f (k - k * r) + f (k + k * r).
Definition gauss (f : R -> R) (h : R) : R :=
  h / 2 * (w * pair f (h / 2) (sqrt p) + (1 - w) * pair f (h / 2) (sqrt q)).

Definition error_cos (o k : R) : R := RInt (fun u => cos (o * u)) (- k) k - k * rule_cos (o * k).
Definition error_sin (o k : R) : R := RInt (fun u => u * sin (o * u)) (- k) k
  - k * rule (fun y => k * sqrt y * sin (o * k * sqrt y)).

Lemma error_cos_small o k : 0 <= k -> Rabs (error_cos o k) <= 2 / 9 * k * ((o * k) ^ 8 / 40320).
Proof.
  intros pos; unfold error_cos.
  generalize (integral_cos_near o k pos) (rule_cos_near (o * k)); intros I R.
  assert (0 <= k * (rule_cos (o * k) - whole_c (o * k))
    <= k * (2 / 9 * (o * k * (o * k) * (o * k * (o * k)) * (o * k * (o * k)) * (o * k * (o * k))) / 40320)).
  { split; [apply Rmult_le_pos; lra|apply Rmult_le_compat_l; lra]. }
  apply Rabs_le; simpl; lra.
Qed.

Lemma error_sin_small o k : 0 <= k -> Rabs (error_sin o k) <= 2 / 9 * k * (k * Rabs (o * k) ^ 7 / 5040).
Proof.
  intros pos; unfold error_sin.
  destruct (Req_dec o 0) as [zero | turns].
  { subst o; rewrite !Rmult_0_l, Rabs_R0.
    rewrite (RInt_ext _ (fun _ => 0)) by (intros; rewrite Rmult_0_l, sin_0; apply Rmult_0_r).
    rewrite RInt_const; unfold scal; simpl; unfold mult; simpl.
    unfold rule; rewrite !Rmult_0_l, sin_0.
    replace ((k - - k) * 0 - k * (2 * (w * (k * sqrt p * 0) + (1 - w) * (k * sqrt q * 0)))) with 0 by ring.
    rewrite Rabs_R0; lra. }
  generalize (integral_sin_near o k pos) (rule_sin_near (o * k)); intros I R.
  assert (0 <= k * (whole_s (o * k) - rule_sin (o * k))
    <= k * (2 / 9 * (o * k * (o * k) * (o * k * (o * k)) * (o * k * (o * k)) * (o * k * (o * k))) / 5040)).
  { split; [apply Rmult_le_pos; lra|apply Rmult_le_compat_l; lra]. }
  assert (split_int : RInt (fun u => o * u * sin (o * u)) (- k) k = o * RInt (fun u => u * sin (o * u)) (- k) k).
  { rewrite <- RInt_times by smooth; apply RInt_ext; intros; apply Rmult_assoc. }
  assert (split_rule : k * rule_sin (o * k) = o * (k * rule (fun y => k * sqrt y * sin (o * k * sqrt y)))).
  { unfold rule_sin, rule; ring. }
  set (A := RInt (fun u => u * sin (o * u)) (- k) k) in *.
  set (B := k * rule (fun y => k * sqrt y * sin (o * k * sqrt y))) in *.
  assert (both : Rabs (o * (A - B)) <= 2 / 9 * k * ((o * k) ^ 8 / 5040)) by (apply Rabs_le; simpl; lra).
  rewrite Rabs_mult in both.
  apply Rmult_le_reg_l with (Rabs o); [apply Rabs_pos_lt; assumption|].
  apply Rle_trans with (1 := both); right.
  replace ((o * k) ^ 8) with (Rabs (o * k) ^ 8).
  2: { unfold Rabs; destruct (Rcase_abs (o * k)); ring. }
  rewrite Rabs_mult, (Rabs_right k) by lra; field.
Qed.

(* Odd functions integrate to nothing. *)
Lemma odd_integral (f : R -> R) k :
  (forall u, f (- u) = - f u) -> ex_RInt f (- k) k -> RInt f (- k) k = 0.
Proof.
  intros odd there.
  assert (back : ex_RInt f k (- k)) by (apply ex_RInt_swap; assumption).
  assert (turned := RInt_comp_lin f (-1) 0 (- k) k).
  replace (-1 * - k + 0) with k in turned by ring; replace (-1 * k + 0) with (- k) in turned by ring.
  specialize (turned back).
  rewrite (RInt_ext _ f) in turned.
  2: { intros u _; change (-1 * f (-1 * u + 0) = f u); replace (-1 * u + 0) with (- u) by ring; rewrite odd; ring. }
  assert (swap := opp_RInt_swap f (- k) k there).
  change (- RInt f (- k) k = RInt f k (- k)) in swap; lra.
Qed.

Lemma middle (f : R -> R) h : (forall t, continuous f t) -> RInt f 0 h = RInt (fun u => f (u + h / 2)) (- (h / 2)) (h / 2).
Proof.
  intros smooth_f.
  assert (shift := RInt_comp_lin f 1 (h / 2) (- (h / 2)) (h / 2)).
  replace (1 * - (h / 2) + h / 2) with 0 in shift by ring.
  replace (1 * (h / 2) + h / 2) with h in shift by field.
  rewrite <- shift by (apply @ex_RInt_continuous; intros; apply smooth_f).
  apply RInt_ext; intros; unfold scal; simpl; unfold mult; simpl; rewrite !Rmult_1_l; reflexivity.
Qed.

(* Integral less sum, for a velocity a cos + b u sin + odd parts: *)
Lemma arc_error (a b o h c d : R) (f : R -> R) :
  0 <= h -> (forall t, continuous f t) ->
  (forall u, f (u + h / 2) = (a * cos (o * u) + b * (u * sin (o * u))) + (c * sin (o * u) + d * (u * cos (o * u)))) ->
  RInt f 0 h - gauss f h = a * error_cos o (h / 2) + b * error_sin o (h / 2).
Proof.
  intros pos smooth_f form.
  rewrite (middle f h smooth_f).
  rewrite (RInt_ext _ _ _ _ (fun u _ => form u)).
  rewrite (RInt_sum (fun u => a * cos (o * u) + b * (u * sin (o * u)))
    (fun u => c * sin (o * u) + d * (u * cos (o * u)))) by smooth.
  rewrite (RInt_sum (fun u => a * cos (o * u)) (fun u => b * (u * sin (o * u)))) by smooth.
  rewrite (RInt_times (fun u => cos (o * u))), (RInt_times (fun u => u * sin (o * u))) by smooth.
  rewrite (odd_integral (fun u => c * sin (o * u) + d * (u * cos (o * u)))); [| |smooth].
  2: { intros u; replace (o * - u) with (- (o * u)) by ring; rewrite sin_neg, cos_neg; ring. }
  unfold gauss, pair, error_cos, error_sin, rule_cos, rule.
  set (k := h / 2) in *.
  assert (before : forall r, f (k - k * r) = (a * cos (o * (k * r)) + b * (k * r * sin (o * (k * r))))
    - (c * sin (o * (k * r)) + d * (k * r * cos (o * (k * r))))).
  { intros r; replace (k - k * r) with (- (k * r) + k) by ring; rewrite form.
    replace (o * - (k * r)) with (- (o * (k * r))) by ring; rewrite sin_neg, cos_neg; ring. }
  assert (after : forall r, f (k + k * r) = (a * cos (o * (k * r)) + b * (k * r * sin (o * (k * r))))
    + (c * sin (o * (k * r)) + d * (k * r * cos (o * (k * r))))).
  { intros r; replace (k + k * r) with (k * r + k) by ring; apply form. }
  rewrite !before, !after, !Rmult_assoc; ring.
Qed.

Theorem quadrature_sound psi v omega alpha h :
  0 <= h ->
  norm (RInt (own_vx psi v omega alpha) 0 h - gauss (own_vx psi v omega alpha) h)
    (RInt (own_vy psi v omega alpha) 0 h - gauss (own_vy psi v omega alpha) h)
  <= quadrature omega alpha v h.
Proof.
  intros pos.
  set (k := h / 2); set (m := v + alpha * k); set (phi := psi + omega * k).
  assert (kpos : 0 <= k) by (unfold k; lra).
  rewrite (arc_error (m * cos phi) (- (alpha * sin phi)) omega h (- (m * sin phi)) (alpha * cos phi)
    (own_vx psi v omega alpha)); [|assumption| |].
  2: { intros t; apply continuous_of; eexists; apply own_vx_derive. }
  2: { intros u; unfold own_vx; fold k.
       replace (psi + omega * (u + k)) with (phi + omega * u) by (unfold phi; ring).
       replace (v + alpha * (u + k)) with (m + alpha * u) by (unfold m; ring).
       rewrite cos_plus; ring. }
  rewrite (arc_error (m * sin phi) (alpha * cos phi) omega h (m * cos phi) (alpha * sin phi)
    (own_vy psi v omega alpha)); [|assumption| |].
  2: { intros t; apply continuous_of; eexists; apply own_vy_derive. }
  2: { intros u; unfold own_vy; fold k.
       replace (psi + omega * (u + k)) with (phi + omega * u) by (unfold phi; ring).
       replace (v + alpha * (u + k)) with (m + alpha * u) by (unfold m; ring).
       rewrite sin_plus; ring. }
  fold k; set (A := error_cos omega k); set (B := error_sin omega k).
  assert (unit := sin2_cos2 phi); unfold Rsqr in unit.
  apply Rle_trans with (Rabs m * Rabs A + Rabs alpha * Rabs B).
  - rewrite <- !Rabs_mult.
    apply norm_le; [generalize (Rabs_pos (m * A)) (Rabs_pos (alpha * B)); lra|].
    match goal with |- ?l <= _ => replace l with
      ((m * A * (m * A) + alpha * B * (alpha * B)) * (sin phi * sin phi + cos phi * cos phi)) by ring end.
    rewrite unit.
    assert (square : forall x, x * x = Rabs x * Rabs x) by (intros x; unfold Rabs; destruct (Rcase_abs x); ring).
    rewrite (square (m * A)), (square (alpha * B)).
    generalize (Rabs_pos (m * A)) (Rabs_pos (alpha * B)); intros; nra.
  - assert (one := error_cos_small omega k kpos); assert (two := error_sin_small omega k kpos).
    fold A in one; fold B in two.
    assert (Rabs m * Rabs A <= Rabs m * (2 / 9 * k * ((omega * k) ^ 8 / 40320))).
    { apply Rmult_le_compat_l; [apply Rabs_pos|assumption]. }
    assert (Rabs alpha * Rabs B <= Rabs alpha * (2 / 9 * k * (k * Rabs (omega * k) ^ 7 / 5040))).
    { apply Rmult_le_compat_l; [apply Rabs_pos|assumption]. }
    unfold quadrature; fold k; fold m; lra.
Qed.

(* The same for every part of an arc, from the arc's whole length and larger speed: what the validator reckons with. *)
Definition position_error_bound (omega alpha v h : R) : R :=
  2 / 9 * (h / 2) * (quickest v alpha h * Rabs (omega * (h / 2)) / 40320 + Rabs alpha * (h / 2) / 5040)
    * (Rabs (omega * (h / 2)) * Rabs (omega * (h / 2)) * Rabs (omega * (h / 2)) * Rabs (omega * (h / 2))
      * Rabs (omega * (h / 2)) * Rabs (omega * (h / 2)) * Rabs (omega * (h / 2))).

Theorem position_error_bound_sound x y psi v omega alpha h t :
  0 <= v -> 0 <= v + alpha * h -> 0 <= t <= h ->
  norm (x + gauss (own_vx psi v omega alpha) t - own_x x psi v omega alpha t)
    (y + gauss (own_vy psi v omega alpha) t - own_y y psi v omega alpha t) <= position_error_bound omega alpha v h.
Proof.
  intros first last inside.
  unfold own_x, own_y, travelled.
  replace (x + gauss (own_vx psi v omega alpha) t - (x + RInt (own_vx psi v omega alpha) 0 t))
    with (- (RInt (own_vx psi v omega alpha) 0 t - gauss (own_vx psi v omega alpha) t)) by ring.
  replace (y + gauss (own_vy psi v omega alpha) t - (y + RInt (own_vy psi v omega alpha) 0 t))
    with (- (RInt (own_vy psi v omega alpha) 0 t - gauss (own_vy psi v omega alpha) t)) by ring.
  rewrite norm_opp.
  apply Rle_trans with (quadrature omega alpha v t); [apply quadrature_sound; lra|].
  unfold quadrature, position_error_bound.
  assert (half : 0 <= t / 2 <= h / 2) by lra.
  set (j := t / 2) in *; set (k := h / 2) in *.
  assert (fast : Rabs (v + alpha * j) <= quickest v alpha h).
  { assert (0 <= j <= h) by (unfold j; lra).
    destruct (quickest_bound v alpha h j first last H); rewrite Rabs_right; lra. }
  replace ((omega * j) ^ 8) with (Rabs (omega * j) * Rabs (omega * j) ^ 7)
    by (unfold Rabs; destruct (Rcase_abs (omega * j)); ring).
  assert (turn : 0 <= Rabs (omega * j) <= Rabs (omega * k)).
  { split; [apply Rabs_pos|rewrite !Rabs_mult, !(Rabs_right j), !(Rabs_right k) by lra].
    apply Rmult_le_compat_l; [apply Rabs_pos|lra]. }
  set (a := Rabs (omega * j)) in *; set (b := Rabs (omega * k)) in *.
  assert (power : 0 <= a ^ 7 <= b ^ 7) by (split; [apply pow_le; lra|apply pow_incr; lra]).
  replace (b * b * b * b * b * b * b) with (b ^ 7) by ring.
  set (Q := quickest v alpha h) in *.
  assert (alpha_pos := Rabs_pos alpha); assert (v_pos := Rabs_pos (v + alpha * j)).
  replace (2 / 9 * j * (Rabs (v + alpha * j) * (a * a ^ 7) / 40320 + Rabs alpha * j * a ^ 7 / 5040))
    with (2 / 9 * (j * ((Rabs (v + alpha * j) * a / 40320 + Rabs alpha * j / 5040) * a ^ 7))) by field.
  replace (2 / 9 * k * (Q * b / 40320 + Rabs alpha * k / 5040) * b ^ 7)
    with (2 / 9 * (k * ((Q * b / 40320 + Rabs alpha * k / 5040) * b ^ 7))) by field.
  assert (0 <= Rabs (v + alpha * j) * a <= Q * b).
  { split; [apply Rmult_le_pos; lra|apply Rmult_le_compat; lra]. }
  assert (0 <= Rabs alpha * j <= Rabs alpha * k).
  { split; [apply Rmult_le_pos; lra|apply Rmult_le_compat_l; lra]. }
  apply Rmult_le_compat_l; [lra|].
  apply Rmult_le_compat; [lra| |lra|].
  - apply Rmult_le_pos; lra.
  - apply Rmult_le_compat; lra.
Qed.
