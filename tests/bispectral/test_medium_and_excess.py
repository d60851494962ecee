"""Units of fluorescent media, and what fluorescence adds to the white-lit captures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bispectral.world import WAVELENGTH, medium, open_bench, sample
from twin.bispectral import (
    FluorescentProperties,
    bin_widths,
    emission_table,
    fluorescence_excess,
    photon_density,
)
from twin.errors import InputError
from twin.spectra import FloatArray

BENCH = open_bench()


def excess(own: FluorescentProperties, lamp: FloatArray, **more: object) -> FloatArray:
    excitation = own.fluorophore_per_mm / own.fluorophore_per_mm.max()
    emission = np.interp(WAVELENGTH, (480.0, 520.0, 600.0), (0.0, 1.0, 0.0))
    given_medium = {"strength": 0.1, **more}
    return fluorescence_excess(
        BENCH, [sample()], own.optical(), WAVELENGTH, lamp, excitation, emission,
        **given_medium,  # type: ignore[arg-type]
    )  # fmt: skip


@given(
    st.lists(st.floats(0.0, 1e3), min_size=10, max_size=10).filter(lambda v: sum(v) > 1e-3),
    st.floats(1e-3, 1e3),
)
def test_emission_is_normalised_in_photons_whatever_its_unit(
    values: list[float], scale: float
) -> None:
    shape = np.array(values)
    photons = photon_density(WAVELENGTH, shape)
    assert bin_widths(WAVELENGTH) @ photons == pytest.approx(1.0)
    assert np.allclose(photon_density(WAVELENGTH, scale * shape), photons)
    assert np.allclose(photon_density(WAVELENGTH, shape / WAVELENGTH, "energy"), photons)


def test_a_photon_loses_energy_and_never_gains_any() -> None:
    own = medium(quantum_yield=1.0)
    lit = own.fluorophore_per_mm > 0.0
    assert np.all(own.energy_yield[lit] < 1.0)
    assert np.all(own.source[np.triu_indices(len(WAVELENGTH))] == 0.0)
    table = emission_table(WAVELENGTH, np.full(len(WAVELENGTH), 0.01))
    assert table[5, 1] == pytest.approx(0.01 * WAVELENGTH[1] / WAVELENGTH[5])


def test_half_the_quantum_yield_emits_half_and_absorbs_the_same() -> None:
    whole, half = medium(quantum_yield=0.8), medium(quantum_yield=0.4)
    assert np.allclose(half.source, 0.5 * whole.source)
    assert np.array_equal(half.sigma_t_per_mm, whole.sigma_t_per_mm)


def test_the_excess_is_the_sum_over_the_lamp_of_the_bispectral_factors() -> None:
    from twin.bispectral import donaldson

    own = medium(quantum_yield=1.0)
    lamp = np.linspace(1.0, 3.0, len(WAVELENGTH))
    found = excess(own, lamp, strength=float(own.fluorophore_per_mm.max()))
    factors = donaldson(BENCH, [sample()], own).fluorescent
    expected = np.einsum("scoi,i->sco", factors, lamp * own.step_nm) / lamp
    # the world's emission is normalised over its own table, the excess over its wavelengths
    ratio = found[0, :2, 5] / expected[0, :2, 5]
    assert np.allclose(ratio, ratio[0])
    assert ratio[0] == pytest.approx(1.0, abs=0.02)
    assert np.all(found[:, :, 0] == 0.0)


def test_the_excess_is_linear_and_falls_with_self_absorption() -> None:
    own, lamp = medium(absorption=1e-6), np.ones(len(WAVELENGTH))
    once = excess(own, lamp)
    assert np.allclose(excess(own, lamp, strength=0.2), 2.0 * once)
    assert np.allclose(excess(own, 7.0 * lamp), once)
    dimmed = excess(own, lamp, self_absorption=True)
    assert np.all(dimmed[:, :2, 5] < 0.98 * once[:, :2, 5])


def test_white_gains_more_than_black_and_collimated_hardly() -> None:
    found = excess(medium(), np.ones(len(WAVELENGTH)))[0]
    assert found.shape == (3, len(WAVELENGTH))
    assert np.all(found[1, 4:-1] > found[0, 4:-1])
    assert 0.0 < found[2, 5] < 1e-3 * found[0, 5]


@pytest.mark.parametrize(
    ("lamp", "more"),
    [
        (np.zeros(len(WAVELENGTH)), {}),
        (np.ones(3), {}),
        (np.ones(len(WAVELENGTH)), {"strength": -1.0}),
    ],
)
def test_wrong_input_is_refused(lamp: FloatArray, more: dict[str, float]) -> None:
    with pytest.raises(InputError):
        excess(medium(), lamp, **more)


def test_wavelengths_that_do_not_increase_are_refused() -> None:
    with pytest.raises(InputError):
        bin_widths(np.array([500.0, 490.0]))
    with pytest.raises(InputError):
        photon_density(WAVELENGTH, np.zeros(len(WAVELENGTH)))
