"""The golden run: the default scenario keeps its numbers."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import pytest

from tests.scenarios.golden import FILE, deviations, key_numbers


def test_the_default_scenario_keeps_its_numbers(tmp_path: Path):
    stored = json.loads(FILE.read_text(encoding="utf-8"))
    assert deviations(key_numbers(tmp_path / "cache", tmp_path / "out"), stored) == []


@pytest.mark.parametrize("capture", [0, 1, 2])
def test_the_comparison_can_fail(capture: int):
    stored = json.loads(FILE.read_text(encoding="utf-8"))
    other = copy.deepcopy(stored)
    other["mean_intensity"][0][capture] *= 1.03
    other["median"]["g"] += 0.1
    assert len(deviations(other, stored)) == 2
