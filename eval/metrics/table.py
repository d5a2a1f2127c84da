"""Tables of runs, read back from parquet."""

from pathlib import Path
from typing import Any

from envs.edge.command import ConfigError

__all__ = ["read_table"]


def read_table(path: Path, what: str, schema: bytes | None = None) -> Any:
    """Return a table of pyarrow.

    Args:
        path: of the file.
        what: it shall be, for the messages.
        schema: that its metadata must name; None: any.

    Raises:
        ConfigError: it cannot be read, or is of another schema.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        read = pq.read_table(path)
    except (OSError, pa.ArrowException) as problem:
        raise ConfigError(f"{path}: cannot be read as parquet ({problem}), expected {what}") from None
    found = (read.schema.metadata or {}).get(b"rlcas_schema", b"none")
    if schema is not None and found != schema:
        raise ConfigError(
            f"{path}: has the schema {found.decode(errors='replace')!r}, expected {schema.decode()!r}, {what}"
        )
    return read
