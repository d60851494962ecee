"""Seals: what is wrong with a measurement, fixed before anybody looks.

The seal of a label is SHA-256(salt + canonical JSON of the label), beside the measurement. Labels
and salts lie in the folder `closed`, which nothing but `open_seals` reads. The salt is drawn from
the system's entropy: without it nobody can try labels until one fits.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

from scenarios.blind.suite import (
    CLOSED,
    MEASUREMENTS,
    OPENED,
    OUTCOMES,
    OUTCOMES_FILE,
    SALTS,
    SEAL,
)
from scenarios.outputs import canonical_json, file_digest
from scenarios.sweep.run import LEDGER
from twin.errors import InputError
from twin.files import write_atomically

LABELS = "labels.json"


def seal_of(label: dict[str, Any], salt: str) -> str:
    """SHA-256 (hex) of a salt and a label."""
    return hashlib.sha256((salt + canonical_json(label, indent=None)).encode()).hexdigest()


def salts_of(folder: Path, numbers: list[int]) -> dict[str, str]:
    """Salts of measurements by number; those that are missing are drawn and written."""
    path = folder / CLOSED / SALTS
    known: dict[str, str] = {}
    if path.exists():
        known = _read(path)
    missing = [str(number) for number in numbers if str(number) not in known]
    if missing:
        known |= {number: secrets.token_hex(16) for number in missing}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, (canonical_json(known) + "\n").encode())
    return known


def open_seals(folder: Path) -> dict[str, Any]:
    """Open all seals, once: labels whose seals hold, and the outcomes that were there before.

    The opening is written down with a digest of the outcomes; `score` refuses outcomes of another.
    Opening again gives what was written.

    Args:
        folder: of the suite.

    Returns:
        labels by number, numbers of broken seals, and the digest of the outcomes.

    Raises:
        InputError: nothing was made, nothing was diagnosed, or a file is damaged.
    """
    path = folder / OPENED
    if path.exists():
        return _read(path)
    labels, salts = _read(folder / CLOSED / LABELS), _read(folder / CLOSED / SALTS)
    outcomes = folder / OUTCOMES / LEDGER
    if not outcomes.exists():
        raise InputError(
            "no outcomes", "outcomes that were there before the seals are opened",
            file=outcomes, remedy="Diagnose first: benchtwin blind run FOLDER.",
        )  # fmt: skip
    broken = []
    for number, label in labels.items():
        seal = _read(folder / MEASUREMENTS / f"{int(number):04d}" / SEAL)
        if seal.get("sha256") != seal_of(label, salts.get(number, "")):
            broken.append(int(number))
    opened = {"labels": labels, "broken": broken, "outcomes": outcomes_digest(folder)}
    write_atomically(path, (canonical_json(opened) + "\n").encode())
    return opened


def outcomes_digest(folder: Path) -> str:
    """SHA-256 of the outcomes as they were written, in their order."""
    return file_digest(folder / OUTCOMES / OUTCOMES_FILE)


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"no file that can be read ({error})", "a file of a suite", file=path
        ) from error
    if not isinstance(found, dict):
        raise InputError(f"a {type(found).__name__}", "an object", file=path)
    return found
