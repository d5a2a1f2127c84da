"""Encounters flown: by a policy, by plans, under the monitor."""
