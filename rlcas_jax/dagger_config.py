"""What refining by dataset aggregation can be told: a training's configuration with a section of its own."""

from pydantic import Field, NonNegativeFloat, model_validator

from agents.config.load import ConfigError, Strict
from agents.policy.features import begins
from rlcas_jax.config import TrainConfig

__all__ = ["DaggerConfig", "DaggerRun"]


class DaggerConfig(Strict):
    """Dataset aggregation (Ross et al. 2011): fly, be told, learn all that was told so far; and again."""

    rounds: int = Field(default=3, ge=1, le=100)
    """How often the policy is flown, and learns."""
    rollouts: int = Field(default=80, ge=1)
    """Rollouts of a round (`ppo.rollout` time steps in `ppo.environments` environments each) that are told about."""
    settling: int = Field(default=3, ge=0)
    """Rollouts before them that are not: after these encounters of all ages are in flight."""
    still: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of the environments that fly without noise, as the policy is flown later."""
    kept: float = Field(default=0.4, gt=0.0, le=1.0)
    """Share that is kept of what no lesson speaks of."""
    blocked: float = Field(default=0.3, gt=0.0, le=1.0)
    """Of what is seen, as much as is looked for ways home at most (`practice.prompt`)."""
    flown: float = Field(default=1 / 32, gt=0.0, le=1.0)
    """Of what is seen, as much as the policy is flown on from at most; of `blocked` at most."""
    epochs: int = Field(default=4, ge=1)
    """Passes, in each round, over what all rounds were told."""
    minibatch: int = Field(default=4096, ge=2)
    """Samples a gradient step."""
    learning_rate: float = Field(default=5e-4, gt=0.0, le=1.0)
    """Greatest step size of Adam; it rises to this in the first two hundred steps of a round, and falls to 0 as a
    cosine does."""
    orthogonal_rate: float = Field(default=0.0, ge=0.0, le=1.0)
    """The same of Muon (Jordan et al. 2024), which makes the steps of the hidden layers' matrices orthogonal; 0: Adam
    takes these, too."""
    nearly: float = Field(default=0.1, gt=0.0)
    """Distance from what is told, 1 at the limit, up to which its square counts; beyond it counts linearly, so that
    what is told here and there against all else moves little (Huber's loss)."""
    smoothness: tuple[NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0)
    """Weights, in the loss, of the mean change of acceleration and turn rate (1: full deflection) from one time step to
    the next where no lesson speaks."""


class DaggerRun(TrainConfig):
    """The configuration of a training, whose encounters are flown, and how the policy is refined.

    Of ``practice`` the weights of the lessons count, and ``teaching``, that of what no lesson speaks of: there the
    policy stays as it is, or as ``teacher`` where nothing is in the way home. Of ``ppo`` there are ``environments`` and
    ``rollout``, of ``shaping`` nothing.
    """

    dagger: DaggerConfig = DaggerConfig()
    """How the policy of `start_from` is refined."""

    @model_validator(mode="after")
    def _check_dagger(self) -> "DaggerRun":
        if self.start_from is None:
            raise ConfigError("start_from is null; expected the policy file, or the directory of a run, to refine")
        if not begins(self.network.feature_set, "foresight"):
            raise ConfigError(
                f"network.feature_set is {self.network.feature_set}; expected foresight, advised or pressed"
            )
        if not max(self.practice.pressed, self.practice.prompt, self.practice.unwind) > 0.0:
            raise ConfigError("practice.pressed, prompt and unwind are 0; expected a lesson to be told")
        if self.dagger.flown > self.dagger.blocked:
            raise ConfigError(
                f"dagger.flown is {self.dagger.flown:g}; expected dagger.blocked, {self.dagger.blocked:g}, at most"
            )
        return self
