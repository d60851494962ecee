"""The estimator that learns from drawn materials: its draws, its network, what it keeps."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimators.fluorescence import FluorescenceStatus, fluorescence_estimator, learned
from estimators.fluorescence.cells import Cells
from estimators.fluorescence.learned import DonaldsonLearnedEstimator, DonaldsonLearnedSettings
from estimators.fluorescence.learned_draws import MaterialPrior, materials
from estimators.fluorescence.quick import DonaldsonQuickEstimator
from tests.fluorescence.cases import BELOW, material, system
from twin.errors import InputError
from twin.fluorescence.donaldson import GRID_NM
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem
from twin.spectra import FloatArray

CELLS = Cells(GRID_NM, GRID_NM)
SIGMA = 2e-3
"""Noise of every capture: with other noise a network is trained anew."""
TINY: dict[str, Any] = {"materials": 600, "epochs": 1, "width": 16, "layers": 1}
SMALL = DonaldsonLearnedSettings(materials=8000, epochs=4, width=96, layers=2, keep=False)


def data(matrix: FloatArray, bench: FluorescenceSystem, seed: int) -> FluorescenceData:
    clean = bench.captures(matrix)
    noise = np.random.Generator(np.random.Philox(key=seed)).standard_normal(clean.shape)
    return FluorescenceData(
        bench, clean + SIGMA * noise, np.full(clean.shape, SIGMA**2),
        np.zeros((0, *clean.shape)), np.ones(clean.shape, dtype=bool),
    )  # fmt: skip


def drawn(count: int, seed: int, prior: MaterialPrior | None = None) -> FloatArray:
    random = np.random.Generator(np.random.Philox(key=seed))
    return np.asarray(materials(count, CELLS, prior or MaterialPrior(), random), dtype=np.float64)


@pytest.fixture(scope="module")
def small() -> DonaldsonLearnedEstimator:
    """A small network for the chip, made from ten samples."""
    estimator = DonaldsonLearnedEstimator(SMALL)
    bench = system("chip")
    estimator.estimate_batch([data(material(seed), bench, seed) for seed in range(10)])
    return estimator


def test_draws_are_matrices() -> None:
    found = drawn(400, 1)
    cells, reflectance = found[:, : BELOW.sum()], found[:, BELOW.sum() :]
    assert reflectance.shape == (400, 31)
    assert cells.min() >= 0.0
    assert cells.max() < 1.2
    assert reflectance.min() >= 0.0099
    assert reflectance.max() <= 0.981
    assert np.array_equal(found, drawn(400, 1))
    assert not np.array_equal(found, drawn(400, 2))


def test_draws_without_products_hold_no_fluorophore() -> None:
    """And every material with exactly one, the control, does."""
    away = CELLS.emission - CELLS.excitation > 25.0
    none = drawn(300, 3, MaterialPrior(counts=(1.0,)))[:, : away.size][:, away]
    one = drawn(300, 3, MaterialPrior(counts=(0.0, 1.0)))[:, : away.size][:, away]
    assert np.median(none.max(axis=1)) < 0.012
    assert np.median(one.max(axis=1)) > 0.03


def test_dyes_take_from_the_reflectance_what_they_absorb() -> None:
    """Reflectance and strength of excitation go against each other; without dips they do not."""

    def slope(dips: float) -> float:
        found = drawn(1500, 5, MaterialPrior(counts=(0.0, 1.0), dips=dips, variation=0.3))
        matrix = CELLS.matrix(found[:, : BELOW.sum()], found[:, BELOW.sum() :])
        excited = matrix[:, -1, :20] + matrix[:, -4, :20] + matrix[:, -7, :20]
        level = np.log(np.einsum("bii->bi", matrix)[:, :20])
        excited -= excited.mean(axis=1, keepdims=True)
        level -= level.mean(axis=1, keepdims=True)
        return float((np.sign(excited) * level).mean())

    assert slope(1.0) < -0.02
    assert abs(slope(0.0)) < 0.01


def test_a_small_network_is_better_than_the_linear_estimate(
    small: DonaldsonLearnedEstimator,
) -> None:
    bench = system("chip")
    given = [data(material(seed), bench, seed) for seed in range(20, 44)]
    truth = np.array([material(seed) for seed in range(20, 44)])
    error = {}
    for one in (small, DonaldsonQuickEstimator()):
        results = one.estimate_batch(given)
        matrix = np.array([r.matrix for r in results])
        error[one.name] = np.sqrt(((matrix - truth)[:, BELOW] ** 2).mean(axis=1))
    ratio = np.log(error["donaldson-learned"] / error["donaldson-quick"]).mean()
    assert np.exp(ratio) < 0.85


def test_intervals_cover_materials_of_the_prior(small: DonaldsonLearnedEstimator) -> None:
    """90 %, about; half as wide, the control, they cover clearly less."""
    bench = system("chip")
    unknowns = drawn(150, 77)
    truth = CELLS.matrix(unknowns[:, : BELOW.sum()], unknowns[:, BELOW.sum() :])
    found = small.estimate_batch([data(each, bench, n) for n, each in enumerate(truth)])
    interval = np.array([r.interval for r in found])
    matrix = np.array([r.matrix for r in found])
    strong = BELOW & (truth > 0.003)
    inside = (truth >= interval[:, 0] - 1e-9) & (truth <= interval[:, 1] + 1e-9)
    half = matrix[:, None] + 0.5 * (interval - matrix[:, None])
    narrow = (truth >= half[:, 0] - 1e-9) & (truth <= half[:, 1] + 1e-9)
    assert 0.88 < inside[strong].mean() < 0.995
    assert narrow[strong].mean() < inside[strong].mean() - 0.04
    assert np.all(interval[:, 0] <= matrix)
    assert np.all(matrix <= interval[:, 1])
    assert np.mean([r.status is FluorescenceStatus.INCONSISTENT for r in found]) < 0.05


def test_a_kept_network_serves_other_light_levels(
    small: DonaldsonLearnedEstimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lamp 2 % brighter changes nothing once its level is known; told wrongly, it does."""

    def refuse(*_: object, **__: object) -> None:
        pytest.fail("trained again")

    monkeypatch.setattr(learned, "train", refuse)
    bench = system("chip")
    level = 1.0 + 0.02 * np.cos(np.arange(8.0))
    brighter = FluorescenceSystem(bench.illuminants * level[:, None], bench.sensitivities)
    one = data(material(31), bench, 31)
    lit = replace(one, system=brighter, value=one.value * level[:, None])
    usual, other = small.estimate(one), small.estimate(lit)
    untold = small.estimate(replace(lit, system=bench))
    scale = np.abs(usual.matrix[BELOW]).max()
    assert np.abs(other.matrix - usual.matrix)[BELOW].max() < 0.02 * scale
    assert np.abs(untold.matrix - usual.matrix)[BELOW].max() > 0.04 * scale
    assert other.fingerprint != usual.fingerprint


def test_captures_that_no_drawn_material_makes_are_inconsistent(
    small: DonaldsonLearnedEstimator,
) -> None:
    unknowns = drawn(1, 8)
    matrix = CELLS.matrix(unknowns[:, : BELOW.sum()], unknowns[:, BELOW.sum() :])[0]
    one = data(matrix, system("chip"), 31)
    assert small.estimate(one).status is not FluorescenceStatus.INCONSISTENT
    swapped = replace(one, value=one.value[:, ::-1].copy())
    assert small.estimate(swapped).status is FluorescenceStatus.INCONSISTENT


def test_same_seed_same_network_and_refused_options() -> None:
    bench = system("chip")
    one = data(material(4), bench, 4)
    found = [
        fluorescence_estimator("donaldson-learned", **TINY, keep=False, seed=seed).estimate(one)
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(found[0].matrix, found[1].matrix)
    assert np.array_equal(found[0].quantile, found[1].quantile)
    assert not np.array_equal(found[0].matrix, found[2].matrix)
    with pytest.raises(InputError, match="epochs"):
        fluorescence_estimator("donaldson-learned", epochs=0)


def test_a_network_is_kept_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process finds it, byte by byte; what is damaged is said and trained again."""
    monkeypatch.setenv("BENCHTWIN_CACHE", str(tmp_path))
    one, other = (data(material(4), system("chip"), seed) for seed in (4, 5))
    usual = fluorescence_estimator("donaldson-learned", **TINY).estimate(one)
    (path,) = (tmp_path / "networks").iterdir()
    with monkeypatch.context() as patch:

        def refuse(*_: object, **__: object) -> None:
            pytest.fail("trained again")

        patch.setattr(learned, "train", refuse)
        again = fluorescence_estimator("donaldson-learned", **TINY).estimate(one)
        with pytest.raises(pytest.fail.Exception, match="trained again"):
            fluorescence_estimator("donaldson-learned", **TINY).estimate(other)
    assert again.matrix.tobytes() == usual.matrix.tobytes()
    assert again.quantile.tobytes() == usual.quantile.tobytes()
    assert again.fingerprint == usual.fingerprint
    kept = path.read_bytes()
    path.write_bytes(kept[:-1] + bytes([kept[-1] ^ 1]))
    with pytest.warns(UserWarning, match="damaged"):
        mended = fluorescence_estimator("donaldson-learned", **TINY).estimate(one)
    assert mended.matrix.tobytes() == usual.matrix.tobytes()
    assert path.read_bytes() == kept
    (tmp_path / "file").touch()
    monkeypatch.setenv("BENCHTWIN_CACHE", str(tmp_path / "file"))
    with pytest.warns(UserWarning, match="not kept"):
        lost = fluorescence_estimator("donaldson-learned", **TINY).estimate(one)
    assert lost.matrix.tobytes() == usual.matrix.tobytes()


def test_training_says_how_far_it_is() -> None:
    estimator = DonaldsonLearnedEstimator(DonaldsonLearnedSettings(**TINY, keep=False))
    said: list[tuple[float, float]] = []
    estimator.report = lambda done, total: said.append((done, total))
    estimator.estimate(data(material(4), system("chip"), 4))
    done = [each[0] for each in said]
    assert done == sorted(done)
    assert len({total for _, total in said}) == 1
    assert done[-1] == pytest.approx(said[0][1])


@pytest.mark.skipif(len(getattr(os, "sched_getaffinity", lambda _: {0})(0)) < 2, reason="one core")
def test_the_same_bytes_on_one_core() -> None:
    """A process that may use one core alone trains the same network, byte by byte."""
    program = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "from tests.fluorescence import test_estimators_learned as here\n"
        "print(here.trained())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parents[2], env={**os.environ},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == trained().split()


def trained() -> str:
    """A digest of a small network, and of one with another seed."""
    one, found = data(material(4), system("chip"), 4), []
    for seed in (1, 2):
        settings = DonaldsonLearnedSettings(**TINY, keep=False, seed=seed)
        found.append(
            hashlib.sha256(DonaldsonLearnedEstimator(settings).estimate(one).matrix).hexdigest()
        )
    assert found[0] != found[1]
    return " ".join(found)
