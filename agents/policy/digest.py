"""The one text of a policy file's metadata, and the digest over it and the tensors
(docs/reference/policy-file.md).
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def canonical(document: Any) -> str:
    """Return the one JSON text of a document: sorted keys, no white space, ASCII; NaN raises a
    ValueError.
    """
    return json.dumps(
        document, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False
    )


def digest(tensors: Mapping[str, np.ndarray], document: Mapping[str, Any]) -> str:
    """Return the SHA-256 (hex) over all tensors, in the order of their names, and the metadata.

    Hashed are the canonical JSON of each ``[name, dtype, shape]``, a line feed and its bytes
    (little-endian, C order); then the canonical JSON of the metadata without ``sha256``.
    """
    total = hashlib.sha256()
    for name in sorted(tensors):
        tensor = np.ascontiguousarray(tensors[name])
        tensor = tensor.astype(tensor.dtype.newbyteorder("<"), copy=False)
        total.update(canonical([name, tensor.dtype.name, list(tensor.shape)]).encode() + b"\n")
        total.update(tensor.tobytes())
    total.update(
        canonical({key: value for key, value in document.items() if key != "sha256"}).encode()
    )
    return total.hexdigest()


def sha256(text: str) -> str:
    """Return the SHA-256 of a text, hex."""
    return hashlib.sha256(text.encode()).hexdigest()
