(* What the theorem rests on: nothing but the axioms of Coq's real numbers. *)

Require Import Signed Motion Quadrature Level Wind Safe Example.

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
Print Assumptions area_out_of_reach.
Print Assumptions keeps_away.
Print Assumptions keeps_away_grown.
Print Assumptions side_carried.
Print Assumptions not_over_level.
Print Assumptions level_window.
Print Assumptions narrow_sound.
Print Assumptions narrow_sound_lowest.
Print Assumptions turned_in_other_wind.
