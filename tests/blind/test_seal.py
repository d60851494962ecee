"""Seals hold, and a label that was changed afterwards does not fit its own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scenarios.blind.seal import LABELS, open_seals, salts_of, seal_of
from scenarios.blind.suite import CLOSED, MEASUREMENTS, OPENED, OUTCOMES, SEAL
from scenarios.outputs import canonical_json
from scenarios.sweep.run import LEDGER
from twin.errors import InputError

LABEL_OF = {"0": {"arm": "none", "effects": []}, "1": {"arm": "single", "effects": ["gap"]}}


def _sealed(folder: Path) -> None:
    salts = salts_of(folder, [0, 1])
    (folder / CLOSED / LABELS).write_text(canonical_json(LABEL_OF))
    for number, label in LABEL_OF.items():
        own = folder / MEASUREMENTS / f"{int(number):04d}"
        own.mkdir(parents=True)
        (own / SEAL).write_text(json.dumps({"sha256": seal_of(label, salts[number])}))
    (folder / OUTCOMES).mkdir()
    (folder / OUTCOMES / LEDGER).write_bytes(b"")
    (folder / OUTCOMES / "outcomes.json").write_text("{}")


def test_a_seal_depends_on_every_part_of_the_label_and_on_the_salt() -> None:
    label = {"arm": "single", "effects": [{"name": "gap", "away": [0.5]}]}
    other = {"arm": "single", "effects": [{"name": "gap", "away": [0.5000001]}]}
    assert seal_of(label, "a") == seal_of(dict(reversed(label.items())), "a")
    assert len({seal_of(label, "a"), seal_of(other, "a"), seal_of(label, "b")}) == 3


def test_true_labels_are_opened_once(tmp_path: Path) -> None:
    _sealed(tmp_path)
    opened = open_seals(tmp_path)
    assert opened["labels"] == LABEL_OF
    assert opened["broken"] == []
    (tmp_path / CLOSED / LABELS).write_text("{}")  # what was opened stays
    assert open_seals(tmp_path) == opened


def test_a_changed_label_is_found(tmp_path: Path) -> None:
    _sealed(tmp_path)
    changed = {**LABEL_OF, "1": {"arm": "single", "effects": ["gloss"]}}
    (tmp_path / CLOSED / LABELS).write_text(canonical_json(changed))
    assert open_seals(tmp_path)["broken"] == [1]


def test_salts_are_kept_and_differ(tmp_path: Path) -> None:
    first = salts_of(tmp_path, [0, 1])
    more = salts_of(tmp_path, [0, 1, 2])
    assert {k: more[k] for k in first} == first
    assert len(set(more.values())) == 3


def test_nothing_is_opened_before_the_diagnosis_has_spoken(tmp_path: Path) -> None:
    _sealed(tmp_path)
    (tmp_path / OUTCOMES / LEDGER).unlink()
    with pytest.raises(InputError, match="no outcomes"):
        open_seals(tmp_path)
    assert not (tmp_path / OPENED).exists()
