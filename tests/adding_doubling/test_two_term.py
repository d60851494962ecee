"""A phase function of two lobes: both engines agree, and the mean cosine is not enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from twin.adding_doubling import captures, captures_model
from twin.bench import Bench, Medium, Sample
from twin.errors import InputError
from twin.materials import OpticalProperties
from twin.transport import (
    Effort,
    beam_setup,
    flat_stacks,
    mean_and_error,
    panels_setup,
    trace,
)
from twin.transport.engine import UNBOUNDED_STACK

NOMINAL = np.array([550.0])
SAMPLE = Sample(name="s", thickness_mm=0.5, n=1.4)
ALBEDO = np.array([0.6, 0.97])
RHO = (0.03, 0.98)
LOBES = [(0.5, 0.15, -0.4), (0.8, 0.1, -0.6), (0.3, 0.3, 0.8)]


def two_term(g: float, share: float, second_g: float, sigma_t: float = 2.0) -> OpticalProperties:
    one = np.ones(1)
    return OpticalProperties(NOMINAL, 0.9 * one, sigma_t * one, g * one, None, share, second_g)


def unbounded(properties: OpticalProperties, beam: bool) -> tuple[np.ndarray, np.ndarray]:
    """What the Monte Carlo says of the plane-parallel bench, and its standard error, (A, R)."""
    bench = Bench()
    stack = flat_stacks(bench, SAMPLE, NOMINAL, properties)[0]
    setup = beam_setup(bench) if beam else panels_setup(bench, stack.height)
    tallies = trace(stack, setup, Effort(48, 9, paired=True), seed=31, stream=int(beam))
    series = tallies.blocks_by_albedo(UNBOUNDED_STACK, ALBEDO)
    if beam:
        return mean_and_error(series[..., :1])
    return mean_and_error(series @ np.array(RHO)[None, :] ** tallies.bounce[:, None])


def parts_at(g: float, second: tuple[float, float] | None, sample: Sample = SAMPLE) -> list:
    """Parts of the plane-parallel bench at `ALBEDO`, (A,) each."""
    model = captures_model(Bench(), [sample], np.full(len(ALBEDO), 550.0), second=second)
    return [np.asarray(part)[:, 0] for part in model.parts(model.parameters(ALBEDO, 2.0, g))]


def plane(g: float, second: tuple[float, float] | None, beam: bool) -> np.ndarray:
    direct, once, returned, _, scattered = parts_at(g, second)
    if beam:
        return scattered[:, None]
    return np.stack([direct + rho * once / (1.0 - rho * returned) for rho in RHO], axis=1)


@pytest.mark.parametrize("beam", [False, True])
@pytest.mark.parametrize(("g", "share", "second_g"), LOBES)
def test_both_engines_agree_and_one_lobe_of_the_same_mean_does_not(
    g: float, share: float, second_g: float, beam: bool
) -> None:
    mean, error = unbounded(two_term(g, share, second_g), beam)
    z = np.abs(mean - plane(g, (share, second_g), beam)) / error
    control = np.abs(mean - plane(g, None, beam)) / error
    assert np.max(z) < 4.5
    assert np.max(control) > 6.0


def test_the_slope_over_g_is_that_of_the_values() -> None:
    model = captures_model(Bench(), [SAMPLE], np.full(2, 550.0), second=(0.1, -0.5))
    two = model.parameters(0.9, 2.0, np.array([0.599, 0.601]))
    value, jacobian = (np.asarray(found) for found in model.forward_and_jacobian(two))
    slope = jacobian[..., 2].mean(axis=0)
    np.testing.assert_allclose(slope, (value[1] - value[0]) / 0.002, rtol=1e-4)


def test_a_model_reads_no_truth_from_samples_and_the_simulating_engine_does() -> None:
    medium = Medium(albedo=0.9, sigma_t_per_mm=2.0, g=0.6, second_share=0.1)
    sample = SAMPLE.model_copy(update={"material": medium})
    np.testing.assert_array_equal(parts_at(0.6, None, sample), parts_at(0.6, None))
    assert np.max(np.abs(parts_at(0.6, (0.1, -0.5))[0] / parts_at(0.6, None)[0] - 1.0)) > 0.01
    seen = captures(Bench(), sample, NOMINAL)
    given = captures(Bench(), SAMPLE, NOMINAL, properties=two_term(0.6, 0.1, -0.5))
    np.testing.assert_array_equal(seen.black, given.black)
    other = captures(Bench(), SAMPLE, NOMINAL, properties=two_term(0.6, 0.2, -0.5))
    assert abs(other.black[0] / given.black[0] - 1.0) > 0.01


def test_no_second_lobe_is_one_lobe() -> None:
    for tiny, plain in zip(parts_at(0.6, (1e-9, -0.5)), parts_at(0.6, None), strict=True):
        np.testing.assert_allclose(tiny, plain, rtol=1e-7)


def test_lobes_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputError, match="first lobe"):
        captures(Bench(), SAMPLE, NOMINAL, properties=two_term(0.9, 0.4, -0.5))
    with pytest.raises(InputError, match="second lobe"):
        captures(Bench(), SAMPLE, NOMINAL, properties=replace(two_term(0.5, 0.1, -0.5), second_g=1))
    with pytest.raises(InputError, match="moments"):
        captures_model(Bench(), [SAMPLE], NOMINAL, moments=np.ones(1), second=(0.1, -0.5))


def test_a_mean_cosine_beyond_the_shares_stays_finite() -> None:
    """A tenth of isotropic scattering leaves a mean cosine of 0.9 at most; a fit may ask for it."""
    beyond = plane(0.95, (0.1, 0.0), beam=False)
    most = plane(0.9 * 0.995, (0.1, 0.0), beam=False)
    assert np.isfinite(beyond).all()
    assert np.allclose(beyond, most)
