"""The folder of a run: its configuration, finished parts, the table of encounters and the summary,
each whole.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import ConfigError, dump, load
from envs.edge.files import write_file, write_whole
from envs.edge.folder_lock import is_unused
from envs.edge.installation import versions
from eval.config import MonteCarloConfig

SCHEMA_VERSION = 1  # of summary.json

_PARTS, _CONFIG = "parts", "config.yaml"
_ROW_GROUP = 65_536
_FREE = ("policy", "workers", "figures", "confidence", "resamples")
"""Keys of a configuration on which no row of the table depends: a resumed run may change them."""


def check_unused(path: Path) -> None:
    """Refuse a folder in which no run can begin: one that holds something already, or cannot be
    read.
    """
    try:
        unused = is_unused(path)
    except OSError as problem:
        raise ConfigError(f"--out {path}: cannot be read: {problem.strerror}") from None
    if not unused:
        raise ConfigError(
            f"--out {path}: holds something already, expected a folder that is new or empty"
        )


class RunFolder:
    """The files of one evaluation."""

    model: type[MonteCarloConfig] = MonteCarloConfig  # of its configuration
    table: str = "encounters.parquet"  # name of the file with a row an encounter
    schema: bytes = b"monte_carlo 1"  # of that file, in its metadata

    def __init__(self, path: Path, config: MonteCarloConfig) -> None:
        """Name a folder and the configuration as resolved; nothing is touched before it is created
        or resumed.
        """
        self.path = path
        self._config = config

    def begin(self, *, resume: bool) -> None:
        """Begin a run in an unused folder, or go on with one of the same configuration; else
        ``ConfigError``.
        """
        if resume:
            self._check_same()
        else:
            check_unused(self.path)
        try:
            (self.path / _PARTS).mkdir(parents=True, exist_ok=True)
            for left in self.path.glob(".*.tmp"):
                left.unlink()
            write_file(self.path / _CONFIG, dump(self._config))
        except OSError as problem:
            raise ConfigError(f"--out {self.path}: cannot be written: {problem.strerror}") from None

    def _check_same(self) -> None:
        path = self.path / _CONFIG
        before, now = _plain(load(self.model, path)), _plain(self._config)
        for key in now:
            if before[key] != now[key]:
                other = f"{key} is {now[key]!r}, expected {before[key]!r} as in {path}"
                raise ConfigError(f"--resume: {other}; use another --out for another evaluation")

    def done(self) -> set[int]:
        """Return the first encounters of the chunks that are stored; other versions made them:
        ``ConfigError``.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if (self.path / self.table).is_file():
            return set(
                range(
                    0, self._config.default_count, self._config.chunk or self._config.default_count
                )
            )
        stored = set()
        for path in (self.path / _PARTS).glob("*.parquet"):
            try:
                found = (pq.read_schema(path).metadata or {}).get(b"rlcas_run", b"").decode()
            except (OSError, pa.ArrowException):
                continue  # not one of ours, or damaged: it is flown again
            if found != self._identity():
                made = f"{path} was made with other versions of the toolkit, numpy or jax"
                raise ConfigError(f"--resume: {made}; expected the same as now, or another --out")
            stored.add(int(path.stem))
        return stored

    def store(self, first: int, columns: Mapping[str, np.ndarray]) -> None:
        """Store the table of the chunk that begins with encounter ``first``."""
        import pyarrow.parquet as pq

        table = arrow_table(columns).replace_schema_metadata(
            {b"rlcas_run": self._identity().encode()}
        )
        with write_whole(self.path / _PARTS / f"{first:09d}.parquet") as path:
            pq.write_table(table, path)

    def finish(self) -> Mapping[str, np.ndarray]:
        """Join the parts, all of which must be there, and return the whole table."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        target = self.path / self.table
        if not target.is_file():
            parts = sorted((self.path / _PARTS).glob("*.parquet"))
            table = pa.concat_tables(
                pq.read_table(part).replace_schema_metadata() for part in parts
            )
            # One array a column, so that the file does not show how the run was cut into chunks.
            table = table.combine_chunks().replace_schema_metadata({b"rlcas_schema": self.schema})
            with write_whole(target) as path:
                pq.write_table(table, path, row_group_size=_ROW_GROUP)
        shutil.rmtree(self.path / _PARTS, ignore_errors=True)
        return read_table(target, "the table of this run")

    def _identity(self) -> str:
        """Return a digest by which a stored part is known to belong to this run."""
        names = ("numpy", "jaxlib") if self._config.backend == "jax" else ("numpy",)
        made = {
            "config": _plain(self._config),
            "versions": {k: versions(*names)[k] for k in ("rlcas-toolkit", *names)},
        }
        return hashlib.sha256(json.dumps(made, sort_keys=True, default=str).encode()).hexdigest()


def _plain(config: MonteCarloConfig) -> dict[str, Any]:
    """Return what the rows of a run depend on, in plain values; of files their digests, not where
    they lie.
    """
    values = {
        key: value for key, value in config.model_dump(mode="json").items() if key not in _FREE
    }
    return values | {"scenario": values["scenario"] if config.file is None else "a file"}


def arrow_table(columns: Mapping[str, np.ndarray]) -> Any:
    """Return columns as a table of pyarrow."""
    import pyarrow as pa

    kinds = {
        name: pa.string() if values.dtype == object else None for name, values in columns.items()
    }
    return pa.table({name: pa.array(values, type=kinds[name]) for name, values in columns.items()})


def read_table(path: Path, what: str, schema: bytes | None = None) -> dict[str, np.ndarray]:
    """Return the columns of a file; equal words are one object, not one a row.

    A file that cannot be read, or is of another schema than the one given, raises ``ConfigError``.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        read = pq.read_table(path)
    except (OSError, pa.ArrowException) as problem:
        raise ConfigError(
            f"{path}: cannot be read as parquet ({problem}), expected {what}"
        ) from None
    found = (read.schema.metadata or {}).get(b"rlcas_schema", b"none")
    if schema is not None and found != schema:
        raise ConfigError(
            f"{path}: has the schema {found.decode(errors='replace')!r}, expected "
            f"{schema.decode()!r}, {what}"
        )
    columns = {}
    for name, column in zip(read.column_names, read.columns, strict=True):
        if pa.types.is_string(column.type):
            coded = column.combine_chunks().dictionary_encode()
            words = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
            columns[name] = words[coded.indices.fill_null(-1).to_numpy(zero_copy_only=False)]
        else:
            columns[name] = column.to_numpy()
    return columns
