"""Files that can be computed again: content keys, atomic writes, checksums."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from twin.errors import InputError
from twin.files import write_atomically
from twin.spectra import FloatArray

MAGIC = b"benchtwin arrays 1\n"


def cache_folder(kind: str) -> Path:
    """The user's cache folder for one kind of file; BENCHTWIN_CACHE moves it."""
    base = os.environ.get("BENCHTWIN_CACHE")
    root = Path(base) if base else Path(platformdirs.user_cache_dir("benchtwin", False))
    return root / kind


def content_key(described: Mapping[str, object]) -> str:
    """SHA-256 (first 32 hex digits) of a description as canonical JSON."""
    text = json.dumps(described, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def bytes_of_arrays(arrays: Mapping[str, FloatArray]) -> bytes:
    """Arrays of any shape with a checksum before them; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    ordered: dict[str, Any] = {name: np.asarray(arrays[name]) for name in sorted(arrays)}
    np.savez(buffer, **ordered)
    payload = buffer.getvalue()
    return MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


def arrays_of_bytes(data: bytes) -> dict[str, FloatArray] | None:
    """Arrays of their own shapes from `bytes_of_arrays`; None when a byte is not as it was."""
    head = len(MAGIC) + 65
    payload = data[head:]
    digest = hashlib.sha256(payload).hexdigest().encode()
    if data[: len(MAGIC)] != MAGIC or data[len(MAGIC) : head] != digest + b"\n":
        return None
    with np.load(io.BytesIO(payload), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def store_arrays(path: Path, arrays: Mapping[str, FloatArray]) -> None:
    """Write arrays with a checksum, atomically; the same arrays give the same bytes.

    Raises:
        InputError: the folder cannot be written.
    """
    data = bytes_of_arrays(arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            error.strerror or str(error), "a cache folder that can be written", file=path.parent
        ) from error
    write_atomically(path, data)


def load_arrays(path: Path, say: Callable[[str], None]) -> dict[str, FloatArray] | None:
    """Read what `store_arrays` wrote; None when it is missing or damaged (which is said)."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    found = arrays_of_bytes(data)
    if found is None:
        say(f"{path.name} in the cache is damaged (its checksum differs); it is computed again")
    return found
