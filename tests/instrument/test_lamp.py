from __future__ import annotations

import numpy as np
import pytest

from twin.errors import InputError
from twin.instrument import MultispectralChip, Spectrometer, lamp_covariance, lamp_drift

INSTRUMENT = Spectrometer(step_nm=100.0, lamp_flicker=0.004, lamp_walk=0.002, lamp_tilt_walk=0.003)
SEEDS = 4000


def ratios(first: int, second: int) -> np.ndarray:
    drift = np.stack([np.log(lamp_drift(INSTRUMENT, 9, seed=seed)) for seed in range(SEEDS)])
    return drift[:, second] - drift[:, first]


def test_drift_has_the_stated_covariance() -> None:
    difference = ratios(2, 8)
    expected = (
        lamp_covariance(INSTRUMENT, 8, 8)
        + lamp_covariance(INSTRUMENT, 2, 2)
        - 2 * lamp_covariance(INSTRUMENT, 2, 8)
    )
    measured = np.cov(difference.T)
    # Standard error of a covariance of normal variables (Wishart).
    diagonal = np.diag(expected)
    error = np.sqrt((np.outer(diagonal, diagonal) + expected**2) / (SEEDS - 1))
    assert np.abs((measured - expected) / error).max() < 5
    white = np.diag(diagonal)
    assert np.abs((measured - white) / error).max() > 20


def test_drift_is_common_to_the_wavelengths() -> None:
    level = INSTRUMENT.model_copy(update={"lamp_tilt_walk": 0.0})
    drift = lamp_drift(level, 20, seed=5)
    np.testing.assert_array_equal(drift, np.repeat(drift[:, :1], drift.shape[1], axis=1))
    tilted = lamp_drift(INSTRUMENT, 20, seed=5)
    np.testing.assert_allclose(tilted[1:, 0] * tilted[1:, 3], drift[1:, 0] * drift[1:, 3])
    assert np.ptp(tilted[-1]) > 0


def test_fewer_shots_are_the_beginning_of_more() -> None:
    np.testing.assert_array_equal(
        lamp_drift(INSTRUMENT, 30, seed=2)[:7], lamp_drift(INSTRUMENT, 7, seed=2)
    )
    assert lamp_drift(INSTRUMENT, 0, seed=2).shape == (0, 4)


def test_lamps_and_seeds_drift_apart() -> None:
    panels = lamp_drift(INSTRUMENT, 5, seed=1)
    assert np.all(panels[1:] != lamp_drift(INSTRUMENT, 5, seed=1, lamp=1)[1:])
    assert np.all(panels[1:] != lamp_drift(INSTRUMENT, 5, seed=2)[1:])


def test_off_by_name_is_exactly_one() -> None:
    off = INSTRUMENT.model_copy(update={"off": ("lamp_drift",)})
    none = INSTRUMENT.model_copy(
        update={"lamp_flicker": 0.0, "lamp_walk": 0.0, "lamp_tilt_walk": 0.0}
    )
    assert np.all(lamp_drift(off, 6, seed=1) == 1.0)
    assert np.all(lamp_drift(none, 6, seed=1) == 1.0)
    assert np.all(lamp_covariance(off, 3, 3) == 0.0)
    assert np.any(lamp_drift(INSTRUMENT, 6, seed=1) != 1.0)


def test_a_single_pixel_has_no_tilt() -> None:
    chip = MultispectralChip.model_validate(
        {"channels": ({"name": "only", "centre_nm": 500.0, "fwhm_nm": 30.0},)}
    )
    steady = chip.model_copy(update={"lamp_walk": 0.0, "lamp_flicker": 0.0})
    assert np.all(lamp_drift(steady, 4, seed=1) == 1.0)


def test_wrong_requests_are_refused() -> None:
    with pytest.raises(InputError, match="shots"):
        lamp_drift(INSTRUMENT, -1, seed=1)
    with pytest.raises(InputError, match="seed"):
        lamp_drift(INSTRUMENT, 3, seed=-1)


def test_the_walk_starts_with_the_first_shot() -> None:
    walking = INSTRUMENT.model_copy(update={"lamp_flicker": 0.0})
    drift = lamp_drift(walking, 3, seed=1)
    assert np.all(drift[0] == 1.0)
    assert np.all(drift[1] != 1.0)
