"""The colour checker: its recipes, its comparison, its page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimators import EstimateResult
from scenarios.predict import Patch, Slab, mix_media, run_checker
from scenarios.predict import checker as module
from scenarios.predict.checker import INKS, PATCHES, QUICK_PATCHES, compared, ink_scenario
from scenarios.predict.checker_page import checker_facts, write_checker
from tests.predict.estimates import WAVELENGTH, constant, estimate, exact
from twin.materials import optical_properties

SMALL = (
    Patch("black", (0, 0, 0, 1, 0)),
    Patch("cyan & black", (0.5, 0, 0, 0.5, 0)),
)


def test_recipes_are_mixtures_and_names_are_unique() -> None:
    for patch in PATCHES:
        assert sum(patch.fractions) == pytest.approx(1.0)
    assert len({patch.name for patch in PATCHES}) == len(PATCHES) == 20
    assert len(QUICK_PATCHES) == 10
    assert set(INKS) <= {patch.name for patch in QUICK_PATCHES}
    assert PATCHES[15].recipe == "C 25 Y 25 W 50"


@pytest.mark.parametrize("quick", [False, True])
def test_every_ink_has_its_visit(quick: bool) -> None:
    for ink in INKS:
        scenario = ink_scenario(ink, quick=quick)
        assert {sample.material for sample in scenario.samples} == {f"polyjet_{ink}"}
        assert [sample.thickness_mm for sample in scenario.samples] == [0.4, 0.8]
        assert len(scenario.bench.instrument.wavelength_nm) == (16 if quick else 31)


def test_a_right_prediction_is_explained_and_a_wrong_one_not() -> None:
    truth = constant(0.6, 4.0, 0.3)
    slab = Slab(1.0, 1.5, 0.5)
    from scenarios.predict import reflectance_45_0

    value = reflectance_45_0(truth, 1.0, 1.5, 0.5)
    noise = np.full_like(value, 0.002)
    right = compared(SMALL[0], exact(truth), value, noise, slab, "D65", 1)
    assert right.difference.ciede2000 == pytest.approx(0.0, abs=1e-6)
    assert right.explained > 0.05
    assert right.covered == 1.0
    wrong = compared(SMALL[0], exact(constant(0.7, 4.0, 0.3)), value, noise, slab, "D65", 1)
    assert wrong.difference.ciede2000 > wrong.explained
    assert wrong.covered == 0.0


def fake_ink(scenario: Any, ink: str, **_: Any) -> EstimateResult:
    found = optical_properties(f"polyjet_{ink}", WAVELENGTH)
    properties = np.stack([found.albedo, found.sigma_t_per_mm, found.g], -1)
    return estimate(properties, (0.002, 0.02, 0.02))


def test_the_checker_from_given_estimates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates made from the truth: patches agree within what noise explains; the page is whole
    and a second run gives the same bytes."""
    monkeypatch.setattr("scenarios.predict.checker_work.estimated_ink", fake_ink)
    monkeypatch.setattr(module, "QUICK_PATCHES", SMALL)
    written = []
    for name in ("one", "two"):
        work = tmp_path / name
        work.mkdir()
        checker = run_checker(quick=True, draws=30, work=work, resume=name == "two")
        written.append({path.name: path.read_bytes() for path in write_checker(checker, work)})
    assert written[0] == written[1]
    assert set(written[0]) == {"checker.svg", "checker.png", "checker.html", "checker.csv"}
    page = written[0]["checker.html"].decode()
    assert "cyan &amp; black" in page
    assert not any(loads in page for loads in ('src="http', 'href="http', "url(http", "@import"))
    assert len(written[0]["checker.csv"].splitlines()) == 1 + len(SMALL) * len(WAVELENGTH)
    facts = checker_facts(checker)
    assert facts["max_ciede2000"] < 1.5
    assert facts["covered_share"] > 0.6
    assert [row["recipe"] for row in facts["patches"]] == ["K 100", "C 50 K 50"]


def test_resuming_uses_what_is_there_and_a_damaged_piece_is_made_again(tmp_path: Path) -> None:
    from scenarios.console import Console
    from scenarios.predict.checker_work import kept_patch

    made: list[int] = []

    def simulate() -> tuple[np.ndarray, np.ndarray]:
        made.append(1)
        return np.array([0.1, 0.2]), np.array([0.01, 0.02])

    console = Console(quiet=True)
    for resume in (False, True, True):
        value, _ = kept_patch(simulate, "a patch", {"seed": 1}, tmp_path, resume, console)
        assert value.tolist() == [0.1, 0.2]
    assert len(made) == 1
    kept_patch(simulate, "a patch", {"seed": 2}, tmp_path, True, console)
    assert len(made) == 2
    (path,) = [p for p in tmp_path.iterdir() if p.name.startswith("a-patch")][:1]
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-3])
    kept_patch(simulate, "a patch", {"seed": 1}, tmp_path, True, console)
    assert len(made) == 3


def test_mixing_a_checker_needs_all_inks_on_one_grid() -> None:
    media = [exact(constant(0.5, 2.0, 0.1)) for _ in INKS]
    assert mix_media(media, PATCHES[15].fractions).value[0].tolist() == pytest.approx(
        [0.5, 2.0, 0.1]
    )
