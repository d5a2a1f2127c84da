(* The altitude of a plan: a line from corner to corner, which the aircraft rounds off. No aircraft changes its climb at
   once; how early a change has to begin, how far it leaves the corner, and how far apart corners have to be. *)

From Coq Require Import Reals Lra Psatz List.
From Coquelicot Require Import Coquelicot.
Require Import Chord.
Import ListNotations.
Open Scope R_scope.

(* ---- a corner: the climb changes by r, evenly, with the vertical acceleration a ---- *)

(* How long before its corner the change begins, and how long after it the change ends. *)
Definition lead (a r : R) : R := Rabs r / (2 * a).

(* How far it leaves the two lines at most. *)
Definition rounding (a r : R) : R := r * r / (8 * a).

Definition upwards (a r : R) : R := if Rle_dec 0 r then a else - a.

(* What the change has added to the climb, and to the altitude, u after the corner (before it: u is negative). *)
Definition climb_gained (a r u : R) : R := upwards a r * (Rmax (u + lead a r) 0 - Rmax (u - lead a r) 0).
Definition height_gained (a r u : R) : R :=
  upwards a r / 2 * (Rmax (u + lead a r) 0 * Rmax (u + lead a r) 0 - Rmax (u - lead a r) 0 * Rmax (u - lead a r) 0).

Lemma lead_pos a r : 0 < a -> 0 <= lead a r.
Proof. intros; unfold lead; apply Rmult_le_pos; [apply Rabs_pos|left; apply Rinv_0_lt_compat; lra]. Qed.

Lemma upwards_lead a r : 0 < a -> 2 * (upwards a r * lead a r) = r.
Proof.
  intros; unfold upwards, lead; destruct (Rle_dec 0 r).
  - rewrite Rabs_right by lra; field; lra.
  - rewrite Rabs_left by lra; field; lra.
Qed.

Lemma upwards_size a r : 0 < a -> Rabs (upwards a r) = a.
Proof.
  intros; unfold upwards; destruct (Rle_dec 0 r); [apply Rabs_right; lra|rewrite Rabs_left; lra].
Qed.

Lemma rounding_lead a r : 0 < a -> rounding a r = a / 2 * (lead a r * lead a r).
Proof.
  intros; unfold rounding, lead.
  replace (r * r) with (Rabs r * Rabs r) by (rewrite <- Rabs_mult; apply Rabs_right; nra).
  field; lra.
Qed.

Lemma half_parabola (x : R) : is_derive (fun v => Rmax v 0 * Rmax v 0) x (2 * Rmax x 0).
Proof.
  apply is_derive_Reals; intros eps pos; exists (mkposreal eps pos); intros h some small; simpl in small.
  set (d := (Rmax (x + h) 0 * Rmax (x + h) 0 - Rmax x 0 * Rmax x 0) / h - 2 * Rmax x 0).
  assert (scaled : d * h = Rmax (x + h) 0 * Rmax (x + h) 0 - Rmax x 0 * Rmax x 0 - 2 * Rmax x 0 * h)
    by (unfold d; field; assumption).
  assert (bounded : Rabs (d * h) <= Rabs h * Rabs h).
  { rewrite scaled; unfold Rmax, Rabs; repeat destruct (Rle_dec _ _); repeat destruct (Rcase_abs _); nra. }
  rewrite Rabs_mult in bounded.
  apply Rle_lt_trans with (2 := small).
  apply Rmult_le_reg_r with (Rabs h); [apply Rabs_pos_lt; assumption|assumption].
Qed.

Lemma height_moves a r at_ t :
  is_derive (fun v => height_gained a r (v - at_)) t (climb_gained a r (t - at_)).
Proof.
  unfold height_gained, climb_gained.
  set (k := upwards a r); set (d := lead a r).
  assert (shifted : forall s, is_derive (fun v => Rmax (v - at_ + s) 0 * Rmax (v - at_ + s) 0) t
    (2 * Rmax (t - at_ + s) 0)).
  { intros s.
    assert (shift : is_derive (fun v => v - at_ + s) t 1) by (auto_derive; [exact I|ring]).
    generalize (is_derive_comp (fun v => Rmax v 0 * Rmax v 0) (fun v => v - at_ + s) t _ _
      (half_parabola (t - at_ + s)) shift).
    unfold scal; simpl; unfold mult; simpl; rewrite Rmult_1_l; trivial. }
  replace (k * (Rmax (t - at_ + d) 0 - Rmax (t - at_ - d) 0))
    with (k / 2 * (2 * Rmax (t - at_ + d) 0 - 2 * Rmax (t - at_ - d) 0)) by field.
  apply (is_derive_scal (fun v => Rmax (v - at_ + d) 0 * Rmax (v - at_ + d) 0
    - Rmax (v - at_ - d) 0 * Rmax (v - at_ - d) 0) t (k / 2)).
  apply (is_derive_minus (fun v => Rmax (v - at_ + d) 0 * Rmax (v - at_ + d) 0)
    (fun v => Rmax (v - at_ - d) 0 * Rmax (v - at_ - d) 0)); [apply shifted|].
  apply (shifted (- d)).
Qed.

(* Before the change the aircraft is on the line that comes in, after it on the line that goes out. *)
Theorem before_corner a r u : 0 < a -> u <= - lead a r -> height_gained a r u = 0 /\ climb_gained a r u = 0.
Proof.
  intros pos early; unfold height_gained, climb_gained.
  assert (ahead := lead_pos a r pos).
  rewrite !Rmax_right by lra; split; ring.
Qed.

Theorem after_corner a r u : 0 < a -> lead a r <= u -> height_gained a r u = r * u /\ climb_gained a r u = r.
Proof.
  intros pos late; unfold height_gained, climb_gained.
  assert (ahead := lead_pos a r pos); assert (whole := upwards_lead a r pos).
  rewrite !Rmax_left by lra.
  set (k := upwards a r) in *; set (d := lead a r) in *.
  split; rewrite <- whole; field.
Qed.

(* Between, and so always, it leaves these two lines by the rounding at most. *)
Theorem near_corner a r u : 0 < a -> Rabs (height_gained a r u - r * Rmax u 0) <= rounding a r.
Proof.
  intros pos; rewrite rounding_lead by assumption.
  assert (ahead := lead_pos a r pos).
  destruct (Rle_dec u (- lead a r)) as [early | begun].
  { destruct (before_corner a r u pos early) as [flat _]; rewrite flat, Rmax_right by lra.
    replace (0 - r * 0) with 0 by ring; rewrite Rabs_R0; nra. }
  destruct (Rle_dec (lead a r) u) as [late | going].
  { destruct (after_corner a r u pos late) as [straight _]; rewrite straight, Rmax_left by lra.
    replace (r * u - r * u) with 0 by ring; rewrite Rabs_R0; nra. }
  assert (shape : exists w,
    height_gained a r u - r * Rmax u 0 = upwards a r / 2 * (w * w) /\ - lead a r <= w <= lead a r).
  { assert (whole := upwards_lead a r pos).
    destruct (Rle_dec 0 u).
    - exists (u - lead a r); split; [|lra].
      unfold height_gained.
      rewrite (Rmax_left u), (Rmax_left (u + lead a r)), (Rmax_right (u - lead a r)) by lra.
      rewrite <- whole at 4; field.
    - exists (u + lead a r); split; [|lra].
      unfold height_gained.
      rewrite (Rmax_right u), (Rmax_left (u + lead a r)), (Rmax_right (u - lead a r)) by lra.
      field. }
  destruct shape as [w [value inside]].
  assert (0 <= w * w <= lead a r * lead a r) by (split; nra).
  rewrite value, Rabs_mult, (Rabs_right (w * w)) by lra.
  unfold Rdiv; rewrite Rabs_mult, upwards_size, (Rabs_right (/ 2)) by lra.
  nra.
Qed.

(* During the change the climb stays between those before and after it. *)
Lemma climb_between a r u : 0 < a -> Rmin 0 r <= climb_gained a r u <= Rmax 0 r.
Proof.
  intros pos; assert (ahead := lead_pos a r pos); assert (whole := upwards_lead a r pos).
  assert (part : 0 <= Rmax (u + lead a r) 0 - Rmax (u - lead a r) 0 <= 2 * lead a r)
    by (unfold Rmax; repeat destruct (Rle_dec _ _); lra).
  unfold climb_gained; set (p := Rmax (u + lead a r) 0 - Rmax (u - lead a r) 0) in *.
  unfold upwards in *; destruct (Rle_dec 0 r).
  - rewrite Rmin_left, Rmax_right by lra; nra.
  - rewrite Rmin_right, Rmax_left by lra; nra.
Qed.

(* ---- a profile: corners one after the other ---- *)

Record corner := Corner {
  corner_time : R;  (* s after the request *)
  change : R  (* of the climb, m/s *)
}.

(* The profile: z and c are altitude and climb at the request. *)
Fixpoint linear (z c : R) (corners : list corner) (t : R) : R :=
  match corners with
  | [] => z + c * t
  | k :: rest => linear z c rest t + change k * Rmax (t - corner_time k) 0
  end.

(* Altitude and climb of an aircraft that rounds the corners off. *)
Fixpoint flown (a z c : R) (corners : list corner) (t : R) : R :=
  match corners with
  | [] => z + c * t
  | k :: rest => flown a z c rest t + height_gained a (change k) (t - corner_time k)
  end.

Fixpoint climb (a c : R) (corners : list corner) (t : R) : R :=
  match corners with
  | [] => c
  | k :: rest => climb a c rest t + climb_gained a (change k) (t - corner_time k)
  end.

Theorem flown_moves a z c corners t : is_derive (flown a z c corners) t (climb a c corners t).
Proof.
  induction corners as [|k rest rises]; simpl.
  - auto_derive; [exact I|ring].
  - apply (is_derive_plus (flown a z c rest) (fun v => height_gained a (change k) (v - corner_time k)));
      [assumption|apply height_moves].
Qed.

(* Nothing else has this climb and begins there. *)
Theorem flown_alone a z c corners f t :
  (forall u, is_derive f u (climb a c corners u)) -> f 0 = flown a z c corners 0 -> 0 <= t ->
  f t = flown a z c corners t.
Proof.
  intros moves_ begins later.
  destruct (mean_value (fun u => f u - flown a z c corners u) (fun u => climb a c corners u - climb a c corners u) 0 t)
    as [w [_ value]]; [assumption| |].
  - intros u; apply (is_derive_minus f (flown a z c corners)); [apply moves_|apply flown_moves].
  - replace ((climb a c corners w - climb a c corners w) * (t - 0)) with 0 in value by ring; lra.
Qed.

(* Corners lie as far apart as their changes need: (r + r') / (2 a). The first follows the request, where nothing
   changes. *)
Fixpoint spaced (a before time : R) (corners : list corner) : Prop :=
  match corners with
  | [] => True
  | k :: rest =>
      (Rabs before + Rabs (change k)) / (2 * a) <= corner_time k - time
      /\ spaced a (change k) (corner_time k) rest
  end.

(* Then the change at a corner ends before the next begins. *)
Theorem changes_apart a before time r at_ :
  0 < a -> (Rabs before + Rabs r) / (2 * a) <= at_ - time -> time + lead a before <= at_ - lead a r.
Proof.
  intros pos gap; unfold lead.
  replace ((Rabs before + Rabs r) / (2 * a)) with (Rabs before / (2 * a) + Rabs r / (2 * a)) in gap by (field; lra).
  lra.
Qed.

(* A corner r / (2 a) after the request is changed for from the request on. *)
Theorem change_from_request a r t :
  0 < a -> 0 <= t <= 2 * lead a r -> climb_gained a r (t - lead a r) = upwards a r * t.
Proof. intros pos during_; unfold climb_gained; rewrite Rmax_left, Rmax_right by lra; ring. Qed.

Lemma lead_zero a : lead a 0 = 0.
Proof. unfold lead; rewrite Rabs_R0; unfold Rdiv; ring. Qed.

Lemma spaced_later a before time corners k :
  0 < a -> spaced a before time corners -> In k corners ->
  time + lead a before <= corner_time k - lead a (change k).
Proof.
  intros pos; revert before time; induction corners as [|j rest IH]; simpl; intros before time wide member;
    [contradiction|].
  destruct wide as [gap others].
  assert (apart := changes_apart a before time (change j) (corner_time j) pos gap).
  destruct member as [here | later]; [subst j; assumption|].
  assert (next := IH _ _ others later).
  generalize (lead_pos a (change j) pos); lra.
Qed.

(* Before its corners, a profile is the line that it begins with. *)
Lemma begins_straight a z c corners t :
  0 < a -> (forall k, In k corners -> t <= corner_time k - lead a (change k)) ->
  flown a z c corners t = z + c * t /\ linear z c corners t = z + c * t /\ climb a c corners t = c.
Proof.
  intros pos; induction corners as [|k rest IH]; simpl; intros early; [repeat split; reflexivity|].
  destruct IH as [on_flown [on_linear on_climb]]; [intros j later; apply early; right; assumption|].
  assert (here : t <= corner_time k - lead a (change k)) by (apply early; left; reflexivity).
  assert (ahead := lead_pos a (change k) pos).
  destruct (before_corner a (change k) (t - corner_time k) pos) as [no_height no_climb]; [lra|].
  rewrite on_flown, on_linear, on_climb, no_height, no_climb, Rmax_right by lra.
  repeat split; ring.
Qed.

(* At the request the aircraft has the altitude and the climb that the profile begins with. *)
Theorem begins_at_request a z c corners :
  0 < a -> spaced a 0 0 corners -> flown a z c corners 0 = z /\ climb a c corners 0 = c.
Proof.
  intros pos wide.
  destruct (begins_straight a z c corners 0 pos) as [height [_ rate]].
  - intros k member; generalize (spaced_later a 0 0 corners k pos wide member); rewrite lead_zero; lra.
  - split; [rewrite height; ring|assumption].
Qed.

(* The aircraft leaves the profile nowhere by more than it leaves a corner. *)
Theorem flown_near_linear a z c before time corners e t :
  0 < a -> 0 <= e -> spaced a before time corners -> (forall k, In k corners -> rounding a (change k) <= e) ->
  Rabs (flown a z c corners t - linear z c corners t) <= e.
Proof.
  intros pos some; revert before time; induction corners as [|k rest IH]; simpl; intros before time wide small.
  { replace (z + c * t - (z + c * t)) with 0 by ring; rewrite Rabs_R0; assumption. }
  destruct wide as [_ others].
  assert (this := near_corner a (change k) (t - corner_time k) pos).
  assert (within : rounding a (change k) <= e) by (apply small; left; reflexivity).
  destruct (Rle_dec t (corner_time k + lead a (change k))) as [until | past].
  - destruct (begins_straight a z c rest t pos) as [on_flown [on_linear _]].
    { intros j later; generalize (spaced_later _ _ _ _ j pos others later); lra. }
    rewrite on_flown, on_linear.
    replace (z + c * t + height_gained a (change k) (t - corner_time k)
      - (z + c * t + change k * Rmax (t - corner_time k) 0))
      with (height_gained a (change k) (t - corner_time k) - change k * Rmax (t - corner_time k) 0) by ring.
    lra.
  - assert (ahead := lead_pos a (change k) pos).
    destruct (after_corner a (change k) (t - corner_time k) pos) as [straight _]; [lra|].
    rewrite straight, Rmax_left by lra.
    replace (flown a z c rest t + change k * (t - corner_time k) - (linear z c rest t + change k * (t - corner_time k)))
      with (flown a z c rest t - linear z c rest t) by ring.
    apply (IH (change k) (corner_time k)); [assumption|intros j later; apply small; right; assumption].
Qed.

(* Its climb stays within limits that the legs' climbs keep. *)
Fixpoint climbs_within (low high c : R) (corners : list corner) : Prop :=
  low <= c <= high /\
  match corners with
  | [] => True
  | k :: rest => climbs_within low high (c + change k) rest
  end.

Lemma climb_shifts a c d corners t : climb a (c + d) corners t = climb a c corners t + d.
Proof. induction corners as [|k rest IH]; simpl; [reflexivity|rewrite IH; ring]. Qed.

Theorem climb_within a low high c before time corners t :
  0 < a -> spaced a before time corners -> climbs_within low high c corners ->
  low <= climb a c corners t <= high.
Proof.
  intros pos; revert before time c; induction corners as [|k rest IH]; simpl; intros before time c wide [here next];
    [assumption|].
  destruct wide as [_ others].
  destruct (Rle_dec t (corner_time k + lead a (change k))) as [until | past].
  - destruct (begins_straight a 0 c rest t pos) as [_ [_ flat]].
    { intros j later; generalize (spaced_later _ _ _ _ j pos others later); lra. }
    rewrite flat.
    assert (between := climb_between a (change k) (t - corner_time k) pos).
    assert (there : low <= c + change k <= high) by (destruct rest; simpl in next; tauto).
    unfold Rmin, Rmax in between; repeat destruct (Rle_dec _ _) in between; lra.
  - destruct (after_corner a (change k) (t - corner_time k) pos) as [_ full]; [lra|].
    rewrite full, <- climb_shifts.
    apply (IH (change k) (corner_time k)); assumption.
Qed.

(* And it changes by no more than a per second. *)
Lemma climb_gained_gentle a r s t :
  0 < a -> s <= t ->
  Rabs (climb_gained a r t - climb_gained a r s)
    <= a * (Rmin (Rmax t (- lead a r)) (lead a r) - Rmin (Rmax s (- lead a r)) (lead a r)).
Proof.
  intros pos order; assert (ahead := lead_pos a r pos).
  unfold climb_gained.
  set (d := lead a r) in *.
  assert (ramp : forall u, Rmax (u + d) 0 - Rmax (u - d) 0 = Rmin (Rmax u (- d)) d + d)
    by (intros u; unfold Rmin, Rmax; repeat destruct (Rle_dec _ _); lra).
  rewrite !ramp.
  replace (upwards a r * (Rmin (Rmax t (- d)) d + d) - upwards a r * (Rmin (Rmax s (- d)) d + d))
    with (upwards a r * (Rmin (Rmax t (- d)) d - Rmin (Rmax s (- d)) d)) by ring.
  rewrite Rabs_mult, upwards_size by assumption.
  rewrite Rabs_right; [lra|].
  unfold Rmin, Rmax; repeat destruct (Rle_dec _ _); lra.
Qed.

Lemma climb_gentle_from a c before time corners s t :
  0 < a -> s <= t -> spaced a before time corners ->
  Rabs (climb a c corners t - climb a c corners s)
    <= a * (Rmax t (time + lead a before) - Rmax s (time + lead a before)).
Proof.
  intros pos order; revert before time; induction corners as [|k rest IH]; simpl; intros before time wide.
  { replace (c - c) with 0 by ring; rewrite Rabs_R0.
    apply Rmult_le_pos; [lra|unfold Rmax; repeat destruct (Rle_dec _ _); lra]. }
  destruct wide as [gap others].
  assert (apart := changes_apart a before time (change k) (corner_time k) pos gap).
  assert (ahead := lead_pos a (change k) pos).
  assert (here := climb_gained_gentle a (change k) (s - corner_time k) (t - corner_time k) pos).
  assert (later := IH _ _ others).
  set (b := time + lead a before) in *; set (d := lead a (change k)) in *; set (m := corner_time k) in *.
  replace (climb a c rest t + climb_gained a (change k) (t - m)
    - (climb a c rest s + climb_gained a (change k) (s - m)))
    with (climb a c rest t - climb a c rest s + (climb_gained a (change k) (t - m) - climb_gained a (change k) (s - m)))
    by ring.
  apply Rle_trans with (1 := Rabs_triang _ _).
  assert (rest_of_time : forall v,
    Rmax v b - Rmax v (m + d) - Rmin (Rmax (v - m) (- d)) d = Rmin (Rmax v b) (m - d) - m)
    by (intros v; unfold Rmin, Rmax; repeat destruct (Rle_dec _ _); lra).
  assert (sum : Rmax t (m + d) - Rmax s (m + d)
    + (Rmin (Rmax (t - m) (- d)) d - Rmin (Rmax (s - m) (- d)) d) <= Rmax t b - Rmax s b)
    by (generalize (rest_of_time s) (rest_of_time t) (Rle_min_compat_r _ _ (m - d) (Rle_max_compat_r _ _ b order));
      lra).
  apply (Rmult_le_compat_l a) in sum; lra.
Qed.

Theorem climb_gentle a c corners s t :
  0 < a -> 0 <= s <= t -> spaced a 0 0 corners -> Rabs (climb a c corners t - climb a c corners s) <= a * (t - s).
Proof.
  intros pos order wide.
  assert (bound := climb_gentle_from a c 0 0 corners s t pos).
  rewrite lead_zero, !Rmax_left in bound by lra; apply bound; [lra|assumption].
Qed.

(* ---- the pieces of a profile ---- *)

(* The line of the piece that follows the corners so far: its altitude at the request, and its climb. *)
Fixpoint piece_level (z : R) (so_far : list corner) : R :=
  match so_far with
  | [] => z
  | k :: rest => piece_level z rest - change k * corner_time k
  end.

Fixpoint piece_climb (c : R) (so_far : list corner) : R :=
  match so_far with
  | [] => c
  | k :: rest => piece_climb c rest + change k
  end.

Theorem piece_is_line z c so_far later t :
  (forall k, In k so_far -> corner_time k <= t) -> (forall k, In k later -> t <= corner_time k) ->
  linear z c (so_far ++ later) t = piece_level z so_far + piece_climb c so_far * t.
Proof.
  intros past; revert past; induction so_far as [|k rest IH]; simpl; intros past ahead.
  - induction later as [|k rest IH]; simpl; [reflexivity|].
    rewrite IH by (intros j member; apply ahead; right; assumption).
    rewrite Rmax_right; [ring|].
    assert (t <= corner_time k) by (apply ahead; left; reflexivity); lra.
  - rewrite IH; [|intros j member; apply past; right; assumption|assumption].
    rewrite Rmax_left; [ring|].
    assert (corner_time k <= t) by (apply past; left; reflexivity); lra.
Qed.

(* ---- floor and ceiling ---- *)

(* Side 1: a line is above a level m; side -1: it is below a level -m. *)
Lemma line_keeps side m z c b u t :
  b <= t <= u -> m <= side * (z + c * b) -> m <= side * (z + c * u) -> m <= side * (z + c * t).
Proof.
  intros inside.
  replace (side * (z + c * b)) with (side * z + side * c * b) by ring.
  replace (side * (z + c * u)) with (side * z + side * c * u) by ring.
  replace (side * (z + c * t)) with (side * z + side * c * t) by ring.
  intros first last; destruct (Rle_dec 0 (side * c)); nra.
Qed.

Fixpoint ordered (time : R) (corners : list corner) : Prop :=
  match corners with
  | [] => True
  | k :: rest => time <= corner_time k /\ ordered (corner_time k) rest
  end.

Lemma ordered_later time corners k : ordered time corners -> In k corners -> time <= corner_time k.
Proof.
  revert time; induction corners as [|j rest IH]; simpl; intros time chain member; [contradiction|].
  destruct chain as [this others]; destruct member as [here | later]; [subst j; assumption|].
  generalize (IH _ others later); lra.
Qed.

Lemma spaced_ordered a before time corners : 0 < a -> spaced a before time corners -> ordered time corners.
Proof.
  intros pos; revert before time; induction corners as [|k rest IH]; simpl; intros before time wide; [exact I|].
  destruct wide as [gap others]; split; [|apply (IH (change k)); assumption].
  assert (apart := changes_apart a before time (change k) (corner_time k) pos gap).
  generalize (lead_pos a before pos) (lead_pos a (change k) pos); lra.
Qed.

Lemma linear_turns z c k rest t :
  corner_time k <= t -> linear z c (k :: rest) t = linear (z - change k * corner_time k) (c + change k) rest t.
Proof.
  intros past; simpl; rewrite Rmax_left by lra.
  induction rest as [|j others IH]; simpl; [ring|rewrite <- IH; ring].
Qed.

Lemma linear_begins z c corners t : (forall k, In k corners -> t <= corner_time k) -> linear z c corners t = z + c * t.
Proof. intros early; apply (piece_is_line z c [] corners t); [intros k []|assumption]. Qed.

(* A profile that keeps a level at its beginning, its corners and its end keeps it all the way. *)
Theorem linear_keeps side m z c corners b last t :
  ordered b corners -> b <= t <= last ->
  m <= side * linear z c corners b ->
  (forall k, In k corners -> corner_time k <= last -> m <= side * linear z c corners (corner_time k)) ->
  m <= side * linear z c corners last ->
  m <= side * linear z c corners t.
Proof.
  revert z c b; induction corners as [|k rest IH]; intros z c b chain inside first corners_keep end_keeps.
  { simpl in *; apply (line_keeps side m z c b last); assumption. }
  assert (all := chain); destruct chain as [this others].
  assert (later : forall j, In j (k :: rest) -> corner_time k <= corner_time j).
  { intros j [here | member]; [subst j; lra|apply (ordered_later _ rest); assumption]. }
  assert (straight : forall v, v <= corner_time k -> linear z c (k :: rest) v = z + c * v).
  { intros v early; apply linear_begins; intros j member; generalize (later j member); lra. }
  destruct (Rle_dec t (corner_time k)) as [before | past].
  - rewrite straight in first |- * by lra.
    destruct (Rle_dec last (corner_time k)) as [ends | goes_on].
    + rewrite straight in end_keeps by lra; apply (line_keeps side m z c b last); assumption.
    + assert (at_corner := corners_keep k (or_introl eq_refl) ltac:(lra)).
      rewrite straight in at_corner by lra; apply (line_keeps side m z c b (corner_time k)); try assumption; lra.
  - rewrite linear_turns in end_keeps |- * by lra.
    apply (IH _ _ (corner_time k)); try assumption; try lra.
    + rewrite <- linear_turns by lra; apply corners_keep; [left; reflexivity|lra].
    + intros j member early; rewrite <- linear_turns by (apply later; right; assumption).
      apply corners_keep; [right; assumption|assumption].
Qed.

(* What a profile keeps with e to spare, an aircraft keeps that is within e of it. *)
Lemma keeps_near_profile side m e altitude on_profile :
  side = 1 \/ side = -1 -> Rabs (altitude - on_profile) <= e -> m + e <= side * on_profile -> m <= side * altitude.
Proof.
  intros sides near kept; unfold Rabs in near; destruct sides; subst side; destruct (Rcase_abs _) in near; lra.
Qed.

(* ---- the first leg ---- *)

(* The aircraft reaches the altitude of the first waypoint at its time T. It would be off by D if it kept its climb: its
   climb changes by this much. *)
Definition first_change (a T D : R) : R := upwards (a * (T - sqrt (T * T - 2 * Rabs D / a))) D.

Theorem first_leg a T z0 c0 z1 :
  let D := z1 - z0 - c0 * T in
  let r := first_change a T D in
  0 < a -> 0 <= T -> 2 * Rabs D / a <= T * T ->
  0 <= lead a r /\ 2 * lead a r <= T /\
  linear z0 c0 [Corner (lead a r) r] T = z1 /\ flown a z0 c0 [Corner (lead a r) r] T = z1.
Proof.
  intros D r pos later enough.
  set (q := sqrt (T * T - 2 * Rabs D / a)).
  assert (square : q * q = T * T - 2 * Rabs D / a) by (apply sqrt_sqrt; lra).
  assert (q_pos : 0 <= q) by apply sqrt_pos.
  assert (some : 0 <= 2 * Rabs D / a).
  { apply Rmult_le_pos; [generalize (Rabs_pos D); lra|left; apply Rinv_0_lt_compat; lra]. }
  assert (q_less : q <= T) by nra.
  assert (size : Rabs r = a * (T - q)).
  { unfold r, first_change, upwards; fold q; destruct (Rle_dec 0 D); [apply Rabs_right; nra|].
    rewrite Rabs_Ropp; apply Rabs_right; nra. }
  assert (half : lead a r = (T - q) / 2) by (unfold lead; rewrite size; field; lra).
  assert (reached : r * (T - lead a r) = D).
  { rewrite half; replace (T - (T - q) / 2) with ((T + q) / 2) by field.
    unfold r, first_change, upwards; fold q.
    assert (product : a * (T - q) * ((T + q) / 2) = Rabs D).
    { replace (a * (T - q) * ((T + q) / 2)) with (a / 2 * (T * T - q * q)) by field.
      rewrite square; field; lra. }
    destruct (Rle_dec 0 D); [rewrite Rabs_right in product by lra|rewrite Rabs_left in product by lra]; lra. }
  assert (ends : z0 + c0 * T + r * (T - lead a r) = z1) by (rewrite reached; unfold D; ring).
  repeat split; [lra|lra| |]; simpl.
  - rewrite Rmax_left by lra; assumption.
  - destruct (after_corner a r (T - lead a r) pos) as [height _]; [lra|]; rewrite height; assumption.
Qed.

(* Where T is shorter, no change of climb that begins at the request, or later, goes so far. *)
Theorem first_leg_too_short a T D r at_ :
  0 < a -> T * T < 2 * Rabs D / a -> lead a r <= at_ -> Rabs r * (T - at_) < Rabs D.
Proof.
  intros pos short begun.
  assert (far : a * (T * T) < 2 * Rabs D).
  { apply (Rmult_lt_compat_l a) in short; [|assumption].
    replace (a * (2 * Rabs D / a)) with (2 * Rabs D) in short by (field; lra); assumption. }
  assert (size : Rabs r = 2 * a * lead a r) by (unfold lead; field; lra).
  assert (ahead := lead_pos a r pos).
  apply Rle_lt_trans with (Rabs r * (T - lead a r)); [apply Rmult_le_compat_l; [apply Rabs_pos|lra]|].
  rewrite size.
  assert (0 <= a * ((T - 2 * lead a r) * (T - 2 * lead a r))) by (apply Rmult_le_pos; [lra|apply Rle_0_sqr]).
  nra.
Qed.
