(* The two motions of a plan. The own one on an arc: constant turn rate and acceleration. An intruder's: a turn at
   constant speed for some time, then straight on. Both are the integrals of their velocities; how fast those change
   is bounded, and an intruder's integral has the closed form that the code computes. *)

From Coq Require Import Reals Lra Psatz.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord.
Open Scope R_scope.

Lemma sin_below x : 0 <= x -> sin x <= x.
Proof. intros; destruct (Req_dec x 0); [subst; rewrite sin_0; lra|left; apply sin_lt_x; lra]. Qed.

Lemma sin_square x : sin x * sin x <= x * x.
Proof.
  assert (one : forall y, 0 <= y -> sin y * sin y <= y * y).
  { intros y pos; assert (below := sin_below y pos).
    assert (above : - y <= sin y).
    { destruct (Rle_dec y PI).
      - generalize (sin_ge_0 y pos r); lra.
      - generalize (SIN_bound y) PI2_1; lra. }
    nra. }
  destruct (Rle_dec 0 x); [apply one; assumption|].
  replace (sin x * sin x) with (sin (- x) * sin (- x)) by (rewrite sin_neg; ring).
  replace (x * x) with (- x * - x) by ring.
  apply one; lra.
Qed.

(* A unit vector moves no farther than its angle. *)
Lemma turn_chord a b : norm (cos b - cos a) (sin b - sin a) <= Rabs (b - a).
Proof.
  apply norm_le; [apply Rabs_pos|].
  replace (Rabs (b - a) * Rabs (b - a)) with ((b - a) * (b - a)).
  2: { unfold Rabs; destruct (Rcase_abs (b - a)); ring. }
  replace ((cos b - cos a) * (cos b - cos a) + (sin b - sin a) * (sin b - sin a))
    with (4 * (sin ((b - a) / 2) * sin ((b - a) / 2))).
  { generalize (sin_square ((b - a) / 2)); lra. }
  rewrite form2, form4.
  generalize (sin2_cos2 ((b + a) / 2)); unfold Rsqr; intros unit.
  replace ((-2 * sin ((b - a) / 2) * sin ((b + a) / 2)) * (-2 * sin ((b - a) / 2) * sin ((b + a) / 2))
    + (2 * cos ((b + a) / 2) * sin ((b - a) / 2)) * (2 * cos ((b + a) / 2) * sin ((b - a) / 2)))
    with (4 * (sin ((b - a) / 2) * sin ((b - a) / 2))
      * (sin ((b + a) / 2) * sin ((b + a) / 2) + cos ((b + a) / 2) * cos ((b + a) / 2))) by ring.
  rewrite unit; ring.
Qed.

(* A velocity whose derivative is bounded by a. *)
Lemma steady_by_derivative (vx vy ax ay : R -> R) a b e :
  0 <= a ->
  (forall t, is_derive vx t (ax t)) -> (forall t, is_derive vy t (ay t)) ->
  (forall t, b <= t <= e -> norm (ax t) (ay t) <= a) -> steady vx vy a b e.
Proof.
  intros pos dx dy bounded s t first order last.
  apply norm_by_projections; [apply Rmult_le_pos; lra|].
  intros p q unit.
  destruct (mean_value (fun u => p * vx u + q * vy u) (fun u => p * ax u + q * ay u) s t order) as [c [inside value]].
  - intros u; apply (is_derive_plus (fun v => p * vx v) (fun v => q * vy v) u (p * ax u) (q * ay u)).
    + apply (is_derive_scal vx u p (ax u)), dx.
    + apply (is_derive_scal vy u q (ay u)), dy.
  - assert (inner : b <= c <= e) by lra.
    assert (bound := bounded c inner).
    assert (projection := dot_le_norm_unit p q (ax c) (ay c) unit).
    replace (p * (vx t - vx s) + q * (vy t - vy s)) with (p * vx t + q * vy t - (p * vx s + q * vy s)) by ring.
    rewrite value; apply Rmult_le_compat_r; lra.
Qed.

(* At speeds of q at most, nothing gets farther than q for each second. *)
Lemma flown x y vx vy q b e :
  0 <= q -> b <= e -> moves x y vx vy -> (forall t, b <= t <= e -> norm (vx t) (vy t) <= q) ->
  norm (x e - x b) (y e - y b) <= q * (e - b).
Proof.
  intros pos order motion slow.
  apply norm_by_projections; [apply Rmult_le_pos; lra|].
  intros n m unit.
  destruct (mean_value (fun u => n * x u + m * y u) (fun u => n * vx u + m * vy u) b e order) as [c [inside value]].
  - intros u; destruct (motion u) as [mx my].
    apply (is_derive_plus (fun v => n * x v) (fun v => m * y v) u (n * vx u) (m * vy u)).
    + apply (is_derive_scal x u n (vx u)); assumption.
    + apply (is_derive_scal y u m (vy u)); assumption.
  - assert (bound := slow c inside).
    assert (projection := dot_le_norm_unit n m (vx c) (vy c) unit).
    replace (n * (x e - x b) + m * (y e - y b)) with (n * x e + m * y e - (n * x b + m * y b)) by ring.
    rewrite value; apply Rmult_le_compat_r; lra.
Qed.

(* A velocity of this size along some course. *)
Lemma speed_norm v a : 0 <= v -> norm (v * cos a) (v * sin a) = v.
Proof.
  intros; rewrite norm_scale by assumption.
  enough (norm (cos a) (sin a) = 1) as -> by ring.
  unfold norm; generalize (sin2_cos2 a); unfold Rsqr; intros.
  replace (cos a * cos a + sin a * sin a) with 1 by lra; apply sqrt_1.
Qed.

(* The difference of two motions. *)
Lemma steady_minus vx vy wx wy a c b e :
  steady vx vy a b e -> steady wx wy c b e ->
  steady (fun t => vx t - wx t) (fun t => vy t - wy t) (a + c) b e.
Proof.
  intros one two s t first order last.
  generalize (one s t first order last) (two s t first order last).
  generalize (norm_triangle (vx t - vx s) (vy t - vy s) (- (wx t - wx s)) (- (wy t - wy s))).
  rewrite norm_opp.
  replace (vx t - vx s + - (wx t - wx s)) with (vx t - wx t - (vx s - wx s)) by ring.
  replace (vy t - vy s + - (wy t - wy s)) with (vy t - wy t - (vy s - wy s)) by ring.
  lra.
Qed.

Lemma moves_minus x y vx vy z w wx wy :
  moves x y vx vy -> moves z w wx wy ->
  moves (fun t => x t - z t) (fun t => y t - w t) (fun t => vx t - wx t) (fun t => vy t - wy t).
Proof.
  intros one two t; destruct (one t) as [a b]; destruct (two t) as [c d]; split.
  - apply (is_derive_minus x z t (vx t) (wx t)); assumption.
  - apply (is_derive_minus y w t (vy t) (wy t)); assumption.
Qed.

(* The integral of a continuous velocity, from a place at a time. *)
Definition travelled (v : R -> R) (from at_ t : R) : R := from + RInt v at_ t.

Lemma travelled_derive (v : R -> R) from at_ :
  (forall t, continuous v t) -> forall t, is_derive (travelled v from at_) t (v t).
Proof.
  intros smooth t; unfold travelled.
  evar_last.
  apply (is_derive_plus (fun _ => from) (fun u => RInt v at_ u) t 0 (v t)); [apply @is_derive_const|].
  apply (is_derive_RInt v (fun u => RInt v at_ u) at_ t); [|apply smooth].
  apply filter_forall; intros u; apply @RInt_correct, @ex_RInt_continuous.
  - intros; apply smooth.
  - unfold plus; simpl; ring.
Qed.

(* ---- the own motion on an arc, t seconds after it began ---- *)

Definition own_vx (psi v omega alpha t : R) : R := (v + alpha * t) * cos (psi + omega * t).
Definition own_vy (psi v omega alpha t : R) : R := (v + alpha * t) * sin (psi + omega * t).

Definition own_ax (psi v omega alpha t : R) : R :=
  alpha * cos (psi + omega * t) - (v + alpha * t) * omega * sin (psi + omega * t).
Definition own_ay (psi v omega alpha t : R) : R :=
  alpha * sin (psi + omega * t) + (v + alpha * t) * omega * cos (psi + omega * t).

Lemma own_vx_derive psi v omega alpha t :
  is_derive (own_vx psi v omega alpha) t (own_ax psi v omega alpha t).
Proof. unfold own_vx, own_ax; auto_derive; [exact I|ring]. Qed.

Lemma own_vy_derive psi v omega alpha t :
  is_derive (own_vy psi v omega alpha) t (own_ay psi v omega alpha t).
Proof. unfold own_vy, own_ay; auto_derive; [exact I|ring]. Qed.

(* Largest acceleration on an arc whose speed is positive: quickest is its larger end. *)
Definition quickest (v alpha h : R) : R := Rmax v (v + alpha * h).
Definition own_acceleration (v omega alpha h : R) : R := norm alpha (quickest v alpha h * omega).

Lemma quickest_bound v alpha h t :
  0 <= v -> 0 <= v + alpha * h -> 0 <= t <= h -> 0 <= v + alpha * t <= quickest v alpha h.
Proof.
  intros first last inside; unfold quickest.
  generalize (Rmax_l v (v + alpha * h)) (Rmax_r v (v + alpha * h)); intros.
  destruct (Rle_dec 0 alpha); split; nra.
Qed.

Lemma own_acceleration_bound psi v omega alpha h t :
  0 <= v -> 0 <= v + alpha * h -> 0 <= t <= h ->
  norm (own_ax psi v omega alpha t) (own_ay psi v omega alpha t) <= own_acceleration v omega alpha h.
Proof.
  intros first last inside; unfold own_acceleration.
  assert (fast := quickest_bound v alpha h t first last inside).
  apply norm_le; [apply norm_pos|]; rewrite norm_square.
  unfold own_ax, own_ay.
  set (w := v + alpha * t) in *; set (q := quickest v alpha h) in *.
  assert (unit := sin2_cos2 (psi + omega * t)); unfold Rsqr in unit.
  set (s := sin (psi + omega * t)) in *; set (c := cos (psi + omega * t)) in *.
  replace ((alpha * c - w * omega * s) * (alpha * c - w * omega * s)
    + (alpha * s + w * omega * c) * (alpha * s + w * omega * c))
    with ((alpha * alpha + w * w * (omega * omega)) * (s * s + c * c)) by ring.
  rewrite unit.
  assert (w * w <= q * q) by nra.
  assert (0 <= omega * omega) by nra.
  nra.
Qed.

Definition own_x (x psi v omega alpha t : R) : R := travelled (own_vx psi v omega alpha) x 0 t.
Definition own_y (y psi v omega alpha t : R) : R := travelled (own_vy psi v omega alpha) y 0 t.

Lemma own_moves x y psi v omega alpha :
  moves (own_x x psi v omega alpha) (own_y y psi v omega alpha) (own_vx psi v omega alpha) (own_vy psi v omega alpha).
Proof.
  intros t; split; apply travelled_derive; intros u; apply @ex_derive_continuous.
  - exists (own_ax psi v omega alpha u); apply own_vx_derive.
  - exists (own_ay psi v omega alpha u); apply own_vy_derive.
Qed.

Lemma own_steady psi v omega alpha h :
  0 <= v -> 0 <= v + alpha * h ->
  steady (own_vx psi v omega alpha) (own_vy psi v omega alpha) (own_acceleration v omega alpha h) 0 h.
Proof.
  intros; apply steady_by_derivative with (own_ax psi v omega alpha) (own_ay psi v omega alpha).
  - apply norm_pos.
  - apply own_vx_derive.
  - apply own_vy_derive.
  - intros; apply own_acceleration_bound; assumption.
Qed.

(* ---- an intruder, t seconds after the request ---- *)

Definition course (psi omega lasts t : R) : R := psi + omega * Rmin t lasts.
Definition other_vx (psi v omega lasts t : R) : R := v * cos (course psi omega lasts t).
Definition other_vy (psi v omega lasts t : R) : R := v * sin (course psi omega lasts t).

Lemma continuous_course psi omega lasts t : continuous (course psi omega lasts) t.
Proof.
  apply continuous_ext with (fun u => psi + omega * ((u + lasts - Rabs (u - lasts)) / 2)).
  { intros u; unfold course; do 2 f_equal.
    unfold Rmin, Rabs; destruct (Rle_dec u lasts); destruct (Rcase_abs (u - lasts)); lra. }
  apply (continuous_plus (fun _ => psi) (fun u => omega * ((u + lasts - Rabs (u - lasts)) / 2)));
    [apply continuous_const|].
  apply (continuous_scal_r omega (fun u => (u + lasts - Rabs (u - lasts)) / 2)).
  apply continuous_ext with (fun u => / 2 * (u + lasts - Rabs (u - lasts))); [intros; unfold Rdiv; simpl; ring|].
  apply (continuous_scal_r (/ 2) (fun u => u + lasts - Rabs (u - lasts))).
  apply (continuous_minus (fun u => u + lasts) (fun u => Rabs (u - lasts))).
  - apply (continuous_plus (fun u => u) (fun _ => lasts)); [apply continuous_id|apply continuous_const].
  - apply (continuous_comp (fun u => u - lasts) Rabs).
    + apply (continuous_minus (fun u => u) (fun _ => lasts)); [apply continuous_id|apply continuous_const].
    + apply continuous_Rabs.
Qed.

Lemma other_vx_continuous psi v omega lasts t : continuous (other_vx psi v omega lasts) t.
Proof.
  apply (continuous_scal_r v (fun u => cos (course psi omega lasts u))).
  apply (continuous_comp (course psi omega lasts) cos); [apply continuous_course|apply continuous_cos].
Qed.

Lemma other_vy_continuous psi v omega lasts t : continuous (other_vy psi v omega lasts) t.
Proof.
  apply (continuous_scal_r v (fun u => sin (course psi omega lasts u))).
  apply (continuous_comp (course psi omega lasts) sin); [apply continuous_course|apply continuous_sin].
Qed.

Definition other_x (x psi v omega lasts t : R) : R := travelled (other_vx psi v omega lasts) x 0 t.
Definition other_y (y psi v omega lasts t : R) : R := travelled (other_vy psi v omega lasts) y 0 t.

Lemma other_moves x y psi v omega lasts :
  moves (other_x x psi v omega lasts) (other_y y psi v omega lasts)
    (other_vx psi v omega lasts) (other_vy psi v omega lasts).
Proof.
  intros t; split; apply travelled_derive; intros; [apply other_vx_continuous|apply other_vy_continuous].
Qed.

(* Its acceleration: speed times turn rate while the turn lasts, none for one that does not turn. *)
Definition other_acceleration (v omega lasts : R) : R := if Rlt_dec 0 lasts then Rabs (v * omega) else 0.

Lemma other_steady psi v omega lasts b e :
  0 <= b -> steady (other_vx psi v omega lasts) (other_vy psi v omega lasts) (other_acceleration v omega lasts) b e.
Proof.
  intros begun s t first order last.
  unfold other_vx, other_vy.
  rewrite <- !Rmult_minus_distr_l.
  assert (length : norm (v * (cos (course psi omega lasts t) - cos (course psi omega lasts s)))
    (v * (sin (course psi omega lasts t) - sin (course psi omega lasts s)))
    <= Rabs v * Rabs (course psi omega lasts t - course psi omega lasts s)).
  { apply Rle_trans with (Rabs v * norm (cos (course psi omega lasts t) - cos (course psi omega lasts s))
      (sin (course psi omega lasts t) - sin (course psi omega lasts s))).
    - rewrite <- norm_scale by apply Rabs_pos; right; unfold norm; f_equal.
      unfold Rabs; destruct (Rcase_abs v); ring.
    - apply Rmult_le_compat_l; [apply Rabs_pos|apply turn_chord]. }
  apply Rle_trans with (1 := length).
  replace (course psi omega lasts t - course psi omega lasts s) with (omega * (Rmin t lasts - Rmin s lasts))
    by (unfold course; ring).
  rewrite Rabs_mult, <- Rmult_assoc, <- Rabs_mult.
  unfold other_acceleration; destruct (Rlt_dec 0 lasts).
  - apply Rmult_le_compat_l; [apply Rabs_pos|].
    unfold Rmin; destruct (Rle_dec t lasts); destruct (Rle_dec s lasts); unfold Rabs; destruct (Rcase_abs _); lra.
  - replace (Rmin t lasts) with lasts by (unfold Rmin; destruct (Rle_dec t lasts); lra).
    replace (Rmin s lasts) with lasts by (unfold Rmin; destruct (Rle_dec s lasts); lra).
    replace (lasts - lasts) with 0 by ring; rewrite Rabs_R0; lra.
Qed.

(* The closed form. While the turn lasts it is a chord of length reach v that points half-way through it. *)
Definition reach (omega t : R) : R := 2 * sin (omega * t / 2) / omega.

Lemma turning_x x psi v omega lasts t :
  omega <> 0 -> 0 <= t <= lasts ->
  other_x x psi v omega lasts t = x + v * reach omega t * cos (psi + omega * t / 2).
Proof.
  intros turns inside; unfold other_x, travelled, reach; f_equal.
  rewrite (RInt_ext _ (fun u => v * cos (psi + omega * u))).
  2: { intros u between; rewrite Rmin_left, Rmax_right in between by lra.
       unfold other_vx, course; rewrite Rmin_left by lra; reflexivity. }
  apply is_RInt_unique.
  replace (v * (2 * sin (omega * t / 2) / omega) * cos (psi + omega * t / 2))
    with (minus (v / omega * sin (psi + omega * t)) (v / omega * sin (psi + omega * 0))).
  - apply (is_RInt_derive (fun u => v / omega * sin (psi + omega * u)) (fun u => v * cos (psi + omega * u))).
    + intros u _; auto_derive; [exact I|field; assumption].
    + intros u _; apply @ex_derive_continuous; auto_derive; exact I.
  - unfold minus, plus, opp; simpl.
    replace (v / omega * sin (psi + omega * t) + - (v / omega * sin (psi + omega * 0)))
      with (v / omega * (sin (psi + omega * t) - sin psi)) by (rewrite Rmult_0_r, Rplus_0_r; ring).
    rewrite form4.
    replace ((psi + omega * t + psi) / 2) with (psi + omega * t / 2) by field.
    replace ((psi + omega * t - psi) / 2) with (omega * t / 2) by field.
    field; assumption.
Qed.

Lemma turning_y y psi v omega lasts t :
  omega <> 0 -> 0 <= t <= lasts ->
  other_y y psi v omega lasts t = y + v * reach omega t * sin (psi + omega * t / 2).
Proof.
  intros turns inside; unfold other_y, travelled, reach; f_equal.
  rewrite (RInt_ext _ (fun u => v * sin (psi + omega * u))).
  2: { intros u between; rewrite Rmin_left, Rmax_right in between by lra.
       unfold other_vy, course; rewrite Rmin_left by lra; reflexivity. }
  apply is_RInt_unique.
  replace (v * (2 * sin (omega * t / 2) / omega) * sin (psi + omega * t / 2))
    with (minus (- v / omega * cos (psi + omega * t)) (- v / omega * cos (psi + omega * 0))).
  - apply (is_RInt_derive (fun u => - v / omega * cos (psi + omega * u)) (fun u => v * sin (psi + omega * u))).
    + intros u _; auto_derive; [exact I|field; assumption].
    + intros u _; apply @ex_derive_continuous; auto_derive; exact I.
  - unfold minus, plus, opp; simpl.
    replace (- v / omega * cos (psi + omega * t) + - (- v / omega * cos (psi + omega * 0)))
      with (- v / omega * (cos (psi + omega * t) - cos psi)) by (rewrite Rmult_0_r, Rplus_0_r; ring).
    rewrite form2.
    replace ((psi + omega * t + psi) / 2) with (psi + omega * t / 2) by field.
    replace ((psi + omega * t - psi) / 2) with (omega * t / 2) by field.
    field; assumption.
Qed.

(* After the turn, and for one that flies straight, it goes on along its course. *)
Lemma onward_x x psi v omega lasts s t :
  0 <= s -> lasts <= s -> s <= t ->
  other_x x psi v omega lasts t = other_x x psi v omega lasts s + v * (t - s) * cos (psi + omega * lasts).
Proof.
  intros begun after order; unfold other_x, travelled.
  rewrite <- (RInt_Chasles _ 0 s t);
    try (apply @ex_RInt_continuous; intros; apply other_vx_continuous).
  rewrite (RInt_ext _ (fun _ => v * cos (psi + omega * lasts)) s t).
  2: { intros u between; rewrite Rmin_left, Rmax_right in between by lra.
       unfold other_vx, course; rewrite Rmin_right by lra; reflexivity. }
  rewrite RInt_const; unfold plus, scal; simpl; unfold mult; simpl; ring.
Qed.

Lemma onward_y y psi v omega lasts s t :
  0 <= s -> lasts <= s -> s <= t ->
  other_y y psi v omega lasts t = other_y y psi v omega lasts s + v * (t - s) * sin (psi + omega * lasts).
Proof.
  intros begun after order; unfold other_y, travelled.
  rewrite <- (RInt_Chasles _ 0 s t);
    try (apply @ex_RInt_continuous; intros; apply other_vy_continuous).
  rewrite (RInt_ext _ (fun _ => v * sin (psi + omega * lasts)) s t).
  2: { intros u between; rewrite Rmin_left, Rmax_right in between by lra.
       unfold other_vy, course; rewrite Rmin_right by lra; reflexivity. }
  rewrite RInt_const; unfold plus, scal; simpl; unfold mult; simpl; ring.
Qed.

Lemma other_begins x psi v omega lasts : other_x x psi v omega lasts 0 = x.
Proof. unfold other_x, travelled; rewrite RInt_point; unfold zero; simpl; ring. Qed.
