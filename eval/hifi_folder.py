"""The folder of a run of flights: as that of an evaluation in the surrogate, with another configuration."""

from typing import Any

import numpy as np

from agents.configuration import ConfigError, dump, load
from eval.hifi_config import HifiConfig
from eval.outputs import RunFolder

__all__ = ["HifiFolder"]

_TABLE, _PARTS, _CONFIG = "flights.parquet", "parts", "config.yaml"
_SCHEMA = {b"rlcas_schema": b"hifi 1"}
_FREE = ("policy", "workers", "figures", "confidence", "resamples")


class HifiFolder(RunFolder):
    """The files of one run; see :class:`eval.outputs.RunFolder`."""

    def resume(self) -> None:
        """Go on with a run.

        Raises:
            ConfigError: there is none, it was made from another configuration, or the folder cannot be written.
        """
        path = self.path / _CONFIG
        if not path.is_file():
            raise ConfigError(f"--resume: {self.path} holds no run (no {_CONFIG}), expected one that was begun")
        assert isinstance(self._config, HifiConfig)
        before, now = (_rows_of(config) for config in (load(HifiConfig, path), self._config))
        for key, value in now.items():
            if before[key] != value:
                raise ConfigError(
                    f"--resume: {key} is {value!r}, expected {before[key]!r} as in {path}; use another --out"
                )
        try:
            (self.path / _PARTS).mkdir(exist_ok=True)
            for left in self.path.glob(".*.tmp"):
                left.unlink()
            self._write(_CONFIG, lambda new: new.write_text(dump(self._config), encoding="utf-8"))
        except OSError as problem:
            raise ConfigError(f"--out {self.path}: cannot be written: {problem.strerror}") from None

    def done(self) -> set[int]:
        """Return the first flights of the chunks that are stored."""
        if (self.path / _TABLE).is_file():
            return set(range(0, self._config.wanted, self._config.chunk or self._config.wanted))
        return super().done()

    def finish(self) -> dict[str, np.ndarray]:
        """Join the parts, all of which must be there, and return the whole table."""
        import shutil

        import pyarrow as pa
        import pyarrow.parquet as pq

        target = self.path / _TABLE
        if not target.is_file():
            paths = sorted((self.path / _PARTS).glob("*.parquet"))
            joined = pa.concat_tables([pq.read_table(path) for path in paths]).combine_chunks()
            joined = joined.replace_schema_metadata(_SCHEMA)
            self._write(_TABLE, lambda path: pq.write_table(joined, path))
        shutil.rmtree(self.path / _PARTS, ignore_errors=True)
        table = pq.read_table(target)
        return {name: table.column(name).to_numpy() for name in table.column_names}


def _rows_of(config: HifiConfig) -> dict[str, Any]:
    """Return what the rows depend on; of files their digests, not where they lie."""
    values = {key: value for key, value in config.model_dump(mode="json").items() if key not in _FREE}
    return values | {"scenario": values["scenario"] if config.file is None else "a file"}
