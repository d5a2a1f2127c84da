"""What a policy commands, place by place: ``python -m eval.policy_map``."""
