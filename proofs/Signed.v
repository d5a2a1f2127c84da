(* The signed distance of a place from what an area forbids: positive where flight is allowed, and never changing by more
   than one is moved. So what holds of the chord of a curve holds of the curve, less its sagitta. *)

From Coq Require Import Reals Lra Psatz List Classical.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Bound Area.
Import ListNotations.
Open Scope R_scope.

(* A line of edges from a corner over others; it ends where it begins. *)
Definition ring : Type := (R * R) * list (R * R).

Inductive shape :=
| Disc (x y radius : R)
| Rings (rings : list ring).  (* the outer one and those around holes *)

Fixpoint on_line (corner : R * R) (others : list (R * R)) (x y : R) : Prop :=
  match others with
  | [] => False
  | next :: rest =>
      (exists s, inside_unit s /\ x = on_x (fst corner) (fst next) s /\ y = on_x (snd corner) (snd next) s)
      \/ on_line next rest x y
  end.

Definition on_edges (rings : list ring) (x y : R) : Prop := exists r, In r rings /\ on_line (fst r) (snd r) x y.

Fixpoint winding (rings : list ring) (px py : R) : R :=
  match rings with
  | [] => 0
  | r :: rest => angles (fst r) (snd r) px py + winding rest px py
  end.

Definition closed (rings : list ring) : Prop := forall r, In r rings -> last (snd r) (fst r) = fst r.

Definition well_formed (s : shape) : Prop := match s with Disc _ _ _ => True | Rings rings => closed rings end.

Definition inside (rings : list ring) (px py : R) : Prop := PI < Rabs (winding rings px py).

(* On which side flight is allowed: outside of an area to be kept out of, inside of one to be kept in. *)
Definition allowed (out : bool) (rings : list ring) (px py : R) : Prop :=
  if out then ~ inside rings px py else inside rings px py.

(* The signed distance is m or more: an edge is no farther than -m, or flight is allowed and no edge nearer than m. *)
Definition keeps (out : bool) (s : shape) (px py m : R) : Prop :=
  match s with
  | Disc x y radius =>
      m <= if out then norm (px - x) (py - y) - radius else radius - norm (px - x) (py - y)
  | Rings rings =>
      (m <= 0 /\ exists x y, on_edges rings x y /\ norm (px - x) (py - y) <= - m)
      \/ (allowed out rings px py /\ forall x y, on_edges rings x y -> m <= norm (px - x) (py - y))
  end.

Lemma keeps_less out s px py m n : n <= m -> keeps out s px py m -> keeps out s px py n.
Proof.
  intros less; destruct s as [x y radius|rings]; simpl; [destruct out; lra|].
  intros [[sign [x [y [edge near]]]] | [side far]].
  - left; split; [lra|]; exists x, y; split; [assumption|lra].
  - right; split; [assumption|]; intros x y edge; generalize (far x y edge); lra.
Qed.

Lemma norm_apart x y : 0 < norm x y \/ (x = 0 /\ y = 0).
Proof.
  destruct (Req_dec (norm x y) 0) as [zero|some]; [right|left; generalize (norm_pos x y); lra].
  assert (square := norm_square x y); rewrite zero, Rmult_0_l in square; split; nra.
Qed.

Lemma off_by_not_on corner others px py : ~ on_line corner others px py -> off_edges corner others px py.
Proof.
  revert corner; induction others as [|next rest IH]; simpl; intros corner off; [exact I|split].
  - intros s s_in.
    destruct (norm_apart (px - on_x (fst corner) (fst next) s) (py - on_x (snd corner) (snd next) s)) as [far|[x y]];
      [exact far|].
    exfalso; apply off; left; exists s; split; [exact s_in|split; lra].
  - apply IH; intros on; apply off; right; exact on.
Qed.

(* A straight way that meets no edge stays on the side on which it begins. *)
Lemma side_stays rings px py qx qy :
  closed rings -> (forall s, inside_unit s -> ~ on_edges rings (on_x px qx s) (on_x py qy s)) ->
  winding rings qx qy = winding rings px py.
Proof.
  intros ends free; induction rings as [|r rest IH]; [reflexivity|simpl].
  rewrite IH.
  2: { intros one member; apply ends; right; exact member. }
  2: { intros s s_in [one [member on]]; apply (free s s_in); exists one; split; [right|]; assumption. }
  f_equal.
  assert (motion : moves (on_x px qx) (on_x py qy) (fun _ => qx - px) (fun _ => qy - py)).
  { intros t; unfold on_x; split; auto_derive; try exact I; ring. }
  assert (order : 0 <= 1) by lra.
  assert (same := winding_constant _ _ _ _ (fst r) (snd r) 0 1 order motion (ends r (or_introl eq_refl))).
  replace qx with (on_x px qx 1) at 1 by (unfold on_x; ring).
  replace qy with (on_x py qy 1) at 1 by (unfold on_x; ring).
  rewrite same.
  - f_equal; unfold on_x; ring.
  - intros t t_in; apply off_by_not_on; intros on; apply (free t t_in); exists r; split; [left; reflexivity|exact on].
Qed.

Lemma along px qx s : px - on_x px qx s = s * (px - qx).
Proof. unfold on_x; ring. Qed.

Lemma along_end px qx s : qx - on_x px qx s = (1 - s) * (qx - px).
Proof. unfold on_x; ring. Qed.

(* The signed distance changes by no more than one is moved. *)
Theorem keeps_near out s px py qx qy m d :
  well_formed s -> norm (px - qx) (py - qy) <= d -> keeps out s px py m -> keeps out s qx qy (m - d).
Proof.
  intros ends near; destruct s as [x y radius|rings]; simpl in *.
  - assert (one := norm_triangle (px - qx) (py - qy) (qx - x) (qy - y)).
    assert (two := norm_triangle (qx - px) (qy - py) (px - x) (py - y)).
    replace (px - qx + (qx - x)) with (px - x) in one by ring; replace (py - qy + (qy - y)) with (py - y) in one by ring.
    replace (qx - px + (px - x)) with (qx - x) in two by ring; replace (qy - py + (py - y)) with (qy - y) in two by ring.
    replace (norm (qx - px) (qy - py)) with (norm (px - qx) (py - qy)) in two by (unfold norm; f_equal; ring).
    destruct out; lra.
  - assert (moved : forall x y, norm (px - x) (py - y) - d <= norm (qx - x) (qy - y)
      /\ norm (qx - x) (qy - y) <= norm (px - x) (py - y) + d).
    { intros x y.
      assert (one := norm_triangle (px - qx) (py - qy) (qx - x) (qy - y)).
      assert (two := norm_triangle (qx - px) (qy - py) (px - x) (py - y)).
      replace (px - qx + (qx - x)) with (px - x) in one by ring; replace (py - qy + (qy - y)) with (py - y) in one by ring.
      replace (qx - px + (px - x)) with (qx - x) in two by ring; replace (qy - py + (py - y)) with (qy - y) in two by ring.
      replace (norm (qx - px) (qy - py)) with (norm (px - qx) (py - qy)) in two by (unfold norm; f_equal; ring).
      lra. }
    intros [[sign [x [y [edge close]]]] | [side far]].
    + left; generalize (norm_pos (px - qx) (py - qy)) (moved x y); intros pos [_ less].
      split; [lra|]; exists x, y; split; [assumption|lra].
    + destruct (classic (exists s, inside_unit s /\ on_edges rings (on_x px qx s) (on_x py qy s))) as [[s [s_in edge]]|free].
      * (* an edge in between is as far from both as they are apart *)
        left; assert (before := far _ _ edge).
        rewrite !along in before; rewrite norm_scale in before by (unfold inside_unit in s_in; lra).
        assert (swap : norm (qx - px) (qy - py) = norm (px - qx) (py - qy)) by (unfold norm; f_equal; ring).
        assert (after : norm (qx - on_x px qx s) (qy - on_x py qy s) = (1 - s) * norm (px - qx) (py - qy)).
        { rewrite !along_end, norm_scale, swap by (unfold inside_unit in s_in; lra); reflexivity. }
        generalize (norm_pos (px - qx) (py - qy)); intros pos; unfold inside_unit in s_in.
        assert (s * norm (px - qx) (py - qy) <= 1 * norm (px - qx) (py - qy)) by (apply Rmult_le_compat_r; lra).
        split; [lra|].
        exists (on_x px qx s), (on_x py qy s); split; [assumption|rewrite after; lra].
      * right; split.
        { assert (same : winding rings qx qy = winding rings px py).
          { apply side_stays; [assumption|]; intros s s_in edge; apply free; exists s; split; assumption. }
          unfold allowed, inside in *; rewrite same; exact side. }
        intros x y edge; generalize (far x y edge) (moved x y); lra.
Qed.

(* What it means: nothing that is forbidden is nearer, nor what has grown from it. *)
Theorem keeps_away out s px py qx qy m :
  well_formed s -> keeps out s px py m -> (forall k, 0 < k -> ~ keeps out s qx qy k) -> m <= norm (px - qx) (py - qy).
Proof.
  intros ends held forbidden; apply Rnot_lt_le; intros near.
  apply (forbidden (m - norm (px - qx) (py - qy))); [lra|].
  apply (keeps_near out s px py); [assumption|lra|assumption].
Qed.

Theorem keeps_away_grown out s px py qx qy zx zy g m :
  well_formed s -> keeps out s px py (m + g) ->
  norm (qx - zx) (qy - zy) <= g -> (forall k, 0 < k -> ~ keeps out s zx zy k) -> m <= norm (px - qx) (py - qy).
Proof.
  intros ends held near forbidden.
  assert (far := keeps_away out s px py zx zy (m + g) ends held forbidden).
  assert (way := norm_triangle (px - qx) (py - qy) (qx - zx) (qy - zy)).
  replace (px - qx + (qx - zx)) with (px - zx) in way by ring.
  replace (py - qy + (qy - zy)) with (py - zy) in way by ring.
  lra.
Qed.

(* ---- chords ---- *)

(* No edge of a line crosses the chord, and none is nearer than m. *)
Fixpoint line_apart (corner : R * R) (others : list (R * R)) (px py qx qy m : R) : Prop :=
  match others with
  | [] => True
  | next :: rest =>
      ~ crosses px py qx qy (fst corner) (snd corner) (fst next) (snd next)
      /\ m <= edge_distance px py qx qy (fst corner) (snd corner) (fst next) (snd next) - DEGENERATE
      /\ line_apart next rest px py qx qy m
  end.

Definition rings_apart (rings : list ring) (px py qx qy m : R) : Prop :=
  forall r, In r rings -> line_apart (fst r) (snd r) px py qx qy m.

Lemma line_apart_sound corner others px py qx qy m s x y :
  line_apart corner others px py qx qy m -> inside_unit s -> on_line corner others x y ->
  m <= norm (on_x px qx s - x) (on_x py qy s - y).
Proof.
  revert corner; induction others as [|next rest IH]; simpl; intros corner apart s_in on; [contradiction|].
  destruct apart as [free [enough further]].
  destruct on as [[u [u_in [at_x at_y]]] | later]; [|apply (IH next); assumption].
  assert (far := edge_distance_sound px py qx qy _ _ _ _ s u free s_in u_in); unfold gap_x in far.
  rewrite at_x, at_y; lra.
Qed.

(* The ways to see that the signed distance on a chord is m or more. *)
Inductive chord_keeps (out : bool) : shape -> R -> R -> R -> R -> R -> Prop :=
| by_edges rings px py qx qy m : allowed out rings px py -> 0 < m -> rings_apart rings px py qx qy m ->
    chord_keeps out (Rings rings) px py qx qy m
| by_ends s px py qx qy k l : keeps out s px py k -> keeps out s qx qy l ->
    chord_keeps out s px py qx qy ((k + l - norm (px - qx) (py - qy)) / 2)
| by_centre x y radius px py qx qy : out = true ->
    chord_keeps out (Disc x y radius) px py qx qy (nearest (px - x) (py - y) (qx - x) (qy - y) - DEGENERATE - radius)
| by_farthest x y radius px py qx qy : out = false ->
    chord_keeps out (Disc x y radius) px py qx qy (radius - Rmax (norm (px - x) (py - y)) (norm (qx - x) (qy - y))).

Theorem chord_keeps_sound out s px py qx qy m u :
  well_formed s -> chord_keeps out s px py qx qy m -> inside_unit u -> keeps out s (on_x px qx u) (on_x py qy u) m.
Proof.
  intros ends how u_in; destruct how as [rings px py qx qy m side pos apart|s px py qx qy k l first last
    |x y radius px py qx qy is_out|x y radius px py qx qy is_in].
  - (* it meets no edge up to there *)
    right.
    assert (far : forall v x y, inside_unit v -> on_edges rings x y -> m <= norm (on_x px qx v - x) (on_x py qy v - y)).
    { intros v x y v_in [r [member on]]; apply (line_apart_sound (fst r) (snd r)); [apply apart| |]; assumption. }
    split; [|intros x y; apply far; assumption].
    assert (same : winding rings (on_x px qx u) (on_x py qy u) = winding rings px py).
    { apply side_stays; [assumption|]; intros v v_in edge.
      assert (uv_in : inside_unit (u * v)).
      { unfold inside_unit in *; split; [apply Rmult_le_pos; lra|].
        assert (u * v <= 1 * 1) by (apply Rmult_le_compat; lra); lra. }
      generalize (far (u * v) _ _ uv_in edge).
      replace (on_x px qx (u * v) - on_x px (on_x px qx u) v) with 0 by (unfold on_x; ring).
      replace (on_x py qy (u * v) - on_x py (on_x py qy u) v) with 0 by (unfold on_x; ring).
      rewrite norm_zero; lra. }
    unfold allowed, inside in *; rewrite same; exact side.
  - set (d := norm (px - qx) (py - qy)).
    unfold inside_unit in u_in.
    assert (from_first : keeps out s (on_x px qx u) (on_x py qy u) (k - u * d)).
    { apply (keeps_near out s px py); [assumption| |assumption].
      rewrite !along, norm_scale by lra; unfold d; lra. }
    assert (from_last : keeps out s (on_x px qx u) (on_x py qy u) (l - (1 - u) * d)).
    { apply (keeps_near out s qx qy); [assumption| |assumption].
      rewrite !along_end, norm_scale by lra; unfold d; right; f_equal; unfold norm; f_equal; ring. }
    destruct (Rle_dec ((k + l - d) / 2) (k - u * d)).
    + apply (keeps_less _ _ _ _ _ _ r from_first).
    + apply (keeps_less _ _ _ _ (l - (1 - u) * d)); [lra|assumption].
  - subst out; simpl.
    assert (near := nearest_is_nearest (px - x) (py - y) (qx - x) (qy - y) u u_in).
    replace (on_x (px - x) (qx - x) u) with (on_x px qx u - x) in near by (unfold on_x; ring).
    replace (on_x (py - y) (qy - y) u) with (on_x py qy u - y) in near by (unfold on_x; ring).
    lra.
  - subst out; simpl; unfold inside_unit in u_in.
    set (M := Rmax (norm (px - x) (py - y)) (norm (qx - x) (qy - y))).
    enough (norm (on_x px qx u - x) (on_x py qy u - y) <= M) by lra.
    replace (on_x px qx u - x) with ((1 - u) * (px - x) + u * (qx - x)) by (unfold on_x; ring).
    replace (on_x py qy u - y) with ((1 - u) * (py - y) + u * (qy - y)) by (unfold on_x; ring).
    apply Rle_trans with (1 := norm_triangle _ _ _ _); rewrite !norm_scale by lra.
    assert (norm (px - x) (py - y) <= M) by apply Rmax_l; assert (norm (qx - x) (qy - y) <= M) by apply Rmax_r.
    assert ((1 - u) * norm (px - x) (py - y) <= (1 - u) * M) by (apply Rmult_le_compat_l; lra).
    assert (u * norm (qx - x) (qy - y) <= u * M) by (apply Rmult_le_compat_l; lra).
    lra.
Qed.

(* The next chord begins on the side on which one ends that keeps away from all edges. *)
Theorem side_carried out rings px py qx qy m :
  closed rings -> allowed out rings px py -> 0 < m -> rings_apart rings px py qx qy m -> allowed out rings qx qy.
Proof.
  intros ends side pos apart.
  assert (one : inside_unit 1) by (unfold inside_unit; lra).
  destruct (chord_keeps_sound out (Rings rings) px py qx qy m 1 ends) as [[sign _] | [there _]];
    [apply by_edges; assumption|assumption|lra|].
  replace (on_x px qx 1) with qx in there by (unfold on_x; ring).
  replace (on_x py qy 1) with qy in there by (unfold on_x; ring).
  exact there.
Qed.

(* A whole part of a curve that leaves its chord by so much at most; its ends are known but for an error. *)
Theorem part_keeps out s (x y vx vy : R -> R) a error b e xb yb xe ye m t :
  well_formed s -> 0 <= a -> b < e -> b <= t <= e -> moves x y vx vy -> steady vx vy a b e ->
  norm (xb - x b) (yb - y b) <= error -> norm (xe - x e) (ye - y e) <= error ->
  chord_keeps out s xb yb xe ye m ->
  keeps out s (x t) (y t) (m - a / 8 * ((e - b) * (e - b)) - error).
Proof.
  intros ends pos order within motion slow at_b at_e held.
  set (u := (t - b) / (e - b)).
  assert (u_in : inside_unit u).
  { unfold u, inside_unit; split.
    - apply Rmult_le_pos; [lra|left; apply Rinv_0_lt_compat; lra].
    - apply Rmult_le_reg_r with (e - b); [lra|].
      replace ((t - b) / (e - b) * (e - b)) with (t - b) by (field; lra); lra. }
  assert (bow := chord x y vx vy a b e t pos order within motion slow); fold u in bow; simpl in bow.
  assert (most : a / 2 * (t - b) * (e - t) <= a / 8 * ((e - b) * (e - b))).
  { assert (4 * ((t - b) * (e - t)) <= (e - b) * (e - b)).
    { generalize (Rle_0_sqr ((t - b) - (e - t))); unfold Rsqr; nra. }
    assert (a / 8 * (4 * ((t - b) * (e - t))) <= a / 8 * ((e - b) * (e - b))) by (apply Rmult_le_compat_l; lra).
    lra. }
  replace (m - a / 8 * ((e - b) * (e - b)) - error) with (m - (a / 8 * ((e - b) * (e - b)) + error)) by ring.
  apply (keeps_near out s (on_x xb xe u) (on_x yb ye u)); [assumption| |apply chord_keeps_sound; assumption].
  (* first to the chord between the true ends, then to the curve *)
  assert (off : norm (on_x xb xe u - (x b + u * (x e - x b))) (on_x yb ye u - (y b + u * (y e - y b))) <= error).
  { replace (on_x xb xe u - (x b + u * (x e - x b))) with ((1 - u) * (xb - x b) + u * (xe - x e)) by (unfold on_x; ring).
    replace (on_x yb ye u - (y b + u * (y e - y b))) with ((1 - u) * (yb - y b) + u * (ye - y e)) by (unfold on_x; ring).
    unfold inside_unit in u_in.
    apply Rle_trans with (1 := norm_triangle _ _ _ _); rewrite !norm_scale by lra.
    assert ((1 - u) * norm (xb - x b) (yb - y b) <= (1 - u) * error) by (apply Rmult_le_compat_l; lra).
    assert (u * norm (xe - x e) (ye - y e) <= u * error) by (apply Rmult_le_compat_l; lra).
    lra. }
  assert (way := norm_triangle (on_x xb xe u - (x b + u * (x e - x b))) (on_x yb ye u - (y b + u * (y e - y b)))
    (x b + u * (x e - x b) - x t) (y b + u * (y e - y b) - y t)).
  replace (on_x xb xe u - (x b + u * (x e - x b)) + (x b + u * (x e - x b) - x t)) with (on_x xb xe u - x t) in way by ring.
  replace (on_x yb ye u - (y b + u * (y e - y b)) + (y b + u * (y e - y b) - y t)) with (on_x yb ye u - y t) in way by ring.
  replace (norm (x b + u * (x e - x b) - x t) (y b + u * (y e - y b) - y t))
    with (norm (x t - (x b + u * (x e - x b))) (y t - (y b + u * (y e - y b)))) in way by (unfold norm; f_equal; ring).
  lra.
Qed.
