(* What the theorem rests on: nothing but the axioms of Coq's real numbers. *)

Require Import Signed Motion Quadrature Level Climb Wind Safe Space Example.

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
Print Assumptions flown_moves.
Print Assumptions flown_alone.
Print Assumptions before_corner.
Print Assumptions after_corner.
Print Assumptions near_corner.
Print Assumptions changes_apart.
Print Assumptions change_from_request.
Print Assumptions begins_at_request.
Print Assumptions flown_near_linear.
Print Assumptions climb_within.
Print Assumptions climb_gentle.
Print Assumptions piece_is_line.
Print Assumptions linear_keeps.
Print Assumptions first_leg.
Print Assumptions first_leg_too_short.
Print Assumptions covered_somewhere.
Print Assumptions keeps_level.
Print Assumptions piece_apart.
Print Assumptions safe_in_space.
Print Assumptions piece_off_level.
Print Assumptions area_in_space.
Print Assumptions example_in_space.
