from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from twin.errors import InputError
from twin.instrument import (
    Contribution,
    MultispectralChip,
    Spectrometer,
    count_variance,
    counts_of_electrons,
    electrons_of_counts,
    expected_electrons,
    fixed_pattern,
    saturation_counts,
    simulate_counts,
)

PIXELS = tuple(float(nm) for nm in range(400, 416))
RATES = np.linspace(0.0, 1.2e6, len(PIXELS))
NOISY = Spectrometer(pixels_nm=PIXELS, averages=1)
EVERYTHING: tuple[Contribution, ...] = get_args(Contribution)


def shots(instrument: Spectrometer | MultispectralChip, count: int, seed: int = 7) -> np.ndarray:
    return np.stack(
        [simulate_counts(instrument, RATES, 1.0, seed=seed, shot=k).counts for k in range(count)]
    )


def test_mean_of_the_counts_is_the_closed_form() -> None:
    counts = shots(NOISY, 2000)
    charge = expected_electrons(NOISY, RATES, 1.0)
    # The curve bends, so the mean over a Poisson charge has the variance of the charge in it.
    bend = NOISY.nonlinearity * charge / NOISY.full_well_electrons / NOISY.electrons_per_count
    expected = counts_of_electrons(NOISY, charge) + bend
    z = (counts.mean(axis=0) - expected) / (counts.std(axis=0, ddof=1) / np.sqrt(len(counts)))
    assert stats.chi2.sf(np.sum(z**2), z.size) > 1e-4
    wrong = (counts.mean(axis=0) - 1.002 * expected) / (counts.std(axis=0) / np.sqrt(len(counts)))
    assert stats.chi2.sf(np.sum(wrong**2), z.size) < 1e-12


@pytest.mark.parametrize("averages", [1, 7])
def test_variance_of_the_counts_is_the_closed_form(averages: int) -> None:
    instrument = NOISY.model_copy(update={"averages": averages})
    counts = shots(instrument, 2000)
    dark_counts = counts_of_electrons(instrument, instrument.dark_current_electrons_per_s)
    expected = count_variance(
        instrument,
        counts_of_electrons(instrument, expected_electrons(instrument, RATES, 1.0)),
        dark_counts,
    )

    def p_value(variance: np.ndarray) -> float:
        chi2 = np.sum((counts - counts.mean(axis=0)) ** 2 / variance)
        freedom = (len(counts) - 1) * counts.shape[1]
        return float(2 * min(stats.chi2.cdf(chi2, freedom), stats.chi2.sf(chi2, freedom)))

    assert p_value(expected) > 1e-4
    assert p_value(1.06 * expected) < 1e-6
    assert p_value(0.94 * expected) < 1e-6


def test_rounding_adds_a_twelfth_to_the_variance() -> None:
    quiet = Spectrometer(
        pixels_nm=PIXELS, averages=1, read_noise_electrons=13.2, off=("dark_current",)
    )
    counts = np.stack(
        [simulate_counts(quiet, 0 * RATES, 1.0, seed=4, shot=k).counts for k in range(2000)]
    )
    level = quiet.dark_level_counts
    freedom = counts.size - 1
    expected = float(count_variance(quiet, level, level))
    error = np.sqrt(2 / freedom)
    assert expected == pytest.approx(0.36 + 1 / 12)
    assert abs(counts.var(ddof=1) / expected - 1) < 5 * error
    assert abs(counts.var(ddof=1) / 0.36 - 1) > 10 * error


def test_counts_of_few_photons_are_poisson_distributed() -> None:
    instrument = Spectrometer(
        pixels_nm=PIXELS,
        averages=1,
        electrons_per_count=1.0,
        dark_level_counts=0.0,
        photo_response_nonuniformity=0.0,
        off=("read_noise", "dark_current", "nonlinearity", "stray_light"),
    )
    rate = np.full(len(PIXELS), 9.0)
    counts = np.concatenate(
        [simulate_counts(instrument, rate, 1.0, seed=3, shot=k).counts for k in range(1500)]
    )
    edges = np.arange(2, 19)
    observed = np.array(
        [np.sum(counts <= 1), *(np.sum(counts == e) for e in edges), np.sum(counts > 18)]
    )

    def p_value(cumulative: np.ndarray) -> float:
        share = np.diff(np.concatenate([[0.0], cumulative, [1.0]]))
        return float(stats.chisquare(observed, share * counts.size).pvalue)

    limits = np.arange(1, 19)
    assert p_value(stats.poisson.cdf(limits, 9.0)) > 1e-4
    assert p_value(stats.norm.cdf(limits + 0.5, 9.0, 3.0)) < 1e-6


def test_frames_of_one_shot_and_pixels_are_independent() -> None:
    counts = shots(NOISY, 3000)
    correlation = np.corrcoef(counts.T)[np.triu_indices(len(PIXELS), 1)]
    assert np.abs(correlation).max() < 5 / np.sqrt(len(counts))
    following = np.corrcoef(counts[:-1].T, counts[1:].T)[: len(PIXELS), len(PIXELS) :]
    assert np.abs(following).max() < 5 / np.sqrt(len(counts))


@pytest.mark.parametrize(
    ("name", "neutral"),
    [
        ("stray_light", {"stray_light_fraction": 0.0}),
        ("nonuniformity", {"photo_response_nonuniformity": 0.0}),
        ("nonlinearity", {"nonlinearity": 0.0}),
        ("dark_current", {"dark_current_electrons_per_s": 0.0}),
        ("read_noise", {"read_noise_electrons": 0.0}),
        ("averages", {"averages": 1}),
    ],
)
def test_off_by_name_is_exactly_the_neutral_value(
    name: Contribution, neutral: dict[str, float]
) -> None:
    full = Spectrometer(pixels_nm=PIXELS, averages=3)
    off = full.model_copy(update={"off": (name,)})
    none = full.model_copy(update=neutral)
    np.testing.assert_array_equal(shots(off, 3), shots(none, 3))
    assert np.any(shots(off, 3) != shots(full, 3))


def test_everything_off_leaves_the_bare_conversion() -> None:
    ideal = Spectrometer(pixels_nm=PIXELS, off=EVERYTHING)
    expected = ideal.dark_level_counts + RATES * 0.25 / ideal.electrons_per_count
    result = simulate_counts(ideal, RATES, 0.25, seed=1, shot=1)
    np.testing.assert_array_equal(result.counts, expected)
    assert not result.saturated.any()
    assert not result.floored.any()


def test_shot_noise_and_quantisation_off_leave_whole_or_exact_counts() -> None:
    rounding = Spectrometer(
        pixels_nm=PIXELS, off=tuple(name for name in EVERYTHING if name != "quantisation")
    )
    exact = Spectrometer(pixels_nm=PIXELS, off=EVERYTHING)
    rounded = simulate_counts(rounding, RATES, 0.3, seed=1, shot=1).counts
    np.testing.assert_array_equal(rounded, np.rint(rounded))
    difference = rounded - simulate_counts(exact, RATES, 0.3, seed=1, shot=1).counts
    assert 0 < np.abs(difference).max() <= 0.5


def test_saturation_off_reads_beyond_full_scale_and_flags_nothing() -> None:
    bright = np.full(len(PIXELS), 1e7)
    limited = simulate_counts(NOISY, bright, 1.0, seed=1, shot=1)
    assert limited.saturated.all()
    assert limited.counts.max() <= NOISY.full_scale_counts
    free = NOISY.model_copy(update={"off": ("saturation",)})
    unlimited = simulate_counts(free, bright, 1.0, seed=1, shot=1)
    assert unlimited.counts.min() > NOISY.full_scale_counts
    assert not unlimited.saturated.any()


def test_switching_one_contribution_off_keeps_the_others_random_numbers() -> None:
    linear = Spectrometer(pixels_nm=PIXELS, averages=2, off=("nonlinearity", "quantisation"))
    quiet = linear.model_copy(update={"off": (*linear.off, "shot_noise")})
    silent = linear.model_copy(update={"off": (*quiet.off, "read_noise")})
    unread = linear.model_copy(update={"off": (*linear.off, "read_noise")})
    reading = shots(quiet, 2) - shots(silent, 2)
    np.testing.assert_allclose(shots(linear, 2) - shots(unread, 2), reading, atol=1e-8)


def test_one_saturated_frame_flags_the_shot() -> None:
    # At 99.7 % of full scale about one frame in a hundred saturates: means stay below full scale.
    instrument = Spectrometer(pixels_nm=PIXELS, averages=200, dark_current_electrons_per_s=0.0,
                              off=("nonlinearity", "nonuniformity", "stray_light"))  # fmt: skip
    charge = float(electrons_of_counts(instrument, 0.9975 * instrument.full_scale_counts))
    result = simulate_counts(instrument, np.full(len(PIXELS), charge), 1.0, seed=2, shot=0)
    assert result.counts.max() < instrument.full_scale_counts
    assert result.saturated.any()


def test_full_well_below_full_scale_saturates_too() -> None:
    small = Spectrometer(pixels_nm=PIXELS, full_well_electrons=2e5)
    result = simulate_counts(small, np.full(len(PIXELS), 4e5), 1.0, seed=1, shot=0)
    assert result.saturated.all()
    assert saturation_counts(small) < small.full_scale_counts
    np.testing.assert_allclose(result.counts, saturation_counts(small), atol=3.0)


def test_readings_below_zero_are_flagged() -> None:
    chip = MultispectralChip(dark_level_counts=0.0, gain=512.0, dark_current_electrons_per_s=0.0)
    dark = simulate_counts(chip, np.zeros(8), chip.integration_s, seed=1, shot=0)
    assert dark.floored.any()
    assert dark.counts.min() >= 0
    lit = MultispectralChip(dark_level_counts=500.0, gain=512.0)
    assert not simulate_counts(lit, np.zeros(8), lit.integration_s, seed=1, shot=0).floored.any()


@settings(deadline=None, derandomize=True, max_examples=50)
@given(
    level=st.floats(0.0, 1e8),
    read=st.floats(0.0, 500.0),
    averages=st.integers(1, 80),
    bits=st.integers(12, 18),
    curve=st.floats(-0.3, 0.3),
    seed=st.integers(0, 2**64 - 1),
)
def test_counts_stay_in_range_and_saturation_is_flagged(
    level: float, read: float, averages: int, bits: int, curve: float, seed: int
) -> None:
    instrument = Spectrometer(
        pixels_nm=PIXELS, read_noise_electrons=read, averages=averages, adc_bits=bits,
        nonlinearity=curve, dark_level_counts=100.0,
    )  # fmt: skip
    result = simulate_counts(instrument, np.full(len(PIXELS), level), 1.0, seed=seed, shot=0)
    assert np.all((result.counts >= 0) & (result.counts <= instrument.full_scale_counts))
    reading = counts_of_electrons(instrument, expected_electrons(
        instrument, np.full(len(PIXELS), level), 1.0))  # fmt: skip
    sigma = np.sqrt(count_variance(instrument, np.minimum(reading, 1e5), 100.0, averages=1))
    top = saturation_counts(instrument)
    over = expected_electrons(instrument, np.full(len(PIXELS), level), 1.0)
    if over.min() > 2 * instrument.full_well_electrons:
        assert result.saturated.all()
    if np.all(reading + 8 * sigma < top) and over.max() * 1.1 < instrument.full_well_electrons:
        assert not result.saturated.any()
    assert result.saturated[result.counts == instrument.full_scale_counts].all()


@settings(deadline=None, derandomize=True, max_examples=30)
@given(dark=st.floats(50.0, 3000.0), current=st.floats(0.0, 1e4), seed=st.integers(0, 2**32))
def test_no_light_gives_the_dark_level(dark: float, current: float, seed: int) -> None:
    instrument = Spectrometer(
        pixels_nm=PIXELS, dark_level_counts=dark, dark_current_electrons_per_s=current
    )
    result = simulate_counts(instrument, np.zeros(len(PIXELS)), 2.0, seed=seed, shot=0)
    level = counts_of_electrons(instrument, 2.0 * current)
    sigma = np.sqrt(count_variance(instrument, level, level))
    assert np.abs(result.counts - level).max() < 6 * sigma


def test_more_averages_reduce_the_variance_in_proportion() -> None:
    few, many = shots(NOISY, 400), shots(NOISY.model_copy(update={"averages": 16}), 400)
    ratio = few.var(axis=0, ddof=1).sum() / many.var(axis=0, ddof=1).sum()
    freedom = 399 * 6  # The brightest pixels dominate the sum; six of sixteen is a low estimate.
    assert abs(ratio / 16 - 1) < 5 * np.sqrt(4 / freedom)


def test_same_seed_same_counts_in_any_order_and_thread() -> None:
    def one(shot: int) -> np.ndarray:
        return simulate_counts(NOISY, RATES, 0.5, seed=11, shot=shot).counts

    ordered = [one(shot) for shot in range(24)]
    order = np.random.Generator(np.random.Philox(key=1)).permutation(24)
    with ThreadPoolExecutor(4) as pool:
        scattered = dict(zip(order.tolist(), pool.map(one, order.tolist()), strict=True))
    for shot in range(24):
        np.testing.assert_array_equal(ordered[shot], scattered[shot])
    assert not np.array_equal(ordered[0], ordered[1])
    other = simulate_counts(NOISY, RATES, 0.5, seed=12, shot=0).counts
    assert not np.array_equal(ordered[0], other)


def test_the_frames_of_a_shot_do_not_depend_on_the_chunk() -> None:
    instrument = Spectrometer(pixels_nm=PIXELS, averages=150)
    single = Spectrometer(pixels_nm=PIXELS, averages=1)
    assert simulate_counts(instrument, RATES, 0.5, seed=1, shot=0).frames == 150
    mean = simulate_counts(instrument, RATES, 0.5, seed=1, shot=0).counts
    sigma = np.sqrt(count_variance(single, mean, single.dark_level_counts) / 150)
    expected = counts_of_electrons(single, expected_electrons(single, RATES, 0.5))
    assert np.abs((mean - expected) / sigma).max() < 5


def test_the_fixed_pattern_belongs_to_the_serial_number() -> None:
    wide = Spectrometer(step_nm=0.1, photo_response_nonuniformity=0.05)
    pattern = fixed_pattern(wide)
    assert pattern.min() > 0
    assert pattern.mean() == pytest.approx(1.0, abs=5 * 0.05 / np.sqrt(pattern.size))
    assert pattern.std() == pytest.approx(0.05, rel=5 / np.sqrt(2 * pattern.size))
    np.testing.assert_array_equal(pattern, fixed_pattern(wide))
    other = wide.model_copy(update={"serial": 2})
    assert np.abs(np.corrcoef(pattern, fixed_pattern(other))[0, 1]) < 5 / np.sqrt(pattern.size)


def test_stray_light_is_spread_evenly_and_keeps_the_sum() -> None:
    instrument = Spectrometer(
        pixels_nm=PIXELS, stray_light_fraction=0.1, off=("nonuniformity", "dark_current")
    )
    charge = expected_electrons(instrument, RATES, 1.0)
    np.testing.assert_allclose(charge, 0.9 * RATES + 0.1 * RATES.mean(), rtol=1e-12)
    assert charge.sum() == pytest.approx(RATES.sum())


@settings(deadline=None, derandomize=True, max_examples=50)
@given(curve=st.floats(-0.49, 0.49), share=st.floats(0.0, 1.0))
def test_charge_and_counts_are_inverse(curve: float, share: float) -> None:
    instrument = Spectrometer(nonlinearity=curve)
    charge = share * instrument.full_well_electrons
    back = electrons_of_counts(instrument, counts_of_electrons(instrument, charge))
    assert float(back) == pytest.approx(charge, rel=1e-9, abs=1e-6)


def test_nonlinearity_is_the_relative_deviation_at_full_well() -> None:
    bent, straight = Spectrometer(nonlinearity=-0.03), Spectrometer(off=("nonlinearity",))
    for share in (0.25, 1.0):
        charge = share * bent.full_well_electrons
        reading = counts_of_electrons(bent, charge) - bent.dark_level_counts
        linear = counts_of_electrons(straight, charge) - bent.dark_level_counts
        assert float(reading / linear) == pytest.approx(1 - 0.03 * share)
    assert np.isnan(electrons_of_counts(Spectrometer(nonlinearity=-0.49), 1e6))


@pytest.mark.parametrize(
    ("rate", "time", "shot", "said"),
    [
        (RATES[:-1], 1.0, 0, "16 pixels"),
        (-RATES, 1.0, 0, "at least 0"),
        (RATES * np.nan, 1.0, 0, "finite"),
        (RATES, 0.001, 0, "0.008 to 60 s"),
        (RATES, np.nan, 0, "integration_s"),
        (RATES * 1e12, 1.0, 0, "2\\*\\*53"),
        (RATES, 1.0, -1, "shot number"),
    ],
)
def test_unfit_input_is_refused(rate: np.ndarray, time: float, shot: int, said: str) -> None:
    with pytest.raises(InputError, match=said):
        simulate_counts(NOISY, rate, time, seed=1, shot=shot)
