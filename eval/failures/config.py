"""Configuration of a look at the failures of a run."""

from pathlib import Path

from pydantic import Field, ValidationInfo, field_validator

from agents.config.load import Strict
from eval.config import locate


class FailuresConfig(Strict):
    """Which failures are grouped and drawn; nothing else decides what is written."""

    run: Path
    """Folder of a finished run of eval.monte_carlo, beside the configuration file or in the working
    directory."""
    policy: Path | None = None
    """The run's policy, where its file lies elsewhere now; null: where it lay then."""
    extensions: tuple[str, ...] = Field(default=(), max_length=64)
    """Inputs that the policy needs, and scenarios, of your own, `module:name` each; they are
    imported."""
    cases: int = Field(default=24, ge=0, le=120)
    """How many flights are drawn."""

    @field_validator("run", "policy")
    @classmethod
    def _located(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        return None if path is None else locate(path, info)
