(* What the theorem rests on: nothing but the axioms of Coq's real numbers. *)

Require Import Area Motion Quadrature Level Safe Example.

Print Assumptions safe.
Print Assumptions apart_vertically.
Print Assumptions left_out_soundly.
Print Assumptions advanced_x.
Print Assumptions advanced_y.
Print Assumptions position_error_bound_sound.
Print Assumptions turning_x.
Print Assumptions turning_y.
Print Assumptions onward_x.
Print Assumptions onward_y.
Print Assumptions example.
Print Assumptions area_part_safe.
Print Assumptions grown_area_away.
