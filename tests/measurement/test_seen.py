"""The truth as an instrument sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.measurement.visits import visit
from twin.instrument import Spectrometer
from twin.measurement import Measurement, Truth
from twin.measurement.seen import seen_truth
from twin.spectra import Spectral, SpectralTable

FINE = np.arange(400.0, 701.0, 1.0)


def measured(off: tuple[str, ...] = (), lamp: Spectral = 1.0) -> Measurement:
    plain = visit()
    pixels = tuple(float(each) for each in plain.wavelength_nm)
    instrument = Spectrometer(pixels_nm=pixels, bandwidth_nm=20.0, off=off)
    peak = np.exp(-(((FINE - pixels[1]) / 15.0) ** 2))
    count = len(plain.samples)
    truth = Truth(
        FINE,
        *(np.tile(row, (count, 1)) for row in (0.5 + 0 * FINE, 1.0 + peak, 0.1 + 0.001 * FINE)),
    )
    beam = plain.bench.beam.model_copy(update={"spectrum": lamp})
    bench = plain.bench.model_copy(
        update={"instrument": instrument, "beam": beam, "panel_spectrum": lamp}
    )
    return replace(plain, bench=bench, truth=truth)


def test_a_peak_is_lower_and_a_line_the_same() -> None:
    found = seen_truth(measured())
    assert found is not None
    # A Gaussian of variance a under a band of variance b falls by sqrt(a / (a + b)).
    a, b = 15.0**2 / 2.0, 20.0**2 / (8.0 * np.log(2.0))
    np.testing.assert_allclose(found.sigma_t_per_mm[:, 1], 1.0 + np.sqrt(a / (a + b)), rtol=1e-4)
    np.testing.assert_allclose(found.albedo, 0.5, rtol=1e-12)
    np.testing.assert_allclose(found.g[:, 1], 0.1 + 0.001 * found.wavelength_nm[1], rtol=1e-6)


def test_on_the_flank_of_a_lamp_a_band_is_seen_beside_its_centre() -> None:
    """Light that grows as exp(k wavelength) moves a Gaussian band of variance b by k b."""
    rise = 0.01
    table = SpectralTable(wavelength_nm=tuple(FINE), value=tuple(np.exp(rise * (FINE - 700.0))))
    found = seen_truth(measured(lamp=table))
    assert found is not None
    moved = rise * 20.0**2 / (8.0 * np.log(2.0))
    centre = found.wavelength_nm[1]
    np.testing.assert_allclose(found.g[:, 1], 0.1 + 0.001 * (centre + moved), rtol=1e-4)
    assert moved > 0.7


def test_without_bandwidth_it_is_the_centres() -> None:
    found = seen_truth(measured(("bandwidth",)))
    assert found is not None
    np.testing.assert_allclose(found.sigma_t_per_mm[:, 1], 2.0, rtol=1e-12)


def test_a_truth_that_ends_inside_a_band_serves_at_the_centre() -> None:
    full = measured()
    assert full.truth is not None
    part = Truth(
        FINE[::30], full.truth.albedo[:, ::30], full.truth.sigma_t_per_mm[:, ::30],
        full.truth.g[:, ::30],
    )  # fmt: skip
    found = seen_truth(replace(full, truth=part))
    assert found is not None
    expected = np.interp(full.wavelength_nm, FINE[::30], part.sigma_t_per_mm[0])
    np.testing.assert_allclose(found.sigma_t_per_mm[0], expected)


def test_a_real_visit_has_none() -> None:
    assert seen_truth(replace(measured(), truth=None)) is None
