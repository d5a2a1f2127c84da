"""The memory of a hyper-parameter search: Optuna's journal, whole after any kill, and the values of the next trial.

Optuna does not store the state of its sampler, so a resumed study would draw its first numbers again. Here every
trial has a sampler of its own, seeded by the sweep's seed and the trial's number, that sees the trials before it: a
sweep that was killed and resumed makes the trials of an uninterrupted one.
"""

import fcntl
import hashlib
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import optuna
from optuna.pruners import BasePruner, MedianPruner, NopPruner
from optuna.samplers import BaseSampler, RandomSampler, TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, Trial, TrialState, create_trial

from agents.config.load import ConfigError
from rlcas_jax.sweep.space import Parameter

__all__ = ["JOURNAL", "Memory", "open_memory"]

JOURNAL = "journal.jsonl"
_NAME = "sweep"
_ATTEMPTS = (20, 400)
"""Draws of the model, and of those after them evenly from the space, until a combination is valid and new."""


class _Held(JournalFileOpenLock):
    """A lock that the process holds anyway: Optuna's own one outlives a killed process by half a minute."""

    def acquire(self) -> bool:
        """Do nothing."""
        return True

    def release(self) -> None:
        """Do nothing."""


class Memory:
    """The trials of a sweep, on the disk as soon as they are known."""

    def __init__(self, directory: Path, seed: int, startup: int, *, pruning: bool) -> None:
        """Open the journal of a directory, which the caller holds; :func:`open_memory` does both."""
        path = directory / JOURNAL
        _mend(path)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._seed, self._startup = seed, startup
        pruner: BasePruner = MedianPruner(n_startup_trials=max(startup, 1)) if pruning else NopPruner()
        self._storage = JournalStorage(JournalFileBackend(str(path), lock_obj=_Held(str(path))))
        self.study = optuna.create_study(
            storage=self._storage,
            sampler=RandomSampler(),  # never asked
            pruner=pruner,
            study_name=_NAME,
            direction="maximize",
            load_if_exists=True,
        )

    def trials(self) -> list[FrozenTrial]:
        """Return all trials by their number."""
        return self.study.get_trials(deepcopy=False)

    def finished(self) -> int:
        """Return how many trials are over, whatever came of them."""
        return sum(trial.state.is_finished() for trial in self.trials())

    def next(self, space: Sequence[Parameter], usable: Callable[[Mapping[str, Any]], bool]) -> Trial | None:
        """Return the trial that was begun and not finished, else a new one; None when nothing new can be found.

        Args:
            space: what varies.
            usable: whether the configuration takes a combination of values (by key).
        """
        study_id = self._storage.get_study_id_from_name(_NAME)
        for trial in self.trials():
            if not trial.state.is_finished():
                number = self._storage.get_trial_id_from_study_id_trial_number(study_id, trial.number)
                return Trial(self.study, number)
        values = self._draw(space, usable)
        if values is None:
            return None
        # One record: a trial is in the journal with all of its values or not at all.
        distributions = {parameter.key: parameter.distribution() for parameter in space}
        template = create_trial(state=TrialState.RUNNING, params=values, distributions=distributions)
        return Trial(self.study, self._storage.create_new_trial(study_id, template_trial=template))

    def _draw(self, space: Sequence[Parameter], usable: Callable[[Mapping[str, Any]], bool]) -> dict[str, Any] | None:
        before = self.trials()
        known = [trial.params for trial in before]
        judged = [trial for trial in before if trial.state in (TrialState.COMPLETE, TrialState.PRUNED)]
        distributions = {parameter.key: parameter.distribution() for parameter in space}
        for attempt in range(_ATTEMPTS[1]):
            text = f"{self._seed}/{len(before)}/{attempt}"
            seed = int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "little")
            modelled = attempt < _ATTEMPTS[0]
            sampler: BaseSampler = TPESampler(n_startup_trials=self._startup, seed=seed)
            mirror = optuna.create_study(
                direction="maximize", sampler=sampler if modelled else RandomSampler(seed=seed), study_name=_NAME
            )
            mirror.add_trials(judged)
            drawn = mirror.ask(distributions).params
            values = {parameter.key: parameter.rounded(drawn[parameter.key]) for parameter in space}
            if values not in known and usable(values):
                return values
        return None


@contextmanager
def open_memory(directory: Path, seed: int, startup: int, *, pruning: bool) -> Generator[Memory]:
    """Open a sweep's journal for this process alone; the system lets go of it however the process ends.

    Args:
        directory: of the sweep.
        seed: of the sampler.
        startup: trials that are drawn evenly and never stopped early, >= 0.
        pruning: stop trials that are below the median of those before them.

    Raises:
        ConfigError: another process works in the directory.
    """
    with (directory / "journal.lock").open("w") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ConfigError(f"--out {directory}: another process is at work on this sweep") from None
        yield Memory(directory, seed, startup, pruning=pruning)


def _mend(path: Path) -> None:
    """Cut a last line that a kill left half written."""
    if path.exists():
        with path.open("r+b") as file:
            file.truncate(file.read().rfind(b"\n") + 1)
