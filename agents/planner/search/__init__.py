"""How plans are found: goals, the policy's rollouts, manoeuvres and ways round areas."""
