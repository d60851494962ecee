"""What the page shows, without a browser: against the engine, closed forms and statistics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators import BenchModel
from estimators.forward import Forward
from scenarios.explore.contours import CONTOURS, TAU, height_of
from scenarios.explore.diagnosis import closure_sentence, read_diagnosis
from scenarios.explore.model import Explorer
from scenarios.explore.moves import move_cosine, move_scale, move_share
from scenarios.explore.noise import covariance_of, lamps, light_of
from scenarios.explore.sliders import SLIDERS, Settings
from scenarios.explore.source import GREY, source_of, thinned
from twin.errors import InputError


def test_the_captures_are_those_of_the_engine(explorer: Explorer) -> None:
    source, first = explorer.source, explorer.first()
    found = explorer.picture(first)
    forward = Forward.of(BenchModel.of(source.bench, source.samples, source.wavelength_nm))
    own = source.spectra[first.material]
    expected = forward.forward(forward.parameters(own.albedo, own.sigma_t_per_mm, own.g))
    np.testing.assert_allclose(found.captures, np.asarray(expected), rtol=1e-9, atol=1e-12)
    # and it can differ
    other = explorer.picture(replace(first, albedo=0.9))
    assert np.abs(other.captures - np.asarray(expected)).max() > 0.05


def test_the_point_lies_on_its_contours(explorer: Explorer) -> None:
    first = explorer.at(GREY, explorer.source.middle, 0)
    for albedo, tau in ((0.9, TAU[16]), (0.99, TAU[20]), (0.5, TAU[12])):
        settings = replace(first, albedo=albedo, sigma_t_per_mm=float(tau) / first.thickness_mm)
        line = explorer.plane(settings).of_albedo[CONTOURS.index(albedo)]
        node = line[list(TAU).index(tau)]
        np.testing.assert_allclose(explorer.picture(settings).point, node, atol=3e-5)


def test_contours_of_sigma_pass_through_the_point(explorer: Explorer) -> None:
    settings = replace(explorer.at(GREY, explorer.source.middle, 0), albedo=0.95, g=0.2)
    settings = replace(settings, sigma_t_per_mm=5.0)
    plane = explorer.plane(settings)
    line = plane.of_sigma[list(plane.sigma_t_per_mm).index(5.0)]
    nearest = np.abs(line - explorer.picture(settings).point).max(axis=1).min()
    assert nearest < 2e-4


def test_without_scattering_it_is_beer(explorer: Explorer) -> None:
    first = replace(explorer.at(GREY, 15, 0), albedo=0.0, g=0.0, rho_black=0.0)
    one, two = (
        explorer.picture(replace(first, sigma_t_per_mm=s)).captures[15, 0] for s in (5.0, 10.0)
    )
    # far from the faces' multiple reflections the ratio is Beer's
    assert one[2] / two[2] == pytest.approx(np.exp(5.0 * 0.4), rel=2e-3)
    assert abs(one[0]) < 1e-9


def test_opaque_is_what_a_thick_sample_tends_to(explorer: Explorer) -> None:
    settings = replace(explorer.at(GREY, 15, 0), sigma_t_per_mm=100.0, thickness_mm=10.0)
    found = explorer.picture(settings)
    black, white = found.captures[:, 0, :2].T
    np.testing.assert_allclose(black, white, rtol=1e-9)
    # a thick sample's top is nearer to the panels than its white reference was
    height = height_of(explorer.source.bench, 10.0)
    assert height > 1.02
    np.testing.assert_allclose(found.thick, black / height, rtol=1e-9)
    thin = explorer.picture(replace(settings, thickness_mm=0.05, sigma_t_per_mm=1.0))
    assert np.abs(thin.captures[:, 0, 0] - thin.thick).min() > 0.05


def test_noise_falls_with_averages_to_what_the_lamps_leave(explorer: Explorer) -> None:
    first = explorer.first()
    still = replace(first, drift=False)
    few, many = (explorer.picture(replace(still, averages=a)) for a in (10, 1000))
    black = 0
    engine = 1e-4 * few.captures[..., black]
    ratio = (few.sigma[..., black] ** 2 - engine**2) / (many.sigma[..., black] ** 2 - engine**2)
    # rounding is averaged like everything else
    np.testing.assert_allclose(ratio, 100.0, rtol=1e-6)
    moving = explorer.picture(replace(first, averages=1000))
    assert np.all(moving.sigma[15] > 2 * many.sigma[15])


def test_the_noise_is_that_of_simulated_visits(explorer: Explorer) -> None:
    """Relative intensities of simulated visits scatter as the page says."""
    from scenarios.scenario import load_scenario
    from scenarios.simulate import noisy_visits
    from twin.measurement import relative_intensities
    from twin.transport import NoiselessCaptures

    scenario = load_scenario("default")
    wide = scenario.wavelength.wavelength_nm
    rho = [np.full(wide.size, value) for value in (0.02, 0.99)]
    light = [np.full(wide.size, value) for value in (0.1, 0.5, 0.2)]
    zero = [np.zeros(wide.size)] * 3
    noiseless = [NoiselessCaptures(wide, *light, *zero, *rho, 1.0) for _ in scenario.samples]
    visits = noisy_visits(scenario, noiseless, range(60))
    seen = np.array([relative_intensities(visit).value for visit in visits])  # (V, S, 3, P)
    at = np.searchsorted(scenario.bench.instrument.wavelength_nm, explorer.source.wavelength_nm)
    spread = seen[:, :, :, at].std(axis=0, ddof=1)
    captures = np.broadcast_to([0.1, 0.5, 0.2], (31, 2, 3))
    covariance = covariance_of(captures, light_of(explorer.source), explorer.source, 10)
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    ratio = np.sqrt(np.mean((spread / np.moveaxis(sigma, 0, -1)) ** 2, axis=(0, 2)))
    # 60 visits of two samples, whose lamps are common to all wavelengths: 6.5 % standard error
    np.testing.assert_allclose(ratio, 1.0, atol=0.25)
    # a control: without the lamps' drift the page would be wrong by far
    still = covariance_of(captures, light_of(explorer.source), explorer.source, 10, drift=False)
    wrong = np.sqrt(np.diagonal(still, axis1=-2, axis2=-1))
    assert np.mean((spread / np.moveaxis(wrong, 0, -1)) ** 2) > 1.5**2


def test_lamps_cancel_against_their_references(explorer: Explorer) -> None:
    found = lamps(explorer.source, explorer.source.bench.instrument)
    assert np.all(np.diag(found) > 0)
    assert found[0, 1] > 0  # one lamp, one reference
    assert found[0, 2] == 0


def test_what_is_not_identifiable_is_said(explorer: Explorer) -> None:
    first = explorer.at(GREY, 15, 0)
    thick = replace(first, sigma_t_per_mm=100.0, thickness_mm=10.0)
    found = explorer.picture(thick).uncertainty
    assert not found.determined[15].all()
    assert "drowns" in " ".join(found.sentences(15))
    good = explorer.picture(first).uncertainty
    assert good.sentences(15) == ("The captures determine all three.",)
    clear = explorer.picture(replace(first, albedo=0.0)).uncertainty
    assert not clear.determined[15, 2]


def test_more_samples_tell_more(explorer: Explorer) -> None:
    first = explorer.first()
    both, one = (
        explorer.picture(replace(first, all_samples=every)).uncertainty for every in (True, False)
    )
    assert np.all(both.standard_error < one.standard_error)


@given(
    base=st.lists(st.floats(0.001, 0.999), min_size=3, max_size=8),
    value=st.floats(0.001, 0.999),
)
def test_moved_spectra_keep_their_ranges(base: list[float], value: float) -> None:
    spectrum = np.array(base)
    for move in (move_share, move_scale, move_cosine):
        moved = move(spectrum, 1, value)
        assert moved[1] == pytest.approx(value, rel=1e-9)
        # moving it back gives the spectrum again
        np.testing.assert_allclose(move(moved, 1, float(spectrum[1])), spectrum, rtol=1e-6)
    assert np.all(np.abs(move_cosine(spectrum, 1, value)) < 1)


@pytest.mark.parametrize("slider", SLIDERS, ids=lambda slider: slider.name)
def test_positions_and_values_belong_together(slider) -> None:
    for share in (0.0, 0.3, 1.0):
        value = slider.low + share * (slider.high - slider.low)
        assert slider.value(slider.position(value)) == pytest.approx(value, rel=1e-9, abs=1e-12)


def test_what_a_page_may_not_send_is_refused(explorer: Explorer) -> None:
    first = explorer.first()
    asked = first.positions() | {"material": first.material, "wavelength": 15, "sample": 0}
    again = Settings.of(asked)
    assert again.sigma_t_per_mm == pytest.approx(first.sigma_t_per_mm)
    for wrong in ({"g": 7.0}, {"g": float("nan")}, {"n": "1"}, {"albedo": None}):
        with pytest.raises(InputError):
            Settings.of(asked | wrong)
    for wrong in ({"wavelength": 99}, {"sample": -1}, {"material": "gold"}):
        with pytest.raises(InputError):
            explorer.picture(Settings.of(asked | wrong))


def test_a_measurement_made_by_hand_is_explored() -> None:
    source = source_of("docs/examples/hand_made_relative")
    assert source.measured is not None
    picture = Explorer(source).picture(Explorer(source).first())
    assert picture.captures.shape == (16, 2, 3)
    assert picture.swatches is not None
    with pytest.raises(InputError, match="--result"):
        source_of("default", result=Path("r.nc"))


def test_no_more_wavelengths_than_a_picture_has() -> None:
    assert thinned(np.arange(400.0, 701.0, 2.0)).size == 31
    assert thinned(np.arange(5.0)).size == 5


def test_what_no_slider_can_show_is_said(tmp_path: Path) -> None:
    file = tmp_path / "cuvette.toml"
    sample = "[[samples]]\nname = '{0}'\nthickness_mm = {0}\nmaterial = 'demo_ink'\n"
    file.write_text(
        "title = 'Wide'\n" + "".join(sample.format(mm) for mm in (10.0, 25.0))
        + "[bench.background]\nwhite = { reflectance = 1.0 }\n"
    )  # fmt: skip
    said = " ".join(source_of(str(file)).notes)
    assert "Thickness is described as 10 to 25, its slider goes from 0.05 to 20" in said
    assert "White background is described as 1 to 1" in said
    assert not any("is described as" in note for note in source_of(None).notes)


def test_a_closure_lies_inside_its_interval() -> None:
    """More than the gap may close on held-out data: neither number is cut off."""
    said = closure_sentence(
        {"value": 1.02, "interval": [0.92, 1.14], "before": 60.0, "after": -1.2}
    )
    assert "102 % of the gap closes (90 % interval 92 to 114 %)" in said


def test_a_file_that_is_no_diagnosis_is_refused(tmp_path) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text('{"verdict": "nothing"}')
    with pytest.raises(InputError, match="no diagnosis"):
        read_diagnosis(tmp_path)
