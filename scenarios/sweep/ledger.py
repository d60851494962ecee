"""The ledger of a sweep: one SQLite file that knows every point and keeps every result.

Each result is one transaction, so that a process that is killed at any moment loses at most what
it had not finished; SQLite's own write-ahead log mends the file when it is opened again. One
process writes it: workers hand their results to that one.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from scenarios.sweep.task import Answer
from twin.cache import arrays_of_bytes
from twin.errors import InputError
from twin.spectra import FloatArray

SCHEMA = """
CREATE TABLE IF NOT EXISTS points (
    key TEXT PRIMARY KEY, point TEXT NOT NULL, result BLOB, seconds REAL, message TEXT
) WITHOUT ROWID
"""
FORMAT = 1


@dataclass(frozen=True, slots=True)
class Failure:
    """A point that gave no result.

    Attributes:
        number: which point.
        point: as canonical JSON.
        message: why.
    """

    number: int
    point: str
    message: str


class Ledger:
    """Points and results of sweeps in one file.

    Args:
        path: the file; it is made when it is missing.

    Raises:
        InputError: the file is not a ledger, is in use, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._explained():
            path.parent.mkdir(parents=True, exist_ok=True)
            # In exclusive mode the log needs no shared memory, and a second writer is refused.
            self._base = sqlite3.connect(path, timeout=0.5, isolation_level=None)
            self._base.execute("PRAGMA locking_mode=EXCLUSIVE")
            self._base.execute("PRAGMA journal_mode=WAL")
            self._base.execute("PRAGMA synchronous=NORMAL")
            self._base.execute("BEGIN IMMEDIATE")
            version = self._base.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, FORMAT):
                raise InputError(f"a ledger of format {version}", f"format {FORMAT}", file=path)
            self._base.execute(SCHEMA)
            self._base.execute(f"PRAGMA user_version={FORMAT}")
            self._base.execute("COMMIT")

    def close(self) -> None:
        """Let go of the file."""
        self._base.close()

    def __enter__(self) -> Ledger:
        """The ledger itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def done(self, keys: Sequence[str]) -> set[str]:
        """Those of the keys that have a result."""
        with self._explained():
            rows = self._base.execute("SELECT key FROM points WHERE result IS NOT NULL")
            known = {row[0] for row in rows}
        return known.intersection(keys)

    def write(self, key: str, point: str, answer: Answer) -> None:
        """Keep what became of a point; a result replaces a failure, never another result.

        Raises:
            InputError: the disk is full, or the file cannot be written.
        """
        row = (key, point, answer.result or None, answer.seconds, answer.message)
        with self._explained():
            self._base.execute(
                "INSERT INTO points VALUES (?, ?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET"
                " result = excluded.result, seconds = excluded.seconds, message = excluded.message"
                " WHERE points.result IS NULL",
                row,
            )

    def result(self, key: str) -> dict[str, FloatArray] | None:
        """Arrays of a point, each of its own shape; None when there is no result.

        Raises:
            InputError: its bytes are damaged.
        """
        blob = self._blob(key)
        found = None if blob is None else arrays_of_bytes(blob)
        if blob is not None and found is None:
            raise InputError(
                f"a damaged result of the point {key}",
                "bytes with their checksum",
                file=self.path,
                remedy="Delete the file and run the sweep again.",
            )
        return found

    def message(self, key: str) -> str:
        """Why a point failed; "" when it did not, or was not tried."""
        with self._explained():
            row = self._base.execute("SELECT message FROM points WHERE key = ?", (key,)).fetchone()
        return "" if row is None else str(row[0])

    def seconds(self, keys: Sequence[str]) -> dict[str, float]:
        """Time [s] of every point that was tried, by key."""
        with self._explained():
            rows = dict(self._base.execute("SELECT key, seconds FROM points"))
        return {key: float(rows[key]) for key in keys if key in rows}

    def digest(self, keys: Sequence[str]) -> str:
        """SHA-256 over the results of keys in their order: equal for equal bytes."""
        digest = hashlib.sha256()
        for key in keys:
            blob = self._blob(key) or b""
            digest.update(f"{key}{len(blob)}\0".encode())
            digest.update(blob)
        return digest.hexdigest()

    def _blob(self, key: str) -> bytes | None:
        with self._explained():
            row = self._base.execute("SELECT result FROM points WHERE key = ?", (key,)).fetchone()
        return None if row is None else row[0]

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """SQLite's complaints in a person's words."""
        try:
            yield
        except sqlite3.Error as error:
            text = str(error)
            if "locked" in text or "busy" in text:
                raise InputError(
                    "a ledger that another process writes",
                    "one process at a time",
                    file=self.path,
                    remedy="Wait until it ends, or name another folder.",
                ) from error
            if "full" in text or "I/O" in text:
                raise InputError(
                    f"no space for another result ({text})",
                    "space on the disk",
                    file=self.path,
                    remedy="Make room and run the same command again: what is there is kept.",
                ) from error
            raise InputError(
                f"a file that is no ledger ({text})",
                "the ledger of a sweep, or no file",
                file=self.path,
                remedy="Move it away, or name another folder.",
            ) from error
        except OSError as error:
            raise InputError(
                f"a place that cannot be written ({error.strerror or error})",
                "a folder that is writable",
                file=self.path,
            ) from error
