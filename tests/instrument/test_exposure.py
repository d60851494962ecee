from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.errors import InputError
from twin.instrument import (
    MultispectralChip,
    Spectrometer,
    auto_exposure,
    count_variance,
    saturation_counts,
    simulate_counts,
)

PIXELS = tuple(float(nm) for nm in range(400, 408))
SPECTROMETER = Spectrometer(pixels_nm=PIXELS)
RATES = np.linspace(0.2, 1.0, len(PIXELS))


@settings(deadline=None, derandomize=True, max_examples=50)
@given(
    brightness=st.floats(4e4, 2e7),
    fraction=st.floats(0.2, 0.95),
    curve=st.floats(-0.2, 0.2),
    well=st.floats(3e5, 3e6),
)
def test_the_brightest_pixel_reaches_the_fraction(
    brightness: float, fraction: float, curve: float, well: float
) -> None:
    instrument = Spectrometer(pixels_nm=PIXELS, nonlinearity=curve, full_well_electrons=well)
    exposure = auto_exposure(instrument, brightness * RATES, fraction=fraction)
    assert instrument.shortest_s <= exposure.integration_s <= instrument.longest_s
    if exposure.limited == "no":
        assert exposure.fraction == pytest.approx(fraction, rel=1e-9)
    result = simulate_counts(instrument, brightness * RATES, exposure.integration_s, seed=1, shot=0)
    reached = result.counts.max() / saturation_counts(instrument)
    assert reached == pytest.approx(exposure.fraction, rel=0.01)
    assert not result.saturated.any()


def test_limits_are_said() -> None:
    dim = auto_exposure(SPECTROMETER, 1e3 * RATES)
    assert (dim.limited, dim.integration_s) == ("longest", SPECTROMETER.longest_s)
    assert dim.fraction < 0.8
    bright = auto_exposure(SPECTROMETER, 1.6e8 * RATES)
    assert (bright.limited, bright.integration_s) == ("shortest", SPECTROMETER.shortest_s)
    assert 0.8 < bright.fraction < 1


def test_the_chip_changes_its_gain() -> None:
    chip = MultispectralChip()
    rates = chip.white_rate_electrons_per_s * np.linspace(0.2, 1.0, 8)
    exposure = auto_exposure(chip, rates)
    found = exposure.instrument
    assert isinstance(found, MultispectralChip)
    assert (exposure.limited, exposure.integration_s) == ("no", chip.integration_s)
    assert 0.4 < exposure.fraction <= 0.8 * (1 + 1e-9)
    assert not simulate_counts(found, rates, chip.integration_s, seed=1, shot=0).saturated.any()
    dim = auto_exposure(chip, rates * 1e-6)
    assert dim.limited == "longest"
    assert isinstance(dim.instrument, MultispectralChip)
    assert dim.instrument.gain == 512


def test_too_much_light_is_refused() -> None:
    with pytest.raises(InputError, match="shortest integration time"):
        auto_exposure(SPECTROMETER, 1e10 * RATES)
    with pytest.raises(InputError, match="lowest gain"):
        auto_exposure(MultispectralChip(), np.full(8, 1e12))


def test_impossible_wishes_are_refused() -> None:
    with pytest.raises(InputError, match="without light"):
        auto_exposure(SPECTROMETER, 0 * RATES)
    with pytest.raises(InputError, match="fraction"):
        auto_exposure(SPECTROMETER, 1e6 * RATES, fraction=1.0)
    with pytest.raises(InputError, match="dark level"):
        auto_exposure(SPECTROMETER, 1e6 * RATES, fraction=0.03)


def test_variance_by_hand() -> None:
    instrument = Spectrometer(
        electrons_per_count=20.0, read_noise_electrons=40.0, dark_level_counts=100.0,
        off=("nonlinearity",),
    )  # fmt: skip
    # 1000 counts of signal and 50 of dark current are 21000 electrons.
    expected = (21000 / 20**2 + 4.0 + 1 / 12) / 4
    assert count_variance(instrument, 1150.0, 150.0, averages=4) == pytest.approx(expected)
    below = count_variance(instrument, 90.0, 95.0, averages=1)
    assert below == pytest.approx(4.0 + 1 / 12)
    silent = instrument.model_copy(
        update={"off": ("nonlinearity", "shot_noise", "read_noise", "quantisation")}
    )
    assert count_variance(silent, 1150.0, 150.0) == 0
    with pytest.raises(InputError, match="averages"):
        count_variance(instrument, 1150.0, 150.0, averages=0)
