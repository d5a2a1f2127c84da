(* Edges of an area, as envs/area_geometry.py looks at them: the distance between a chord and an edge, and on which side
   of the edges a point is. A test translates the definitions of this file and compares them with the code. *)

From Coq Require Import Reals Lra Psatz List.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Bound.
Import ListNotations.
Open Scope R_scope.

(* The distance of the origin from the segment between two points, as of Bound.v. *)
Definition point_edge (px py ax ay bx by_ : R) : R := nearest (ax - px) (ay - py) (bx - px) (by_ - py).

(* Of a chord from p to q and an edge from a to b, where they do not cross. *)
Definition edge_distance (px py qx qy ax ay bx by_ : R) : R :=
  Rmin (Rmin (point_edge px py ax ay bx by_) (point_edge qx qy ax ay bx by_))
       (Rmin (point_edge ax ay px py qx qy) (point_edge bx by_ px py qx qy)).

(* On which side of the line through a and b a point is. *)
Definition side (ax ay bx by_ px py : R) : R := (bx - ax) * (py - ay) - (by_ - ay) * (px - ax).

(* Both ends of each are strictly on different sides of the other. *)
Definition crosses (px py qx qy ax ay bx by_ : R) : Prop :=
  side ax ay bx by_ px py * side ax ay bx by_ qx qy < 0 /\ side px py qx qy ax ay * side px py qx qy bx by_ < 0.

(* The difference between a point of the chord and a point of the edge. *)
Definition gap_x (px qx ax bx s u : R) : R := on_x px qx s - on_x ax bx u.

Definition inside_unit (s : R) : Prop := 0 <= s <= 1.

Definition border (s u : R) : Prop :=
  inside_unit s /\ inside_unit u /\ (s = 0 \/ s = 1 \/ u = 0 \/ u = 1).

(* From a share towards another value, how far one gets without leaving [0, 1]. *)
Lemma leaves s z : inside_unit s ->
  exists l, 0 <= l <= 1 /\ (forall k, 0 <= k <= l -> inside_unit (s + k * (z - s))) /\
    (l = 1 \/ s + l * (z - s) = 0 \/ s + l * (z - s) = 1).
Proof.
  intros [low high].
  destruct (Rlt_dec 1 z) as [above | notabove]; [|destruct (Rlt_dec z 0) as [below | notbelow]].
  - exists ((1 - s) / (z - s)).
    assert (0 < z - s) by lra.
    assert (quotient : (1 - s) / (z - s) * (z - s) = 1 - s) by (field; lra).
    assert (0 <= (1 - s) / (z - s) <= 1).
    { split; [apply Rmult_le_pos; [lra|left; apply Rinv_0_lt_compat; lra]|].
      apply Rmult_le_reg_r with (z - s); [lra|]; rewrite quotient; lra. }
    split; [assumption|split].
    + intros k [one two]; unfold inside_unit.
      assert (0 <= k * (z - s)) by (apply Rmult_le_pos; lra).
      assert (k * (z - s) <= (1 - s) / (z - s) * (z - s)) by (apply Rmult_le_compat_r; lra).
      lra.
    + right; right; rewrite quotient; lra.
  - exists (s / (s - z)).
    assert (0 < s - z) by lra.
    assert (quotient : s / (s - z) * (z - s) = - s) by (field; lra).
    assert (0 <= s / (s - z) <= 1).
    { split; [apply Rmult_le_pos; [lra|left; apply Rinv_0_lt_compat; lra]|].
      apply Rmult_le_reg_r with (s - z); [lra|].
      replace (s / (s - z) * (s - z)) with s by (field; lra); lra. }
    split; [assumption|split].
    + intros k [one two]; unfold inside_unit.
      assert (0 <= k * (s - z)) by (apply Rmult_le_pos; lra).
      assert (k * (s - z) <= s / (s - z) * (s - z)) by (apply Rmult_le_compat_r; lra).
      replace (s / (s - z) * (s - z)) with s in H2 by (field; lra).
      lra.
    + right; left; rewrite quotient; lra.
  - exists 1; split; [lra|split; [|left; reflexivity]].
    intros k [one two]; unfold inside_unit.
    replace (s + k * (z - s)) with ((1 - k) * s + k * z) by ring.
    assert (0 <= (1 - k) * s) by (apply Rmult_le_pos; lra).
    assert (0 <= k * z) by (apply Rmult_le_pos; lra).
    assert (k * z <= k * 1) by (apply Rmult_le_compat_l; lra).
    assert ((1 - k) * s <= (1 - k) * 1) by (apply Rmult_le_compat_l; lra).
    lra.
Qed.

(* From a point of the unit square towards one that is not in its interior one meets the border. *)
Lemma meets_border s u zs zu : inside_unit s -> inside_unit u -> ~ (0 < zs < 1 /\ 0 < zu < 1) ->
  exists l, 0 <= l <= 1 /\ border (s + l * (zs - s)) (u + l * (zu - u)).
Proof.
  intros s_in u_in out.
  destruct (leaves s zs s_in) as [l [l_in [l_stays l_end]]].
  destruct (leaves u zu u_in) as [m [m_in [m_stays m_end]]].
  destruct (Rle_dec l m) as [first | second].
  - exists l; split; [assumption|split; [apply l_stays; lra|split; [apply m_stays; lra|]]].
    destruct l_end as [one | [zero | full]]; [|left; assumption|right; left; assumption].
    subst l; assert (m = 1) by lra; subst m.
    destruct (l_stays 1) as [a b]; [lra|].
    destruct (m_stays 1) as [c d]; [lra|].
    replace (s + 1 * (zs - s)) with zs in * by ring.
    replace (u + 1 * (zu - u)) with zu in * by ring.
    destruct (Req_dec zs 0); [left; assumption|].
    destruct (Req_dec zs 1); [right; left; assumption|].
    destruct (Req_dec zu 0); [right; right; left; assumption|].
    destruct (Req_dec zu 1); [right; right; right; assumption|].
    exfalso; apply out; lra.
  - exists m; split; [assumption|split; [apply l_stays; lra|split; [apply m_stays; lra|]]].
    destruct m_end as [one | [zero | full]]; [lra|right; right; left; assumption|right; right; right; assumption].
Qed.

(* On the border the distance is at least the smallest of the four. *)
Lemma on_border px py qx qy ax ay bx by_ s u : border s u ->
  edge_distance px py qx qy ax ay bx by_ - DEGENERATE <= norm (gap_x px qx ax bx s u) (gap_x py qy ay by_ s u).
Proof.
  intros [s_in [u_in where_]].
  unfold edge_distance, gap_x.
  set (m1 := point_edge px py ax ay bx by_); set (m2 := point_edge qx qy ax ay bx by_).
  set (m3 := point_edge ax ay px py qx qy); set (m4 := point_edge bx by_ px py qx qy).
  assert (Rmin (Rmin m1 m2) (Rmin m3 m4) <= m1 /\ Rmin (Rmin m1 m2) (Rmin m3 m4) <= m2 /\
    Rmin (Rmin m1 m2) (Rmin m3 m4) <= m3 /\ Rmin (Rmin m1 m2) (Rmin m3 m4) <= m4) as [b1 [b2 [b3 b4]]].
  { generalize (Rmin_l (Rmin m1 m2) (Rmin m3 m4)) (Rmin_r (Rmin m1 m2) (Rmin m3 m4))
      (Rmin_l m1 m2) (Rmin_r m1 m2) (Rmin_l m3 m4) (Rmin_r m3 m4); lra. }
  destruct where_ as [zero | [one | [zero | one]]]; subst.
  - generalize (nearest_is_nearest (ax - px) (ay - py) (bx - px) (by_ - py) u u_in); fold m1.
    replace (on_x px qx 0 - on_x ax bx u) with (- on_x (ax - px) (bx - px) u) by (unfold on_x; ring).
    replace (on_x py qy 0 - on_x ay by_ u) with (- on_x (ay - py) (by_ - py) u) by (unfold on_x; ring).
    rewrite norm_opp; unfold m1, point_edge in *; lra.
  - generalize (nearest_is_nearest (ax - qx) (ay - qy) (bx - qx) (by_ - qy) u u_in).
    replace (on_x px qx 1 - on_x ax bx u) with (- on_x (ax - qx) (bx - qx) u) by (unfold on_x; ring).
    replace (on_x py qy 1 - on_x ay by_ u) with (- on_x (ay - qy) (by_ - qy) u) by (unfold on_x; ring).
    rewrite norm_opp; unfold m2, point_edge in *; lra.
  - generalize (nearest_is_nearest (px - ax) (py - ay) (qx - ax) (qy - ay) s s_in).
    replace (on_x px qx s - on_x ax bx 0) with (on_x (px - ax) (qx - ax) s) by (unfold on_x; ring).
    replace (on_x py qy s - on_x ay by_ 0) with (on_x (py - ay) (qy - ay) s) by (unfold on_x; ring).
    unfold m3, point_edge in *; lra.
  - generalize (nearest_is_nearest (px - bx) (py - by_) (qx - bx) (qy - by_) s s_in).
    replace (on_x px qx s - on_x ax bx 1) with (on_x (px - bx) (qx - bx) s) by (unfold on_x; ring).
    replace (on_x py qy s - on_x ay by_ 1) with (on_x (py - by_) (qy - by_) s) by (unfold on_x; ring).
    unfold m4, point_edge in *; lra.
Qed.

(* Moving both shares in a direction in which the gap shrinks in proportion leads to the border. *)
Lemma shrinks px qx ax bx s u zs zu l :
  gap_x px qx ax bx (s + l * (zs - s)) (u + l * (zu - u)) =
  (1 - l) * gap_x px qx ax bx s u + l * gap_x px qx ax bx zs zu.
Proof. unfold gap_x, on_x; ring. Qed.

Lemma towards px py qx qy ax ay bx by_ s u zs zu k :
  inside_unit s -> inside_unit u -> ~ (0 < zs < 1 /\ 0 < zu < 1) -> 0 <= k <= 1 ->
  gap_x px qx ax bx zs zu = k * gap_x px qx ax bx s u -> gap_x py qy ay by_ zs zu = k * gap_x py qy ay by_ s u ->
  edge_distance px py qx qy ax ay bx by_ - DEGENERATE <= norm (gap_x px qx ax bx s u) (gap_x py qy ay by_ s u).
Proof.
  intros s_in u_in out share x_shrinks y_shrinks.
  destruct (meets_border s u zs zu s_in u_in out) as [l [l_in at_border]].
  apply Rle_trans with (1 := on_border px py qx qy ax ay bx by_ _ _ at_border).
  rewrite !shrinks, x_shrinks, y_shrinks.
  set (x := gap_x px qx ax bx s u); set (y := gap_x py qy ay by_ s u).
  replace ((1 - l) * x + l * (k * x)) with ((1 - l + l * k) * x) by ring.
  replace ((1 - l) * y + l * (k * y)) with ((1 - l + l * k) * y) by ring.
  assert (0 <= l * k) by (apply Rmult_le_pos; lra).
  assert (l * k <= l * 1) by (apply Rmult_le_compat_l; lra).
  rewrite norm_scale by lra.
  generalize (norm_pos x y); intros.
  assert ((1 - l + l * k) * norm x y <= 1 * norm x y) by (apply Rmult_le_compat_r; lra).
  lra.
Qed.

(* A chord and an edge that do not cross are nowhere nearer than at an end of one of them. *)
Theorem edge_distance_sound px py qx qy ax ay bx by_ s u :
  ~ crosses px py qx qy ax ay bx by_ -> inside_unit s -> inside_unit u ->
  edge_distance px py qx qy ax ay bx by_ - DEGENERATE <= norm (gap_x px qx ax bx s u) (gap_x py qy ay by_ s u).
Proof.
  intros apart s_in u_in.
  set (dx := qx - px); set (dy := qy - py); set (ex := bx - ax); set (ey := by_ - ay).
  set (det := ex * dy - ey * dx).
  destruct (Req_dec det 0) as [parallel | skew].
  - (* along their common direction the gap stays the same *)
    destruct (Req_dec (dx * dx + dy * dy) 0) as [short | long].
    + assert (dx = 0 /\ dy = 0) as [zx zy] by (split; nra).
      apply (towards _ _ _ _ _ _ _ _ s u 0 u 1 s_in u_in); [lra|lra| |];
        unfold gap_x, on_x; fold dx dy ex ey; rewrite ?zx, ?zy; ring.
    + (* the chord's share moves with the edge's *)
      set (r := (ex * dx + ey * dy) / (dx * dx + dy * dy)).
      assert (along_x : ex = r * dx).
      { unfold r; apply Rmult_eq_reg_r with (dx * dx + dy * dy); [|assumption].
        replace ((ex * dx + ey * dy) / (dx * dx + dy * dy) * dx * (dx * dx + dy * dy)) with ((ex * dx + ey * dy) * dx) by (field; assumption).
        unfold det in parallel; replace (ex * (dx * dx + dy * dy)) with (ex * dx * dx + (ex * dy) * dy) by ring.
        replace (ex * dy) with (ey * dx) by lra; ring. }
      assert (along_y : ey = r * dy).
      { unfold r; apply Rmult_eq_reg_r with (dx * dx + dy * dy); [|assumption].
        replace ((ex * dx + ey * dy) / (dx * dx + dy * dy) * dy * (dx * dx + dy * dy)) with ((ex * dx + ey * dy) * dy) by (field; assumption).
        unfold det in parallel; replace (ey * (dx * dx + dy * dy)) with ((ey * dx) * dx + ey * dy * dy) by ring.
        replace (ey * dx) with (ex * dy) by lra; ring. }
      (* the edge's share goes to 0, the chord's follows *)
      apply (towards _ _ _ _ _ _ _ _ s u (s - r * u) 0 1 s_in u_in); [lra|lra| |];
        unfold gap_x, on_x; fold dx dy ex ey; rewrite ?along_x, ?along_y; ring.
  - (* towards where the lines meet the gap shrinks to nothing *)
    set (so := side ax ay bx by_ px py); set (sq := side ax ay bx by_ qx qy).
    set (to := side px py qx qy ax ay); set (tq := side px py qx qy bx by_).
    assert (turn_s : so - sq = - det) by (unfold so, sq, side, det; fold ex ey; unfold dx, dy; ring).
    assert (turn_t : to - tq = det) by (unfold to, tq, side, det; fold dx dy; unfold ex, ey; ring).
    apply (towards _ _ _ _ _ _ _ _ s u (so / - det) (to / det) 0 s_in u_in).
    + intros [[s1 s2] [u1 u2]]; apply apart; unfold crosses; fold so sq to tq.
      assert (so = so / - det * - det) as so_is by (field; lra).
      assert (to = to / det * det) as to_is by (field; lra).
      set (zs := so / - det) in *; set (zu := to / det) in *.
      assert (0 < det * det) by (generalize (Rle_0_sqr det); unfold Rsqr; intros; destruct (Req_dec (det * det) 0); [nra|lra]).
      assert (sq_is : sq = (zs - 1) * - det) by lra.
      assert (tq_is : tq = (zu - 1) * det) by lra.
      assert (0 < zs * (1 - zs)) by (apply Rmult_lt_0_compat; lra).
      assert (0 < zu * (1 - zu)) by (apply Rmult_lt_0_compat; lra).
      assert (0 < zs * (1 - zs) * (det * det)) by (apply Rmult_lt_0_compat; assumption).
      assert (0 < zu * (1 - zu) * (det * det)) by (apply Rmult_lt_0_compat; assumption).
      split.
      * rewrite sq_is, so_is; nra.
      * rewrite tq_is, to_is; nra.
    + lra.
    + unfold gap_x, on_x, so, to, side; fold dx dy ex ey.
      replace bx with (ax + ex) by (unfold ex; ring).
      unfold det; rewrite Rmult_0_l; field; unfold det in skew; lra.
    + unfold gap_x, on_x, so, to, side; fold dx dy ex ey.
      unfold det; rewrite Rmult_0_l; field; unfold det in skew; lra.
Qed.

(* ---- on which side of the edges ---- *)

(* The angle under which the vector (ux, uy) turns into (vx, vy). *)
Definition angle (ux uy vx vy : R) : R :=
  2 * atan ((ux * vy - uy * vx) / (norm ux uy * norm vx vy + (ux * vx + uy * vy))).

(* It is defined where the origin is not on the segment between both. *)
Lemma off_edge ux uy vx vy :
  (forall s, inside_unit s -> 0 < norm (on_x ux vx s) (on_x uy vy s)) ->
  0 < norm ux uy /\ 0 < norm vx vy /\ 0 < norm ux uy * norm vx vy + (ux * vx + uy * vy).
Proof.
  intros away.
  assert (first : 0 < norm ux uy).
  { assert (h : inside_unit 0) by (unfold inside_unit; lra).
    generalize (away 0 h); unfold on_x; rewrite !Rmult_0_l, !Rplus_0_r; trivial. }
  assert (last : 0 < norm vx vy).
  { assert (h : inside_unit 1) by (unfold inside_unit; lra).
    generalize (away 1 h); unfold on_x.
    replace (ux + 1 * (vx - ux)) with vx by ring; replace (uy + 1 * (vy - uy)) with vy by ring; trivial. }
  split; [assumption|split; [assumption|]].
  set (r := norm ux uy) in *; set (s := norm vx vy) in *.
  assert (least : 0 <= r * s + (ux * vx + uy * vy)).
  { generalize (dot_le_norm (- ux) (- uy) vx vy); rewrite norm_opp; fold r s; lra. }
  destruct (Req_dec (r * s + (ux * vx + uy * vy)) 0) as [zero | some]; [exfalso|lra].
  set (k := r / (r + s)).
  assert (0 < r + s) by lra.
  assert (k_in : inside_unit k).
  { unfold k, inside_unit; split; [apply Rmult_le_pos; [lra|left; apply Rinv_0_lt_compat; lra]|].
    apply Rmult_le_reg_r with (r + s); [lra|].
    replace (r / (r + s) * (r + s)) with r by (field; lra); lra. }
  assert (square_r : r * r = ux * ux + uy * uy) by apply norm_square.
  assert (square_s : s * s = vx * vx + vy * vy) by apply norm_square.
  generalize (away k k_in); unfold on_x.
  assert (same_x : (ux + k * (vx - ux)) * (r + s) = s * ux + r * vx) by (unfold k; field; lra).
  assert (same_y : (uy + k * (vy - uy)) * (r + s) = s * uy + r * vy) by (unfold k; field; lra).
  assert (none : (s * ux + r * vx) * (s * ux + r * vx) + (s * uy + r * vy) * (s * uy + r * vy) = 0).
  { replace ((s * ux + r * vx) * (s * ux + r * vx) + (s * uy + r * vy) * (s * uy + r * vy))
      with ((s * s) * (ux * ux + uy * uy) + (r * r) * (vx * vx + vy * vy) + 2 * (r * s) * (ux * vx + uy * vy)) by ring.
    rewrite <- square_r, <- square_s.
    replace (ux * vx + uy * vy) with (- (r * s)) by lra; ring. }
  assert (none_x : ux + k * (vx - ux) = 0).
  { apply Rmult_eq_reg_r with (r + s); [|lra]; rewrite same_x, Rmult_0_l.
    apply Rsqr_0_uniq; unfold Rsqr.
    generalize (Rle_0_sqr (s * ux + r * vx)) (Rle_0_sqr (s * uy + r * vy)); unfold Rsqr; lra. }
  assert (none_y : uy + k * (vy - uy) = 0).
  { apply Rmult_eq_reg_r with (r + s); [|lra]; rewrite same_y, Rmult_0_l.
    apply Rsqr_0_uniq; unfold Rsqr.
    generalize (Rle_0_sqr (s * ux + r * vx)) (Rle_0_sqr (s * uy + r * vy)); unfold Rsqr; lra. }
  rewrite none_x, none_y, norm_zero; lra.
Qed.

Lemma derive_norm (x y : R -> R) dx dy t : is_derive x t dx -> is_derive y t dy -> 0 < norm (x t) (y t) ->
  is_derive (fun s => norm (x s) (y s)) t ((x t * dx + y t * dy) / norm (x t) (y t)).
Proof.
  intros one two pos.
  assert (inner : 0 < x t * x t + y t * y t).
  { rewrite <- norm_square; apply Rmult_lt_0_compat; assumption. }
  unfold norm; auto_derive.
  - repeat split; try (eexists; eassumption); try exact inner.
  - replace (Derive (fun s => x s) t) with dx by (symmetry; apply is_derive_unique; exact one).
    replace (Derive (fun s => y s) t) with dy by (symmetry; apply is_derive_unique; exact two).
    fold (norm (x t) (y t)); field; lra.
Qed.

Lemma derive_angle (c q : R -> R) dc dq t : is_derive c t dc -> is_derive q t dq -> 0 < q t ->
  is_derive (fun s => 2 * atan (c s / q s)) t (2 * (dc * q t - c t * dq) / (q t * q t + c t * c t)).
Proof.
  intros one two pos; auto_derive.
  - repeat split; try (eexists; eassumption); lra.
  - replace (Derive (fun s => c s) t) with dc by (symmetry; apply is_derive_unique; exact one).
    replace (Derive (fun s => q s) t) with dq by (symmetry; apply is_derive_unique; exact two).
    assert (0 < q t * q t) by (apply Rmult_lt_0_compat; assumption).
    assert (0 <= c t * c t) by nra.
    field; repeat split; try lra; nra.
Qed.

(* How fast the direction of a vector turns. *)
Definition turn (x y dx dy : R) : R := (x * dy - y * dx) / (norm x y * norm x y).

Lemma angle_algebra ux uy vx vy dux duy dvx dvy :
  0 < norm ux uy -> 0 < norm vx vy -> 0 < norm ux uy * norm vx vy + (ux * vx + uy * vy) ->
  let c := ux * vy - uy * vx in
  let q := norm ux uy * norm vx vy + (ux * vx + uy * vy) in
  let dc := dux * vy + ux * dvy - (duy * vx + uy * dvx) in
  let dq := (ux * dux + uy * duy) / norm ux uy * norm vx vy + norm ux uy * ((vx * dvx + vy * dvy) / norm vx vy)
    + (dux * vx + ux * dvx + (duy * vy + uy * dvy)) in
  2 * (dc * q - c * dq) / (q * q + c * c) = turn vx vy dvx dvy - turn ux uy dux duy.
Proof.
  intros first last pos c q dc dq; unfold turn.
  assert (square_r := norm_square ux uy); assert (square_s := norm_square vx vy).
  set (r := norm ux uy) in *; set (s := norm vx vy) in *.
  assert (lagrange : q * q + c * c = 2 * (r * s) * q).
  { unfold q, c.
    replace ((ux * vy - uy * vx) * (ux * vy - uy * vx))
      with ((ux * ux + uy * uy) * (vx * vx + vy * vy) - (ux * vx + uy * vy) * (ux * vx + uy * vy)) by ring.
    rewrite <- square_r, <- square_s; ring. }
  rewrite lagrange.
  fold q in pos.
  assert (0 < r * s) by (apply Rmult_lt_0_compat; assumption).
  assert (goal : r * s * (dc * q) - c * ((ux * dux + uy * duy) * (s * s) + (vx * dvx + vy * dvy) * (r * r)
      + r * s * (dux * vx + ux * dvx + (duy * vy + uy * dvy)))
    = q * ((r * r) * (vx * dvy - vy * dvx) - (s * s) * (ux * duy - uy * dux))).
  { assert (zero : (r * s) * (r * s) = (ux * ux + uy * uy) * (vx * vx + vy * vy)) by (rewrite <- square_r, <- square_s; ring).
    rewrite square_r, square_s.
    unfold q; set (p := r * s) in *.
    replace (p * (dc * (p + (ux * vx + uy * vy)))) with (dc * (p * p) + p * dc * (ux * vx + uy * vy)) by ring.
    rewrite zero; unfold dc, c; ring. }
  apply Rmult_eq_reg_r with (2 * (r * s) * q * (r * s)); [|apply Rgt_not_eq; repeat apply Rmult_lt_0_compat; lra].
  replace (2 * (dc * q - c * dq) / (2 * (r * s) * q) * (2 * (r * s) * q * (r * s)))
    with (2 * (r * s * (dc * q) - c * (r * s * dq))) by (field; lra).
  replace (r * s * dq) with ((ux * dux + uy * duy) * (s * s) + (vx * dvx + vy * dvy) * (r * r)
      + r * s * (dux * vx + ux * dvx + (duy * vy + uy * dvy))) by (unfold dq; field; lra).
  rewrite goal; field; lra.
Qed.

(* Along a motion that is not on an edge, the angle of the edge changes by what the directions to its ends turn. *)
Lemma angle_turns (x y : R -> R) dx dy ax ay bx by_ t :
  is_derive x t dx -> is_derive y t dy ->
  (forall s, inside_unit s -> 0 < norm (x t - on_x ax bx s) (y t - on_x ay by_ s)) ->
  is_derive (fun s => angle (ax - x s) (ay - y s) (bx - x s) (by_ - y s)) t
    (turn (bx - x t) (by_ - y t) (- dx) (- dy) - turn (ax - x t) (ay - y t) (- dx) (- dy)).
Proof.
  intros one two away.
  destruct (off_edge (ax - x t) (ay - y t) (bx - x t) (by_ - y t)) as [first [last pos]].
  { intros s inside; generalize (away s inside).
    replace (x t - on_x ax bx s) with (- on_x (ax - x t) (bx - x t) s) by (unfold on_x; ring).
    replace (y t - on_x ay by_ s) with (- on_x (ay - y t) (by_ - y t) s) by (unfold on_x; ring).
    rewrite norm_opp; trivial. }
  rewrite <- (angle_algebra (ax - x t) (ay - y t) (bx - x t) (by_ - y t) (- dx) (- dy) (- dx) (- dy) first last pos).
  assert (shift : forall (f : R -> R) df k, is_derive f t df -> is_derive (fun s => k - f s) t (- df)).
  { intros f df k derive; auto_derive; [eexists; eassumption|].
    replace (Derive (fun s => f s) t) with df by (symmetry; apply is_derive_unique; exact derive); ring. }
  assert (ux := shift x dx ax one); assert (uy := shift y dy ay two).
  assert (vx := shift x dx bx one); assert (vy := shift y dy by_ two).
  assert (product : forall (f g : R -> R) df dg, is_derive f t df -> is_derive g t dg ->
    is_derive (fun s => f s * g s) t (df * g t + f t * dg)).
  { intros f g df dg df_ dg_; auto_derive; [split; [eexists; eassumption|split; [eexists; eassumption|exact I]]|].
    replace (Derive (fun s => f s) t) with df by (symmetry; apply is_derive_unique; exact df_).
    replace (Derive (fun s => g s) t) with dg by (symmetry; apply is_derive_unique; exact dg_); ring. }
  apply (derive_angle
    (fun s => (ax - x s) * (by_ - y s) - (ay - y s) * (bx - x s))
    (fun s => norm (ax - x s) (ay - y s) * norm (bx - x s) (by_ - y s)
      + ((ax - x s) * (bx - x s) + (ay - y s) * (by_ - y s)))).
  - apply (is_derive_minus (fun s => (ax - x s) * (by_ - y s)) (fun s => (ay - y s) * (bx - x s)));
      apply product; assumption.
  - apply (is_derive_plus (fun s => norm (ax - x s) (ay - y s) * norm (bx - x s) (by_ - y s))
      (fun s => (ax - x s) * (bx - x s) + (ay - y s) * (by_ - y s))).
    + apply (product (fun s => norm (ax - x s) (ay - y s)) (fun s => norm (bx - x s) (by_ - y s)));
        apply (derive_norm (fun s => _ - x s) (fun s => _ - y s)); assumption.
    + apply (is_derive_plus (fun s => (ax - x s) * (bx - x s)) (fun s => (ay - y s) * (by_ - y s)));
        apply product; assumption.
  - exact pos.
Qed.

(* The sum of the angles along a line of edges from a corner over others; a ring ends where it begins. *)
Fixpoint angles (corner : R * R) (others : list (R * R)) (px py : R) : R :=
  match others with
  | [] => 0
  | next :: rest =>
      angle (fst corner - px) (snd corner - py) (fst next - px) (snd next - py) + angles next rest px py
  end.

Fixpoint off_edges (corner : R * R) (others : list (R * R)) (px py : R) : Prop :=
  match others with
  | [] => True
  | next :: rest =>
      (forall s, inside_unit s ->
        0 < norm (px - on_x (fst corner) (fst next) s) (py - on_x (snd corner) (snd next) s))
      /\ off_edges next rest px py
  end.

Lemma angles_turn (x y : R -> R) dx dy corner others t :
  is_derive x t dx -> is_derive y t dy -> off_edges corner others (x t) (y t) ->
  is_derive (fun s => angles corner others (x s) (y s)) t
    (turn (fst (last others corner) - x t) (snd (last others corner) - y t) (- dx) (- dy)
      - turn (fst corner - x t) (snd corner - y t) (- dx) (- dy)).
Proof.
  intros one two; revert corner; induction others as [|next rest IH]; intros corner away.
  - simpl; unfold Rminus at 1; rewrite Rplus_opp_r; apply (is_derive_const 0 t).
  - destruct away as [here further].
    assert (step := angle_turns x y dx dy (fst corner) (snd corner) (fst next) (snd next) t one two).
    assert (rest_turn := IH next further).
    replace (last (next :: rest) corner) with (last rest next).
    2: { clear; revert next corner; induction rest as [|n r again]; intros; [reflexivity|].
         change (last (n :: r) next = last (n :: r) corner).
         clear again; revert n; induction r as [|m r again]; intros; [reflexivity|apply again]. }
    replace (turn (fst (last rest next) - x t) (snd (last rest next) - y t) (- dx) (- dy)
        - turn (fst corner - x t) (snd corner - y t) (- dx) (- dy))
      with ((turn (fst next - x t) (snd next - y t) (- dx) (- dy) - turn (fst corner - x t) (snd corner - y t) (- dx) (- dy))
        + (turn (fst (last rest next) - x t) (snd (last rest next) - y t) (- dx) (- dy)
          - turn (fst next - x t) (snd next - y t) (- dx) (- dy))) by ring.
    apply (is_derive_plus (fun s => angle (fst corner - x s) (snd corner - y s) (fst next - x s) (snd next - y s))
      (fun s => angles next rest (x s) (y s))); [|assumption].
    apply step; exact here.
Qed.

(* A curve that meets no edge of a ring stays on the side on which it begins. *)
Theorem winding_constant (x y vx vy : R -> R) corner others b e :
  b <= e -> moves x y vx vy -> last others corner = corner ->
  (forall t, b <= t <= e -> off_edges corner others (x t) (y t)) ->
  angles corner others (x e) (y e) = angles corner others (x b) (y b).
Proof.
  intros order motion closed away.
  assert (flat : forall t, b <= t <= e -> is_derive (fun s => angles corner others (x s) (y s)) t 0).
  { intros t inside; destruct (motion t) as [one two].
    assert (change := angles_turn x y (vx t) (vy t) corner others t one two (away t inside)).
    rewrite closed in change; unfold Rminus at 1 in change; rewrite Rplus_opp_r in change; exact change. }
  destruct (MVT_gen (fun s => angles corner others (x s) (y s)) b e (fun _ => 0)) as [c [_ value]].
  - rewrite Rmin_left, Rmax_right by assumption; intros t inside; apply flat; lra.
  - rewrite Rmin_left, Rmax_right by assumption; intros t inside; apply continuity_pt_filterlim.
    apply (ex_derive_continuous (fun s => angles corner others (x s) (y s))); exists 0; apply flat; lra.
  - simpl in value; lra.
Qed.
