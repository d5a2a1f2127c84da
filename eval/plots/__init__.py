"""Pictures of encounters and of flights."""
