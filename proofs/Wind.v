(* A wind that is not known exactly. The motion over the ground and its acceleration as a vector are the same in every
   wind; speed, acceleration along the path and turn rate through the air are not. Limits that are narrowed as
   envs/wind.py does it are kept in the air of every wind that differs by an error at most. A test translates the
   definitions of this file and compares them with the code. *)

From Coq Require Import Reals Lra Psatz.
From Coquelicot Require Import Coquelicot.
Require Import Vectors Chord Motion.
Open Scope R_scope.

(* Of a velocity (ux, uy) through the air and an acceleration (cx, cy). *)
Definition along_path (ux uy cx cy : R) : R := (cx * ux + cy * uy) / norm ux uy.
Definition turn_rate (ux uy cx cy : R) : R := (ux * cy - uy * cx) / (norm ux uy * norm ux uy).

Lemma in_parts ux uy cx cy : 0 < norm ux uy ->
  cx = along_path ux uy cx cy * (ux / norm ux uy) - turn_rate ux uy cx cy * uy /\
  cy = along_path ux uy cx cy * (uy / norm ux uy) + turn_rate ux uy cx cy * ux.
Proof.
  intros pos; unfold along_path, turn_rate; assert (square := norm_square ux uy); set (v := norm ux uy) in *.
  split.
  - replace ((cx * ux + cy * uy) / v * (ux / v) - (ux * cy - uy * cx) / (v * v) * uy)
      with (cx * (ux * ux + uy * uy) / (v * v)) by (field; lra).
    rewrite <- square; field; lra.
  - replace ((cx * ux + cy * uy) / v * (uy / v) + (ux * cy - uy * cx) / (v * v) * ux)
      with (cy * (ux * ux + uy * uy) / (v * v)) by (field; lra).
    rewrite <- square; field; lra.
Qed.

Lemma cross_le_norm ux uy vx vy : Rabs (ux * vy - uy * vx) <= norm ux uy * norm vx vy.
Proof.
  assert (one := dot_le_norm (- uy) ux vx vy); assert (two := dot_le_norm uy (- ux) vx vy).
  replace (norm (- uy) ux) with (norm ux uy) in one by (unfold norm; f_equal; ring).
  replace (norm uy (- ux)) with (norm ux uy) in two by (unfold norm; f_equal; ring).
  apply Rabs_le; lra.
Qed.

(* The wind differs by (dx, dy): so does the velocity through the air. *)
Lemma other_airspeed ux uy dx dy e :
  norm dx dy <= e -> norm ux uy - e <= norm (ux - dx) (uy - dy) <= norm ux uy + e.
Proof.
  intros near; split.
  - apply norm_near.
    replace (ux - dx - ux) with (- dx) by ring; replace (uy - dy - uy) with (- dy) by ring.
    rewrite norm_opp; assumption.
  - apply Rle_trans with (norm ux uy + norm (- dx) (- dy)); [apply norm_triangle|rewrite norm_opp; lra].
Qed.

Lemma moves_on ux uy dx dy e :
  norm dx dy <= e -> e < norm ux uy -> 0 < norm ux uy /\ 0 < norm (ux - dx) (uy - dy).
Proof. intros near faster; generalize (other_airspeed ux uy dx dy e near) (norm_pos dx dy); lra. Qed.

(* The path's direction turns by an angle whose sine is e / v at most. *)
Lemma other_cross ux uy dx dy e :
  norm dx dy <= e -> Rabs (ux * (uy - dy) - uy * (ux - dx)) <= e * norm (ux - dx) (uy - dy).
Proof.
  intros near.
  replace (ux * (uy - dy) - uy * (ux - dx)) with (dx * (uy - dy) - dy * (ux - dx)) by ring.
  apply Rle_trans with (1 := cross_le_norm _ _ _ _).
  apply Rmult_le_compat_r; [apply norm_pos|assumption].
Qed.

Lemma other_dot ux uy dx dy e :
  norm dx dy <= e -> e < norm ux uy ->
  0 <= ux * (ux - dx) + uy * (uy - dy) <= norm ux uy * norm (ux - dx) (uy - dy).
Proof.
  intros near faster; split; [|apply dot_le_norm].
  generalize (dot_le_norm ux uy dx dy) (norm_square ux uy) (norm_pos ux uy); intros dot square pos.
  assert (norm ux uy * norm dx dy <= norm ux uy * norm ux uy) by (apply Rmult_le_compat_l; lra).
  lra.
Qed.

Theorem other_acceleration_along ux uy cx cy dx dy e :
  norm dx dy <= e -> e < norm ux uy ->
  let a := along_path ux uy cx cy in
  let r := turn_rate ux uy cx cy in
  Rmin a 0 - e * Rabs r <= along_path (ux - dx) (uy - dy) cx cy <= Rmax a 0 + e * Rabs r.
Proof.
  intros near faster a r; destruct (moves_on ux uy dx dy e near faster) as [pos pos'].
  destruct (in_parts ux uy cx cy pos) as [x y]; fold a r in x, y.
  assert (cross := other_cross ux uy dx dy e near); assert (dot := other_dot ux uy dx dy e near faster).
  set (v := norm ux uy) in *; set (w := norm (ux - dx) (uy - dy)) in *.
  set (D := ux * (ux - dx) + uy * (uy - dy)) in *; set (X := ux * (uy - dy) - uy * (ux - dx)) in *.
  assert (sum : along_path (ux - dx) (uy - dy) cx cy = a * (D / (v * w)) + r * (X / w)).
  { unfold along_path; fold w; rewrite x, y; unfold D, X; field; lra. }
  rewrite sum.
  assert (0 < v * w) by (apply Rmult_lt_0_compat; assumption).
  assert (cosine : 0 <= D / (v * w) <= 1).
  { split; [apply Rmult_le_pos; [lra|left; apply Rinv_0_lt_compat; assumption]|].
    apply Rmult_le_reg_r with (v * w); [assumption|]; replace (D / (v * w) * (v * w)) with D by (field; lra); lra. }
  set (k := D / (v * w)) in *.
  assert (sine : Rabs (r * (X / w)) <= e * Rabs r).
  { rewrite Rabs_mult, (Rmult_comm e); apply Rmult_le_compat_l; [apply Rabs_pos|].
    unfold Rdiv; rewrite Rabs_mult, (Rabs_right (/ w)) by (left; apply Rinv_0_lt_compat; assumption).
    apply Rmult_le_reg_r with w; [assumption|].
    replace (Rabs X * / w * w) with (Rabs X) by (field; lra); lra. }
  assert (share : Rmin a 0 <= a * k <= Rmax a 0).
  { unfold Rmin, Rmax; repeat destruct (Rle_dec _ _); split; nra. }
  generalize (Rle_abs (r * (X / w))) (Rle_abs (- (r * (X / w)))); rewrite Rabs_Ropp; lra.
Qed.

Theorem other_turn_rate ux uy cx cy dx dy e :
  norm dx dy <= e -> e < norm ux uy ->
  let a := along_path ux uy cx cy in
  let r := turn_rate ux uy cx cy in
  let v := norm ux uy in
  Rabs (turn_rate (ux - dx) (uy - dy) cx cy) <= (v * Rabs r + Rabs a * e / v) / (v - e).
Proof.
  intros near faster a r v0; destruct (moves_on ux uy dx dy e near faster) as [pos pos'].
  destruct (in_parts ux uy cx cy pos) as [x y]; fold a r in x, y.
  assert (cross := other_cross ux uy dx dy e near); assert (dot := other_dot ux uy dx dy e near faster);
    assert (speed := other_airspeed ux uy dx dy e near).
  fold v0 in pos, dot, speed, x, y, faster |- *.
  set (w := norm (ux - dx) (uy - dy)) in *.
  set (D := ux * (ux - dx) + uy * (uy - dy)) in *; set (X := ux * (uy - dy) - uy * (ux - dx)) in *.
  assert (sum : turn_rate (ux - dx) (uy - dy) cx cy = (r * D - a * (X / v0)) / (w * w)).
  { unfold turn_rate; fold w; rewrite x, y; unfold D, X; field; split; lra. }
  rewrite sum.
  assert (most : Rabs (r * D - a * (X / v0)) <= (v0 * Rabs r + Rabs a * e / v0) * w).
  { apply Rle_trans with (Rabs (r * D) + Rabs (- (a * (X / v0)))); [apply Rabs_triang|].
    rewrite Rabs_Ropp, !Rabs_mult, (Rabs_right D) by lra.
    unfold Rdiv; rewrite Rabs_mult, (Rabs_right (/ v0)) by (left; apply Rinv_0_lt_compat; assumption).
    assert (Rabs r * D <= Rabs r * (v0 * w)) by (apply Rmult_le_compat_l; [apply Rabs_pos|lra]).
    assert (0 < / v0) by (apply Rinv_0_lt_compat; assumption).
    assert (Rabs a * (Rabs X * / v0) <= Rabs a * (e * w * / v0)).
    { apply Rmult_le_compat_l; [apply Rabs_pos|apply Rmult_le_compat_r; lra]. }
    lra. }
  set (N := v0 * Rabs r + Rabs a * e / v0) in *.
  assert (0 < w * w) by (apply Rmult_lt_0_compat; assumption).
  unfold Rdiv; rewrite Rabs_mult, (Rabs_right (/ (w * w))) by (left; apply Rinv_0_lt_compat; assumption).
  apply Rle_trans with (N * w * / (w * w)).
  { apply Rmult_le_compat_r; [left; apply Rinv_0_lt_compat; assumption|assumption]. }
  replace (N * w * / (w * w)) with (N * / w) by (field; lra).
  assert (0 <= N).
  { apply Rmult_le_reg_r with w; [assumption|]; rewrite Rmult_0_l; apply Rle_trans with (2 := most); apply Rabs_pos. }
  apply Rmult_le_compat_l; [assumption|apply Rinv_le_contravar; lra].
Qed.

(* ---- the limits that are narrowed ---- *)

(* What can be very slow is kept from that. *)
Definition lowest (speed_min acc_min acc_max rate error : R) : R :=
  Rmax speed_min (Rmax (2 * error) (Rmax acc_max (- acc_min) / rate)).
Definition narrow_speed_min (speed_min error : R) : R := speed_min + error.
Definition narrow_speed_max (speed_max error : R) : R := speed_max - error.
Definition turn_left (speed_min acc_min acc_max rate error : R) : R :=
  rate * speed_min / narrow_speed_min speed_min error
    - Rmax acc_max (- acc_min) * error / (narrow_speed_min speed_min error * narrow_speed_min speed_min error).
(* A turn takes of the accelerations by the error; half of the weaker one is kept. *)
Definition gentle_turn (acc_min acc_max error : R) : R := Rmin acc_max (- acc_min) / (2 * error).
Definition narrow_turn (speed_min acc_min acc_max rate error : R) : R :=
  Rmin (turn_left speed_min acc_min acc_max rate error) (gentle_turn acc_min acc_max error).
Definition turn_loss (turn error : R) : R := Rmax turn 0 * error.
Definition narrow_acc_min (acc_min turn error : R) : R := acc_min + turn_loss turn error.
Definition narrow_acc_max (acc_max turn error : R) : R := acc_max - turn_loss turn error.

(* The bound of the turn rate is greatest at the lowest airspeed that is left. *)
Lemma slowest_turns_most speed_min acc_min acc_max rate error v r a :
  0 < speed_min -> 0 <= error -> narrow_speed_min speed_min error <= v ->
  Rabs r <= turn_left speed_min acc_min acc_max rate error -> Rabs a <= Rmax acc_max (- acc_min) ->
  (v * Rabs r + Rabs a * error / v) / (v - error) <= rate.
Proof.
  unfold turn_left, narrow_speed_min; intros pos err fast turns pushes.
  set (s := speed_min + error) in *; set (P := Rmax acc_max (- acc_min)) in *.
  assert (0 < s) by (unfold s; lra); assert (0 < v - error) by (unfold s in fast; lra).
  assert (0 <= Rabs a) by apply Rabs_pos; assert (0 <= Rabs r) by apply Rabs_pos.
  set (T := rate * speed_min / s - P * error / (s * s)) in *.
  assert (at_slowest : s * T + P * error / s = rate * speed_min) by (unfold T; field; lra).
  apply Rmult_le_reg_r with (v - error); [assumption|].
  replace ((v * Rabs r + Rabs a * error / v) / (v - error) * (v - error)) with (v * Rabs r + Rabs a * error / v)
    by (field; lra).
  (* what a faster flight adds on the left is no more than what it adds on the right *)
  assert (one : v * Rabs r <= v * T) by (apply Rmult_le_compat_l; lra).
  assert (two : Rabs a * error / v <= P * error / s).
  { apply Rmult_le_compat; [apply Rmult_le_pos; lra|left; apply Rinv_0_lt_compat; lra| |apply Rinv_le_contravar; lra].
    apply Rmult_le_compat_r; assumption. }
  assert (0 <= P * error) by (apply Rmult_le_pos; lra).
  assert (three : T <= rate).
  { assert (0 <= P * error / s) by (apply Rmult_le_pos; [assumption|left; apply Rinv_0_lt_compat; lra]).
    assert (0 <= s * T) by (apply Rmult_le_pos; lra).
    assert (0 <= rate).
    { apply Rmult_le_reg_r with speed_min; [assumption|lra]. }
    apply Rmult_le_reg_l with s; [assumption|].
    assert (rate * speed_min <= rate * s) by (apply Rmult_le_compat_l; unfold s; lra).
    lra. }
  assert ((v - s) * T <= (v - s) * rate) by (apply Rmult_le_compat_l; lra).
  unfold s in at_slowest |- *.
  replace (rate * (v - error)) with (rate * speed_min + (v - (speed_min + error)) * rate) by ring.
  unfold s in *; lra.
Qed.

(* What keeps the narrowed limits in the air of one wind keeps the limits in that of every wind near it. *)
Theorem narrow_sound speed_min speed_max acc_min acc_max rate error ux uy cx cy dx dy :
  0 < speed_min -> 0 <= error -> norm dx dy <= error ->
  let turn := narrow_turn speed_min acc_min acc_max rate error in
  narrow_acc_min acc_min turn error <= 0 <= narrow_acc_max acc_max turn error ->
  narrow_speed_min speed_min error <= norm ux uy <= narrow_speed_max speed_max error ->
  narrow_acc_min acc_min turn error <= along_path ux uy cx cy <= narrow_acc_max acc_max turn error ->
  Rabs (turn_rate ux uy cx cy) <= turn ->
  speed_min <= norm (ux - dx) (uy - dy) <= speed_max /\
  acc_min <= along_path (ux - dx) (uy - dy) cx cy <= acc_max /\
  Rabs (turn_rate (ux - dx) (uy - dy) cx cy) <= rate.
Proof.
  intros pos err near turn signs speeds pushes turns.
  assert (faster : error < norm ux uy) by (unfold narrow_speed_min in speeds; lra).
  assert (speed := other_airspeed ux uy dx dy error near).
  assert (push := other_acceleration_along ux uy cx cy dx dy error near faster).
  assert (round := other_turn_rate ux uy cx cy dx dy error near faster).
  simpl in push, round.
  assert (turn_pos : 0 <= turn) by (generalize (Rabs_pos (turn_rate ux uy cx cy)); lra).
  unfold narrow_acc_min, narrow_acc_max, turn_loss in *.
  assert (same : Rmax turn 0 = turn) by (apply Rmax_left; exact turn_pos).
  rewrite !same in *.
  assert (loss : error * Rabs (turn_rate ux uy cx cy) <= turn * error).
  { rewrite Rmult_comm; apply Rmult_le_compat_r; assumption. }
  split; [unfold narrow_speed_min, narrow_speed_max in speeds; lra|split].
  - unfold Rmin, Rmax in push; destruct (Rle_dec _ 0) in push; lra.
  - apply Rle_trans with (1 := round).
    assert (0 <= turn * error) by (apply Rmult_le_pos; assumption).
    apply (slowest_turns_most speed_min acc_min acc_max); try assumption; [lra| |].
    { apply Rle_trans with (1 := turns); apply Rmin_l. }
    apply Rabs_le.
    generalize (Rmax_l acc_max (- acc_min)) (Rmax_r acc_max (- acc_min)); lra.
Qed.

(* So it is where they are narrowed for a higher least speed. *)
Corollary narrow_sound_lowest speed_min speed_max acc_min acc_max rate error ux uy cx cy dx dy :
  let slow := lowest speed_min acc_min acc_max rate error in
  0 < slow -> 0 <= error -> norm dx dy <= error ->
  let turn := narrow_turn slow acc_min acc_max rate error in
  narrow_acc_min acc_min turn error <= 0 <= narrow_acc_max acc_max turn error ->
  narrow_speed_min slow error <= norm ux uy <= narrow_speed_max speed_max error ->
  narrow_acc_min acc_min turn error <= along_path ux uy cx cy <= narrow_acc_max acc_max turn error ->
  Rabs (turn_rate ux uy cx cy) <= turn ->
  speed_min <= norm (ux - dx) (uy - dy) <= speed_max /\
  acc_min <= along_path (ux - dx) (uy - dy) cx cy <= acc_max /\
  Rabs (turn_rate (ux - dx) (uy - dy) cx cy) <= rate.
Proof.
  intros slow pos err near turn signs speeds pushes turns.
  destruct (narrow_sound slow speed_max acc_min acc_max rate error ux uy cx cy dx dy
    pos err near signs speeds pushes turns) as [fast rest].
  split; [|exact rest].
  assert (speed_min <= slow) by apply Rmax_l; lra.
Qed.

(* ---- an intruder that turns through the air ---- *)

(* Its velocity over the ground after a turn by an angle, in a wind (wx, wy). *)
Definition turned_x (gx gy wx wy angle : R) : R := cos angle * (gx - wx) - sin angle * (gy - wy) + wx.
Definition turned_y (gx gy wx wy angle : R) : R := sin angle * (gx - wx) + cos angle * (gy - wy) + wy.

(* In another wind it differs by min(angle, 2) times the error at most. *)
Theorem turned_in_other_wind gx gy wx wy dx dy angle :
  norm (turned_x gx gy (wx + dx) (wy + dy) angle - turned_x gx gy wx wy angle)
    (turned_y gx gy (wx + dx) (wy + dy) angle - turned_y gx gy wx wy angle) <= Rmin (Rabs angle) 2 * norm dx dy.
Proof.
  unfold turned_x, turned_y.
  assert (unit := sin2_cos2 angle); unfold Rsqr in unit.
  set (c := cos angle) in *; set (s := sin angle) in *.
  match goal with |- norm ?x ?y <= _ => replace x with ((1 - c) * dx + s * dy) by ring;
    replace y with ((1 - c) * dy - s * dx) by ring end.
  assert (product : norm ((1 - c) * dx + s * dy) ((1 - c) * dy - s * dx) = norm (1 - c) s * norm dx dy).
  { unfold norm; rewrite <- sqrt_mult by apply squares_pos; f_equal; ring. }
  rewrite product; apply Rmult_le_compat_r; [apply norm_pos|].
  apply Rmin_glb.
  - assert (chord_ := turn_chord angle 0); rewrite cos_0, sin_0 in chord_; fold c s in chord_.
    replace (norm (1 - c) (0 - s)) with (norm (1 - c) s) in chord_ by (unfold norm; f_equal; ring).
    replace (Rabs (0 - angle)) with (Rabs angle) in chord_ by (rewrite <- Rabs_Ropp; f_equal; ring).
    exact chord_.
  - apply norm_le; [lra|]; nra.
Qed.
