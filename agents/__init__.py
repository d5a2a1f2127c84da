"""Resolvers: networks and PPO, policy files, inference, planning and baselines."""
