(* A motion leaves the chord between two of its points by at most a t (h - t) / 2, a being a bound on its acceleration:
   on how fast its velocity changes (Lipschitz), so that jumps of the acceleration do not matter. *)

From Coq Require Import Reals Lra Psatz.
From Coquelicot Require Import Coquelicot.
Require Import Vectors.
Open Scope R_scope.

Definition moves (x y vx vy : R -> R) : Prop :=
  forall t, is_derive x t (vx t) /\ is_derive y t (vy t).

Definition steady (vx vy : R -> R) (a b e : R) : Prop :=
  forall s t, b <= s -> s <= t -> t <= e -> norm (vx t - vx s) (vy t - vy s) <= a * (t - s).

Lemma mean_value (f df : R -> R) b e :
  b <= e -> (forall t, is_derive f t (df t)) -> exists c, b <= c <= e /\ f e - f b = df c * (e - b).
Proof.
  intros order derive.
  destruct (MVT_gen f b e df) as [c [between value]].
  - intros; apply derive.
  - intros t _; apply continuity_pt_filterlim.
    apply (ex_derive_continuous f); exists (df t); apply derive.
  - exists c; rewrite Rmin_left, Rmax_right in between by assumption; split; assumption.
Qed.

(* In one dimension: a derivative that falls by a at most per unit. *)
Lemma chord_line (f df : R -> R) a b e t :
  b < e -> b <= t <= e ->
  (forall u, is_derive f u (df u)) ->
  (forall s u, b <= s -> s <= u -> u <= e -> - (a * (u - s)) <= df u - df s) ->
  f t <= f b + (t - b) / (e - b) * (f e - f b) + a / 2 * (t - b) * (e - t).
Proof.
  intros order inside derive slow.
  set (g := fun u => f u + a / 2 * (u * u)).
  set (dg := fun u => df u + a * u).
  assert (deriveg : forall u, is_derive g u (dg u)).
  { intros u; unfold g, dg.
    apply (is_derive_plus f (fun v => a / 2 * (v * v)) u (df u) (a * u)); [apply derive|].
    auto_derive; [exact I|field]. }
  destruct (mean_value g dg b t) as [c [c_in c_value]]; [lra|assumption|].
  destruct (mean_value g dg t e) as [d [d_in d_value]]; [lra|assumption|].
  assert (rising : dg c <= dg d).
  { unfold dg; generalize (slow c d); lra. }
  unfold g in c_value, d_value.
  assert (both : (e - t) * (dg c * (t - b)) <= (t - b) * (dg d * (e - t))).
  { replace ((e - t) * (dg c * (t - b))) with ((e - t) * (t - b) * dg c) by ring.
    replace ((t - b) * (dg d * (e - t))) with ((e - t) * (t - b) * dg d) by ring.
    apply Rmult_le_compat_l; [nra|assumption]. }
  rewrite <- c_value, <- d_value in both.
  apply Rmult_le_reg_l with (e - b); [lra|].
  replace ((e - b) * (f b + (t - b) / (e - b) * (f e - f b) + a / 2 * (t - b) * (e - t)))
    with ((e - b) * f b + (t - b) * (f e - f b) + (e - b) * (a / 2 * (t - b) * (e - t)))
    by (field; lra).
  nra.
Qed.

(* In the plane. *)
Theorem chord (x y vx vy : R -> R) a b e t :
  0 <= a -> b < e -> b <= t <= e ->
  moves x y vx vy -> steady vx vy a b e ->
  let s := (t - b) / (e - b) in
  norm (x t - (x b + s * (x e - x b))) (y t - (y b + s * (y e - y b))) <= a / 2 * (t - b) * (e - t).
Proof.
  intros pos order inside motion slow s.
  assert (0 <= a * ((t - b) * (e - t))) by (apply Rmult_le_pos; [assumption|apply Rmult_le_pos; lra]).
  apply norm_by_projections; [lra|].
  intros p q unit.
  assert (line := chord_line (fun u => p * x u + q * y u) (fun u => p * vx u + q * vy u) a b e t order inside).
  assert (goal : p * x t + q * y t <= p * x b + q * y b + s * (p * x e + q * y e - (p * x b + q * y b))
                 + a / 2 * (t - b) * (e - t)).
  { apply line.
    - intros u; destruct (motion u) as [mx my].
      apply (is_derive_plus (fun v => p * x v) (fun v => q * y v) u (p * vx u) (q * vy u)).
      + apply (is_derive_scal x u p (vx u)); assumption.
      + apply (is_derive_scal y u q (vy u)); assumption.
    - intros r u first second third.
      generalize (slow r u first second third).
      generalize (dot_le_norm_unit (- p) (- q) (vx u - vx r) (vy u - vy r)).
      intros proj bounded; assert (- p * - p + - q * - q = 1) by lra.
      specialize (proj H0); lra. }
  lra.
Qed.
