"""The examples of docs/property_testing.md run, and its table is the one of the code."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from scenarios.strategies import ALL, Problem

PAGE = Path(__file__).resolve().parents[2] / "docs" / "property_testing.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)


def run(number: int, folder: Path) -> dict[str, Any]:
    file = folder / f"block_{number}.py"
    file.write_text(BLOCKS[number], encoding="utf-8")
    return runpy.run_path(str(file))


def test_three_lines_make_a_class_of_tests(tmp_path: Path) -> None:
    assert len([line for line in BLOCKS[0].splitlines() if line]) == 3
    made = run(0, tmp_path)["TestMine"]
    tests = [name for name in vars(made) if name.startswith("test_")]
    assert tests == [f"test_{one.name}" for one in ALL]
    made().test_says_when_masked()


def test_three_lines_check_an_estimator(tmp_path: Path) -> None:
    assert len([line for line in BLOCKS[1].splitlines() if line]) == 3
    assert "check_estimator" in run(1, tmp_path)


def test_the_example_with_strategies_runs(tmp_path: Path) -> None:
    example = run(2, tmp_path)["test_beer_never_finds_more_than_there_is"]
    assert example.is_hypothesis_test  # it draws materials: it is no plain function
    example()


def test_the_example_with_effects_runs(tmp_path: Path) -> None:
    example = run(3, tmp_path)["test_two_percent_of_thickness_are_not_more_of_sigma_t"]
    assert example.is_hypothesis_test
    example()
    # The check can fail: 20 % of both thicknesses are more of sigma_t.
    thicker = {f"thickness[{name}]": {"relative": 0.2} for name in ("0.5 mm", "1 mm")}
    thick = Problem.of([(0.4, 2.0, 0.0)] * 2, effects=thicker)
    with pytest.raises(AssertionError):
        example.hypothesis.inner_test(thick)


def test_the_table_is_complete() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.M)
    assert [row for row in rows if row[1][0].isupper() and row[1].endswith(".")] == [
        (one.name, one.says) for one in ALL
    ]
