"""Output folders and files: checked before the work starts, written atomically, the same bytes."""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
from pathlib import Path
from typing import Any

from twin.errors import InputError


def prepare_folder(folder: Path) -> Path:
    """Make an output folder and prove that a file can be written there.

    Returns:
        The folder, which exists.

    Raises:
        InputError: the folder cannot be made, is a file, or refuses a new file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, probe = tempfile.mkstemp(prefix=".benchtwin-", dir=folder)
        os.close(handle)
        os.unlink(probe)
    except OSError as error:
        raise InputError(
            f"an output folder that cannot be written ({error.strerror or error})",
            "a folder in which files can be made",
            file=folder,
            remedy="Name another folder with --out.",
        ) from error
    return folder


def prepare_file(path: Path) -> Path:
    """Prove that an output file can be written; its folder is made when it is missing.

    Raises:
        InputError: the path is a folder, or its folder cannot be written.
    """
    if path.is_dir():
        raise InputError("a folder", "the name of a file to write", file=path)
    prepare_folder(path.parent)
    return path


def canonical_json(value: Any, *, indent: int | None = 1) -> str:
    """JSON with sorted keys; a number that is not finite becomes null (JSON has no NaN)."""
    return json.dumps(
        _plain(value), sort_keys=True, indent=indent, ensure_ascii=False, allow_nan=False
    )


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # a numpy array or scalar
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def fingerprint(value: Any) -> str:
    """SHA-256 (hex) of a value's canonical JSON."""
    return hashlib.sha256(canonical_json(value, indent=None).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 (hex) of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
