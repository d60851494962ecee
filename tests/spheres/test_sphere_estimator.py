"""The sphere estimator finds materials again, says when it cannot, and states honest errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from estimators.result import Status
from estimators.sphere import SphereEstimator, SphereSettings
from scenarios.spheres import (
    estimate_rxt,
    read_iad_result,
    spectrum_svg,
    summary,
    summary_text,
)
from tests.spheres.visits import empty_visit, text, visit_of
from twin.errors import InputError
from twin.measurement.rxt import parse_rxt
from twin.spheres import SphereModel

ALBEDO = np.array([0.3, 0.8, 0.95, 0.99, 0.999, 0.6])
SIGMA_T = np.array([0.5, 1.0, 2.0, 4.0, 1.5, 3.0])
G = np.array([0.2, 0.7, 0.85, 0.9, 0.5, 0.0])
QUICK = {"log2_paths": 12}

CASES = {
    "none": ({"spheres": 0}, {}),
    "substitution": ({"spheres": 1, "slide": 1.0}, {}),
    "comparison": ({"spheres": 1}, {"method": "comparison", "incidence_deg": 8.0}),
    "two": ({"spheres": 2, "third": 0.0}, {}),
}


@pytest.mark.parametrize("case", CASES)
def test_three_readings_give_the_material_back(case: str) -> None:
    how, options = CASES[case]
    visit = visit_of(ALBEDO, SIGMA_T, G, model_options=options, **how)  # type: ignore[arg-type]
    estimate = SphereEstimator(SphereSettings(**options, **QUICK)).estimate(visit)  # type: ignore[arg-type]
    assert np.allclose(estimate.albedo, ALBEDO, atol=2e-5)
    assert np.allclose(estimate.sigma_t_per_mm, SIGMA_T, rtol=1e-5)
    assert np.allclose(estimate.g, G, atol=2e-4)
    assert np.nanmax(np.abs(estimate.residual)) < 1e-6
    assert not estimate.g_held.any()
    assert np.allclose(estimate.mu_s_prime_per_mm, ALBEDO * SIGMA_T * (1 - G), rtol=1e-3)


def test_two_readings_give_the_material_back_at_the_right_g_only() -> None:
    g = np.full(6, 0.8)
    visit = visit_of(ALBEDO, SIGMA_T, g, letters="rt")
    right = SphereEstimator(SphereSettings(g=0.8, **QUICK)).estimate(visit)
    assert np.allclose(right.albedo, ALBEDO, atol=1e-5)
    assert np.allclose(right.sigma_t_per_mm, SIGMA_T, rtol=1e-5)
    assert right.g_held.all()
    assert np.all(right.covariance[:, 2] == 0.0)
    wrong = SphereEstimator(SphereSettings(**QUICK)).estimate(visit)
    assert np.all(wrong.g == 0.0)
    assert not np.allclose(wrong.sigma_t_per_mm, SIGMA_T, rtol=0.2)
    # a wrong g shifts sigma_t by a multiple and mu_s' much less, the less the thicker
    off = wrong.mu_s_prime_per_mm / (ALBEDO * SIGMA_T * 0.2) - 1.0
    assert np.all(np.abs(off) < 0.5)
    assert abs(off[3]) < abs(off[4])


def test_wrong_spheres_and_ignored_losses_show() -> None:
    """A control: the round trip above can fail."""
    visit = visit_of(ALBEDO, SIGMA_T, G, slide=1.0)
    ignored = SphereEstimator(SphereSettings(lost_light=False)).estimate(visit)
    assert np.nanmax(np.abs(ignored.albedo - ALBEDO)) > 1e-3
    unseen = SphereEstimator(SphereSettings(method="comparison", **QUICK)).estimate(visit)
    assert np.nanmax(np.abs(unseen.albedo - ALBEDO)) > 1e-3


def test_slopes_of_the_model_are_differences() -> None:
    model = SphereModel.of(empty_visit(3, slide=1.0))
    table = model.loss_table(None, log2_paths=10)
    point = np.array([[0.95, 2.0, 0.72], [0.99, 6.0, 0.86], [0.4, 0.5, 0.1]])
    _, slopes = model.readings(*point.T, table)
    for k in range(3):
        step = 1e-5 * point[:, k]
        up, down = point.copy(), point.copy()
        up[:, k] += step
        down[:, k] -= step
        difference = model.readings(*up.T, table)[0] - model.readings(*down.T, table)[0]
        assert np.allclose(slopes[:, :, k], difference / (2 * step)[:, None], rtol=2e-4, atol=1e-7)


def test_energy_is_kept() -> None:
    model = SphereModel.of(empty_visit(5, spheres=0, slide=1.0))
    clear, _ = model.readings(np.ones(5), np.geomspace(0.1, 30.0, 5), np.full(5, 0.7), None)
    assert np.allclose(clear[:, 0] + clear[:, 1], 1.0, atol=1e-9)
    dark, _ = model.readings(np.full(5, 0.99), np.geomspace(0.1, 30.0, 5), np.full(5, 0.7), None)
    assert np.all(dark[:, 0] + dark[:, 1] < 0.999)
    assert np.all(dark[:, 2] <= dark[:, 1])


def test_pulls_are_normal_and_understated_noise_shows() -> None:
    count = 128
    rng = np.random.Generator(np.random.Philox(key=7))
    sigma = np.array([0.003, 0.003, 0.001])
    settings = {"relative_sigma": 0.0, "unscattered_relative_sigma": 0.0,
                "unscattered_absolute_sigma": 0.001, "lost_light": False}  # fmt: skip
    visit = visit_of(
        np.full(count, 0.95), np.full(count, 2.0), np.full(count, 0.7),
        noise=rng.standard_normal((count, 3)) * sigma, model_options={"lost_light": False},
    )  # fmt: skip
    truth = np.array([0.95, 2.0, 0.7])

    def mean_square_pull(absolute: float) -> np.ndarray:
        estimate = SphereEstimator(SphereSettings(absolute_sigma=absolute, **settings)).estimate(
            visit
        )  # type: ignore[arg-type]
        found = np.stack([estimate.albedo, estimate.sigma_t_per_mm, estimate.g], axis=1)
        return np.asarray(np.mean(((found - truth) / estimate.standard_error) ** 2, axis=0))

    # chi-square of 128 degrees of freedom over 128 has a standard deviation of 0.125
    assert np.all(np.abs(mean_square_pull(0.003) - 1.0) < 0.5)
    assert np.max(mean_square_pull(0.0015)) > 1.5


def test_what_cannot_be_known_is_said() -> None:
    only_r = SphereEstimator().estimate(parse_rxt(text(np.array([[0.3], [0.4]]), "r")))
    assert np.all(only_r.status == Status.NOT_IDENTIFIABLE)
    assert np.isnan(only_r.albedo).all()
    assert any("Only M_R" in message for message in only_r.messages)
    rows = np.array([[0.7, 0.6, 0.1], [0.1, 0.2, 0.5], [1.2, 0.3, np.nan], [0.3, 0.3, 0.05]])
    mixed = SphereEstimator(SphereSettings(**QUICK)).estimate(parse_rxt(text(rows)))
    assert mixed.status[:3].tolist() == [Status.CONTRADICTORY, Status.CONTRADICTORY, Status.MASKED]
    assert np.isnan(mixed.sigma_t_per_mm[:3]).all()
    assert np.isfinite(mixed.sigma_t_per_mm[3])
    assert any("above 1, masked" in message for message in mixed.messages)
    json.dumps(summary(mixed), allow_nan=False)
    # R far too low for the T: no material
    dim = parse_rxt(text(np.array([[0.01, 0.3]]), "rt", spheres=0))
    assert SphereEstimator().estimate(dim).status[0] == Status.INCONSISTENT


def test_without_scattering_g_is_open() -> None:
    visit = visit_of(np.full(2, 0.01), np.array([0.5, 1.0]), np.full(2, 0.5), spheres=0)
    estimate = SphereEstimator().estimate(visit)
    assert np.all(estimate.status == Status.NOT_IDENTIFIABLE)
    assert not estimate.identifiable[:, 2].any()
    assert estimate.identifiable[:, 1].all()
    assert np.allclose(estimate.mu_a_per_mm, 0.99 * np.array([0.5, 1.0]), rtol=1e-3)


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"g": 1.0}, "g"),
        ({"absolute_sigma": 0.0}, "absolute_sigma"),
        ({"relative_sigma": 1.0}, "relative_sigma"),
        ({"log2_paths": 2}, "log2_paths"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float], place: str) -> None:
    with pytest.raises(InputError) as caught:
        SphereSettings(**settings)  # type: ignore[arg-type]
    assert caught.value.place == place


# mu_a and mu_s' [1/mm] that iad 3.16.2 found (docs/phantom_with_no_slides.txt of
# scottprahl/iad, MIT licence; measurement by A. Bahl, King's College London)
AUTHOR = {1500.0: (0.0416, 0.5799), 1180.0: (0.1211, 1.0317), 1000.0: (0.0190, 1.3982),
          700.0: (0.0183, 2.4302), 400.0: (0.1386, 3.3717)}  # fmt: skip


def test_the_silicone_phantom_is_its_authors(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "translucent" / "iad_rxt"
    settings = SphereSettings(method="comparison", incidence_deg=8.0, log2_paths=13)
    author = read_iad_result(folder / "phantom_with_no_slides.result.txt")
    found = estimate_rxt(
        # The example of docs/spheres.md.
        folder / "phantom_with_no_slides.rxt", g=0.9, settings=settings, out=tmp_path,
        reference=author,
    )  # fmt: skip
    for wavelength, (mu_a, mu_s) in AUTHOR.items():
        row = int(np.flatnonzero(found.wavelength_nm == wavelength)[0])
        assert author.mu_a_per_mm[row] == pytest.approx(mu_a)
        assert found.mu_a_per_mm[row] == pytest.approx(mu_a, rel=0.03)
        assert found.mu_s_prime_per_mm[row] == pytest.approx(mu_s, rel=0.02)
    difference = np.abs(found.mu_a_per_mm / author.mu_a_per_mm - 1.0)
    assert np.median(difference) < 0.02
    without = estimate_rxt(
        folder / "phantom_with_no_slides.rxt", g=0.9,
        settings=SphereSettings(method="comparison", incidence_deg=8.0, lost_light=False),
    )  # fmt: skip
    assert np.median(np.abs(without.mu_a_per_mm / author.mu_a_per_mm - 1.0)) > 0.04
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"phantom_with_no_slides.{kind}" for kind in ("csv", "json", "svg")]
    table = (tmp_path / names[0]).read_text().splitlines()
    assert len(table) == 112
    assert table[0].startswith("wavelength_nm,mu_a_per_mm,")
    assert spectrum_svg(found, author) == (tmp_path / names[2]).read_bytes()
    assert "iad -X -i 8 -g 0.9" in summary_text(found)
