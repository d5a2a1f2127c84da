"""The Gymnasium environment under its public name, ``envs.gymnasium_env:rlcas/Deconfliction-v0``
(``envs.gym``).
"""

from envs.gym.gymnasium_env import ENV_ID, DeconflictionEnv

__all__ = ["ENV_ID", "DeconflictionEnv"]
