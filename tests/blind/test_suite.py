"""A small suite from its making to its score, stopped and gone on with."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

import diagnosis.translucent
import twin.effects
from scenarios.blind import Suite, make, open_seals, run, score
from scenarios.blind.materials import GRID_NM, HIGH, LOW, medium
from scenarios.blind.outside import absorbing
from scenarios.blind.suite import FAMILIES, MEASUREMENT, MEASUREMENTS, SEAL, stream
from twin.effects import Catalogue, catalogue
from twin.errors import InputError
from twin.measurement import read_netcdf

TINY = Suite(
    materials=1, arms=("none", "single"), paths=512, nominal_paths=512, step_nm=30.0,
    response_paths=64, map_paths=64, seed=5,
)  # fmt: skip


@pytest.fixture
def small_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three effects that need no response of the Monte Carlo, on an unbounded bench."""
    kept = Catalogue(
        tuple(e for e in catalogue().effects if e.name in ("drift", "black_level", "thickness"))
    )
    monkeypatch.setattr(twin.effects, "catalogue", lambda: kept)
    monkeypatch.setattr(diagnosis.translucent, "catalogue", lambda: kept)
    for module in ("scenarios.blind.material_bench", "scenarios.blind.run"):
        monkeypatch.setattr(importlib.import_module(module), "maps_of", lambda *_: ())


@pytest.mark.usefixtures("small_catalogue")
def test_a_suite_from_its_making_to_its_score(tmp_path: Path) -> None:
    assert make(TINY, tmp_path)["measurements"] == 2
    folders = sorted((tmp_path / MEASUREMENTS).iterdir())
    seals = [(folder / SEAL).read_text() for folder in folders]
    files = [(folder / MEASUREMENT).read_bytes() for folder in folders]
    # nothing of the truth is in what the diagnosis gets
    visit = read_netcdf(folders[1] / MEASUREMENT)
    assert visit.truth is None
    assert visit.provenance.scenario == ""
    assert {sample.material for sample in visit.samples} == {None}
    # what a kill left unwritten is written again, from what the ledger keeps
    (folders[1] / SEAL).unlink()
    (folders[1] / MEASUREMENT).unlink()
    make(TINY, tmp_path)
    assert [(folder / SEAL).read_text() for folder in folders] == seals
    assert [(folder / MEASUREMENT).read_bytes() for folder in folders] == files
    with pytest.raises(InputError, match="another suite"):
        make(Suite(materials=2), tmp_path)
    assert run(tmp_path) == {"outcomes": 2, "failed": []}
    with pytest.raises(InputError, match="under seal"):
        score(tmp_path)
    assert open_seals(tmp_path)["broken"] == []
    figures = score(tmp_path)
    assert (figures["measurements"], figures["failed"]) == (2, 0)
    assert figures["counts"]["false_alarm_rate"][1] == 1
    # outcomes that are changed after the opening are refused
    with pytest.raises(InputError, match="were opened"):
        run(tmp_path)
    (tmp_path / "outcomes" / "outcomes.json").write_text("{}")
    with pytest.raises(InputError, match="changed after"):
        score(tmp_path)


@pytest.mark.parametrize("family", FAMILIES)
def test_materials_stay_inside_their_ranges_and_differ(family: str) -> None:
    found = [medium(family, stream(Suite(seed=3), number, 1)) for number in range(8)]
    names = ("albedo", "sigma_t_per_mm", "g")
    table = np.array([[own[name]["value"] for name in names] for own in found])
    assert table.shape == (8, 3, GRID_NM.size)
    assert np.all(table >= LOW[:, None])
    assert np.all(table <= HIGH[:, None])
    assert len({own["albedo"]["value"][30] for own in found}) == 8
    again = medium(family, stream(Suite(seed=3), 2, 1))
    assert again == found[2]


def test_another_batch_has_other_absorption_and_the_same_scattering() -> None:
    material = np.array([[0.9, 4.0, 0.6], [0.6, 2.0, 0.2]])
    found = absorbing(material, 0.5)
    before, after = (m[:, 0] * m[:, 1] for m in (material, found))
    np.testing.assert_allclose(after, before, rtol=1e-12)
    ratio = (found[:, 1] - after) / (material[:, 1] - before)
    np.testing.assert_allclose(ratio, 1.5, rtol=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"family": "milk"}, {"arms": ("triple",)}, {"materials": 0}, {"step_nm": 7.0}]
)
def test_a_suite_that_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        Suite(**wrong)  # type: ignore[arg-type]
