"""Sphere measurements diagnosed: visits of the sphere model with a planted effect."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from diagnosis import Diagnosis, diagnose
from diagnosis.sphere_effects import CATALOGUE, change_of, without
from diagnosis.sphere_noise import SphereNoise
from diagnosis.spheres import SphereCase, diagnose_spheres, sphere_case
from estimators.sphere import SphereSettings
from tests.spheres.visits import visit_of
from twin.errors import InputError
from twin.measurement.rxt import SphereVisit

FOLDER = Path(__file__).resolve().parents[2] / ".." / "shared/data/translucent/iad_rxt"
SIGMA = np.array([0.4, 0.8, 1.2, 1.6, 2.0, 2.4])
ALBEDO, G = 0.93, 0.6
NO_LOSS = SphereSettings(lost_light=False)
NOISE = SphereNoise(relative=0.003, absolute=1e-4)


def dilutions(diluent: float = 0.0, strength: np.ndarray | float = 1.0) -> SphereVisit:
    """Dilutions of one stock between slides, without noise."""
    added = SIGMA * strength
    whole = added + diluent
    return visit_of(
        ALBEDO * added / whole, whole, np.full(SIGMA.size, G), slide=1.0,
        model_options={"lost_light": False},
    )  # fmt: skip


def noisy(visit: SphereVisit, number: int) -> SphereVisit:
    """The visit with the noise of `NOISE`, its calibration included."""
    generator = np.random.Generator(np.random.Philox(key=[71, number]))
    sd = NOISE.relative * visit.value + NOISE.absolute
    level = generator.standard_normal(3) * np.array(NOISE.calibration)
    value = visit.value + sd * generator.standard_normal(visit.value.shape)
    return replace(visit, value=value * (1.0 + level))


def case_of(visit: SphereVisit, concentration: list[float] | None = None) -> SphereCase:
    return sphere_case(
        visit, settings=NO_LOSS, dilutions=True, noise=NOISE, concentration=concentration
    )


@cache
def control() -> SphereCase:
    return case_of(noisy(dilutions(), 0))


def judged(case: SphereCase) -> Diagnosis:
    return diagnose(case.problem, seed=3)


def test_the_twin_reads_what_the_sphere_model_reads() -> None:
    case = control()
    stock = [np.log(ALBEDO / (1 - ALBEDO)), np.arctanh(G), *np.log(SIGMA)]
    found = case.problem.forward(np.array([stock]), {})
    assert found.reshape(-1, 3) == pytest.approx(dilutions().value, abs=1e-9)


def test_slopes_are_those_of_the_readings() -> None:
    case = control()
    at = case.problem.material
    slopes = case.problem.jacobian(at, {})
    step = 1e-3
    for index in range(at.shape[1]):
        moved = np.zeros_like(at)
        moved[0, index] = step
        ahead, back = (case.problem.forward(at + s * moved, {}) for s in (1.0, -1.0))
        assert slopes[..., index] == pytest.approx((ahead - back) / (2 * step), abs=2e-5)


def test_without_an_effect_there_is_no_gap() -> None:
    found = judged(control())
    assert found.verdict == "no_gap"
    assert found.p > 0.02


def test_slides_that_nobody_described_are_named_and_close_the_gap() -> None:
    visit = noisy(dilutions(), 1)
    one = np.ones(visit.rows)
    found = judged(case_of(replace(visit, slide_n=one, slide_thickness_mm=0.0 * one)))
    assert found.effects[0].name == "slides"
    assert "slides" in found.credible_set
    share = found.effects[0].parameters[0]
    assert share.value == pytest.approx(1.0, abs=max(3 * share.sd, 0.05))
    assert found.best is not None
    assert found.null is not None
    assert found.best.chi_square < 0.3 * found.null.chi_square


def test_a_wrong_thickness_is_said_to_be_invisible() -> None:
    visit = noisy(dilutions(), 0)
    wrong = case_of(replace(visit, thickness_mm=1.05 * visit.thickness_mm))
    found = judged(wrong)
    assert found.verdict == "no_gap"
    assert "thickness" in {each.name for each in found.not_identifiable}
    assert "thickness" not in {each.name for each in found.effects}


def test_absorption_of_the_diluent_is_named_with_its_value() -> None:
    found = judged(case_of(noisy(dilutions(diluent=0.08), 2)))
    assert found.effects[0].name == "diluent_absorption"
    value = found.effects[0].parameters[0]
    assert value.value == pytest.approx(0.08, abs=4 * value.sd + 0.005)


def test_the_dilution_that_was_made_wrongly_is_named() -> None:
    strength = np.ones(SIGMA.size)
    strength[3] = 1.12
    found = judged(case_of(noisy(dilutions(strength=strength), 3), list(SIGMA)))
    assert found.effects[0].name == f"concentration[dilution {SIGMA[3]:g}]"
    assert found.effects[0].parameters[0].value == pytest.approx(0.12, abs=0.03)


def test_effects_that_these_data_cannot_have_are_left_out_with_a_reason() -> None:
    left = dict(control().left_out)
    assert left["concentration"] == "no concentrations are given"
    assert left["lost_light"] == "changes nothing in these data"
    assert left.keys() == {"concentration", "lost_light"}
    searched = sphere_case(
        dilutions(), settings=NO_LOSS, dilutions=True, noise=NOISE, diluent=True,
        concentration=list(SIGMA),
    )  # fmt: skip
    assert dict(searched.left_out)["diluent_absorption"].startswith("it is searched")
    alone = sphere_case(replace(dilutions(), wavelength_nm=np.linspace(400, 500, 6)))
    assert dict(alone.left_out).keys() == {"diluent_absorption", "concentration"}
    for case in (control(), searched, alone):
        names = {each.effect for each in case.problem.candidates} | dict(case.left_out).keys()
        assert names >= {effect.name for effect in CATALOGUE}, "nothing is dropped in silence"


@pytest.mark.parametrize("letters", ["rt", "rtu"])
def test_one_sample_cannot_tell(letters: str) -> None:
    rows = np.ones(2)
    visit = visit_of(
        0.9 * rows, 1.0 * rows, 0.5 * rows, letters=letters, model_options={"lost_light": False}
    )
    found = judged(sphere_case(visit, settings=NO_LOSS))
    assert found.verdict == "cannot_tell"
    assert "Measure" in found.reason
    assert len(found.not_identifiable) >= 10


def test_repeats_give_the_noise_and_fillings_stay_out_of_it() -> None:
    generator = np.random.Generator(np.random.Philox(key=[71, 9]))
    repeats = 8
    added = np.repeat(SIGMA, repeats) * (
        1.0 + 0.05 * generator.standard_normal(SIGMA.size * repeats)
    )
    many = visit_of(
        np.full(added.size, ALBEDO), added, np.full(added.size, G), slide=1.0,
        model_options={"lost_light": False},
    )  # fmt: skip
    scatter = 1.0 + 0.01 * generator.standard_normal(many.value.shape)
    case = sphere_case(
        replace(many, value=many.value * scatter), settings=NO_LOSS, dilutions=True,
        fillings=np.repeat(np.arange(SIGMA.size), repeats).tolist(),
        effects=without(e.name for e in CATALOGUE),
    )  # fmt: skip
    assert case.noise.relative == pytest.approx(0.01, rel=0.25)
    assert case.noise.filling == pytest.approx(0.05, rel=0.3)
    assert any("repeats" in reason for reason in case.reasons)


def test_effects_by_name() -> None:
    change = change_of({"slides": np.array([0.4]), "dark_offset[M_T]": np.array([0.01])})
    assert change.slides == 0.4
    assert change.offset == {"M_T": 0.01}
    with pytest.raises(InputError, match="no such thing"):
        change_of({"no such thing": np.array([1.0])})
    with pytest.raises(InputError, match="sludges"):
        without(["sludges"])


def test_what_does_not_belong_together_is_refused() -> None:
    visit = dilutions()
    with pytest.raises(InputError, match="one for each of 6"):
        sphere_case(visit, dilutions=True, fillings=[0, 1])
    with pytest.raises(InputError, match="no dilutions"):
        sphere_case(visit, concentration=[1.0] * 6)
    with pytest.raises(InputError, match="above 0"):
        sphere_case(visit, dilutions=True, concentration=[0.0] * 6)
    spectral = replace(visit, wavelength_nm=np.linspace(400, 500, 6))
    with pytest.raises(InputError, match="several wavelengths"):
        sphere_case(spectral, dilutions=True)
    with pytest.raises(InputError, match="other wavelengths"):
        sphere_case([spectral, replace(visit, wavelength_nm=np.linspace(400, 501, 6))])


def test_published_intralipid_shares_an_absorption() -> None:
    path = FOLDER / "il_A.rxt"
    if not path.exists():
        pytest.skip("the published sphere measurements are not beside the repository")
    said: list[str] = []
    found = diagnose_spheres([path], settings=NO_LOSS, dilutions=True, say=said.append)
    assert found.effects[0].name == "diluent_absorption"
    assert found.p < 0.02
    assert any(text.startswith("noise:") for text in said)
