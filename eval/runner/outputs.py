"""The folder of a run: its configuration, finished parts, the table of encounters and the summary,
each whole.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.config.load import ConfigError, Strict, dump, load
from commands.files import write_file, write_whole
from commands.folder_lock import is_unused
from commands.installation import versions
from eval.config import ChunksConfig, EncountersConfig, MonteCarloConfig

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA_VERSION = 1  # of summary.json

_CONFIG = "config.yaml"
_ROW_GROUP = 65_536


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


class ResumableFolder:
    """The folder of a run that can be gone on with by its configuration."""

    free: tuple[str, ...] = ()
    """Keys of the configuration on which no part of the run depends: a resumed run may change
    them."""
    parts: str = "parts"
    """Name of the folder with what is finished of the run, in the run's folder."""

    def __init__(self, path: Path, config: Strict) -> None:
        """Name a folder and the configuration as resolved; nothing is touched before it is created
        or resumed.
        """
        self.path = path
        self._config = config

    @property
    def packages(self) -> tuple[str, ...]:
        """Packages that must have the same versions in all parts of the run."""
        return ("numpy",)

    def begin(self, *, resume: bool) -> None:
        """Begin a run in an unused folder, or go on with one of the same configuration; else
        ``ConfigError``.
        """
        if resume:
            self._check_same()
        else:
            check_unused(self.path)
        try:
            (self.path / self.parts).mkdir(parents=True, exist_ok=True)
            for partial in self.path.glob(".*.tmp"):
                partial.unlink()
            write_file(self.path / _CONFIG, dump(self._config))
        except OSError as problem:
            raise ConfigError(f"--out {self.path}: cannot be written: {problem.strerror}") from None

    def _check_same(self) -> None:
        path = self.path / _CONFIG
        before, current = (
            self._decisive(load(type(self._config), path)),
            self._decisive(self._config),
        )
        for key in current:
            if before[key] != current[key]:
                other = f"{key} is {current[key]!r}, expected {before[key]!r} as in {path}"
                raise ConfigError(f"--resume: {other}; use another --out for another evaluation")

    def _decisive(self, config: Strict) -> dict[str, Any]:
        """Return what the parts of a run depend on, in plain values; of files their digests, not
        where they lie.
        """
        values = config.model_dump(mode="json")
        if isinstance(config, EncountersConfig) and config.file is not None:
            values["scenario"] = "a file"
        return {key: value for key, value in values.items() if key not in self.free}

    def identity(self) -> str:
        """Return a digest by which a stored part is known to belong to this run."""
        origin = {
            "config": self._decisive(self._config),
            "versions": {k: versions(*self.packages)[k] for k in ("rlcas-toolkit", *self.packages)},
        }
        return hashlib.sha256(json.dumps(origin, sort_keys=True, default=str).encode()).hexdigest()

    def check_made_here(self, part: Path, identity: str) -> None:
        """Refuse a stored part with the identity of another run."""
        if identity != self.identity():
            problem = f"{part} was made with other versions of the toolkit, numpy or jax"
            raise ConfigError(f"--resume: {problem}; expected the same as now, or another --out")


class RunFolder(ResumableFolder):
    """The files of one evaluation."""

    free = ("policy", "workers", "figures", "confidence", "resamples")
    model: type[ChunksConfig] = MonteCarloConfig  # of its configuration
    table: str = "encounters.parquet"  # name of the file with a row an encounter
    schema: bytes = b"monte_carlo 1"  # of that file, in its metadata

    def __init__(self, path: Path, config: ChunksConfig) -> None:
        super().__init__(path, config)
        self._config: ChunksConfig = config

    @property
    def packages(self) -> tuple[str, ...]:
        """Packages that must have the same versions in all parts of the run."""
        compiled = isinstance(self._config, MonteCarloConfig) and self._config.backend == "jax"
        return ("numpy", "jaxlib") if compiled else ("numpy",)

    def stored(self) -> set[int]:
        """Return the first encounters of the chunks that are stored; other versions made them:
        ``ConfigError``.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if (self.path / self.table).is_file():
            total = self._config.default_count
            return set(range(0, total, self._config.chunk or total))
        stored = set()
        for path in (self.path / self.parts).glob("*.parquet"):
            try:
                identity = (pq.read_schema(path).metadata or {}).get(b"rlcas_run", b"").decode()
            except (OSError, pa.ArrowException):
                continue  # not one of ours, or damaged: it is flown again
            self.check_made_here(path, identity)
            stored.add(int(path.stem))
        return stored

    def store(self, first: int, columns: Mapping[str, np.ndarray]) -> None:
        """Store the table of the chunk that begins with encounter ``first``."""
        import pyarrow.parquet as pq

        table = arrow_table(columns).replace_schema_metadata(
            {b"rlcas_run": self.identity().encode()}
        )
        with write_whole(self.path / self.parts / f"{first:09d}.parquet") as path:
            pq.write_table(table, path)

    def finish(self) -> Mapping[str, np.ndarray]:
        """Join the parts, all of which must be there, and return the whole table."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        target = self.path / self.table
        if not target.is_file():
            parts = sorted((self.path / self.parts).glob("*.parquet"))
            table = pa.concat_tables(
                pq.read_table(part).replace_schema_metadata() for part in parts
            )
            # One array a column, so that the file does not show how the run was cut into chunks.
            table = table.combine_chunks().replace_schema_metadata({b"rlcas_schema": self.schema})
            with write_whole(target) as path:
                pq.write_table(table, path, row_group_size=_ROW_GROUP)
        shutil.rmtree(self.path / self.parts, ignore_errors=True)
        return read_table(target, "the table of this run")


def arrow_table(columns: Mapping[str, np.ndarray]) -> "pa.Table":
    """Return columns as a table of pyarrow."""
    import pyarrow as pa

    kinds = {
        name: pa.string() if values.dtype == object else None for name, values in columns.items()
    }
    return pa.table({name: pa.array(values, type=kinds[name]) for name, values in columns.items()})


def read_table(path: Path, expected: str, schema: bytes | None = None) -> dict[str, np.ndarray]:
    """Return the columns of a file; equal words are one object, not one a row.

    A file that cannot be read, or is of another schema than the one given, raises ``ConfigError``.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        read = pq.read_table(path)
    except (OSError, pa.ArrowException) as problem:
        raise ConfigError(
            f"{path}: cannot be read as parquet ({problem}), expected {expected}"
        ) from None
    stored_schema = (read.schema.metadata or {}).get(b"rlcas_schema", b"none")
    if schema is not None and stored_schema != schema:
        raise ConfigError(
            f"{path}: has the schema {stored_schema.decode(errors='replace')!r}, expected "
            f"{schema.decode()!r}, {expected}"
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
