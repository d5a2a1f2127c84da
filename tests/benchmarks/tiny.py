"""A training that is over at once."""

TINY = (
    "network.hidden=[8, 8]",
    "ppo.environments=8",
    "ppo.rollout=16",
    "ppo.minibatch=32",
    "ppo.segment=4",
    "ppo.epochs=2",
    "pool_rows=2",
)
