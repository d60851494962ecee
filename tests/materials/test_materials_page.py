"""docs/materials.md says of every entry what the library says of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.materials import Entry, entry, names
from twin.materials.library import COMPOSED, Kind

PAGE = Path(__file__).resolve().parents[2] / "docs" / "materials.md"
LISTED: list[tuple[Kind, str]] = [
    (kind, name)
    for kind in ("refractive_index", "reflectance", "material")
    for name in names(kind)  # type: ignore[arg-type]
    if name not in COMPOSED
]


def _row(kind: str, name: str) -> str:
    rows = [
        line
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith(f"| `{name}` |")
    ]
    # Water is a refractive index and a material.
    assert len(rows) == 1 + (name == "water"), f"{kind} {name}: {len(rows)} rows"
    return rows[0] if kind == "refractive_index" else rows[-1]


@pytest.mark.parametrize(("kind", "name"), LISTED)
def test_the_page_has_the_source_and_range_of_every_entry(kind: Kind, name: str) -> None:
    row, found = _row(kind, name), entry(kind, name)
    low, high = found.range_nm
    assert found.citation in row
    assert f"| {low:g} to {high:g} |" in row
    for first, last in found.assumed_nm:
        assert f"{first:g} to {last:g}" in row.split(f"| {low:g} to {high:g} |")[1]
    if isinstance(found, Entry):
        assert ("approximation" in row) is found.approximation
    else:
        assert ("interpolated" in row) is found.interpolated


def test_the_page_names_every_composition_and_our_lamps() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name, composition in COMPOSED.items():
        assert f"| `{name}` | `{composition}` |" in text
    for name in ("led_cool_white", "led_warm_white", "xenon", "D65"):
        assert f"`{name}`" in text
