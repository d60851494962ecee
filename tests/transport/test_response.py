"""The difference between two benches by common random numbers."""

from __future__ import annotations

import numpy as np
import pytest

from tests.transport.scenes import slab
from twin.bench import Bench, Panel, Sample
from twin.errors import InputError
from twin.materials import OpticalProperties
from twin.transport import Effort, capture_blocks, captures, mean_and_error, response, trace
from twin.transport.geometry import beam_setup

WAVELENGTH = np.array([500.0, 600.0])
SAMPLE = Sample(name="s", thickness_mm=1.0)
MEDIUM = OpticalProperties(
    WAVELENGTH, np.array([0.9, 0.97]), np.array([1.0, 3.0]), np.array([0.5, 0.8]), None
)
BENCH = Bench()
PANELS = tuple(Panel(azimuth_deg=azimuth, polar_deg=47.0) for azimuth in (0.0, 180.0))
CHANGED = {
    "panel angle": BENCH.model_copy(update={"panels": PANELS}),
    "size": BENCH.model_copy(update={"size_mm": (20.0, 16.0)}),
    "off centre": BENCH.model_copy(update={"offset_mm": (10.0, 0.0)}),
    "acceptance": BENCH.model_copy(
        update={"detector": BENCH.detector.model_copy(update={"acceptance_deg": 1.3})}
    ),
}


@pytest.mark.parametrize("name", CHANGED)
def test_the_noise_is_common(name: str) -> None:
    """The error of a difference is far below that of independent runs (the control)."""
    found, error = response(
        BENCH, CHANGED[name], SAMPLE, WAVELENGTH, properties=MEDIUM, paths=2048, seed=1
    )
    assert found.shape == error.shape == (2, 3)
    alone = [
        mean_and_error(capture_blocks(b, SAMPLE, WAVELENGTH, properties=MEDIUM, paths=2048, seed=s))
        for s, b in ((2, BENCH), (3, CHANGED[name]))
    ]
    independent = np.hypot(alone[0][1], alone[1][1])[:, :2]
    assert np.all(error[:, :2] < 0.25 * independent)
    assert np.all(independent > 0.0)


def test_the_difference_is_that_of_captures() -> None:
    thicker = Sample(name="s", thickness_mm=1.1)
    found, error = response(
        BENCH, BENCH, SAMPLE, WAVELENGTH, changed_sample=thicker, properties=MEDIUM, paths=8192
    )
    runs = [
        captures(BENCH, own, WAVELENGTH, properties=MEDIUM, paths=16_384, seed=5)
        for own in (SAMPLE, thicker)
    ]
    value = [np.stack([run.black, run.white, run.collimated], axis=1) for run in runs]
    spread = [np.stack([run.black_se, run.white_se, run.collimated_se], axis=1) for run in runs]
    noise = np.sqrt(error**2 + spread[0] ** 2 + spread[1] ** 2)
    assert np.all(np.abs(found - (value[1] - value[0])) < 4.5 * noise + 1e-6)
    assert np.max(np.abs(found) / error) > 10.0


def test_the_same_bench_answers_with_nothing_and_materials_may_change() -> None:
    same, error = response(BENCH, BENCH, SAMPLE, WAVELENGTH, properties=MEDIUM, paths=512)
    assert not same.any()
    assert not error.any()
    darker = OpticalProperties(
        WAVELENGTH, MEDIUM.albedo - 0.1, MEDIUM.sigma_t_per_mm, MEDIUM.g, None
    )
    less, error = response(
        BENCH, BENCH, SAMPLE, WAVELENGTH, properties=MEDIUM, changed_properties=darker, paths=512
    )
    assert np.all(less[:, :2] < -4.0 * error[:, :2])
    with pytest.raises(InputError, match="no material"):
        response(BENCH, BENCH, SAMPLE, WAVELENGTH)


def test_common_random_numbers_exclude_sorting_and_splitting() -> None:
    for effort in (Effort(common=True), Effort(common=True, lattice=False, split_albedo=0.9)):
        with pytest.raises(ValueError, match="common"):
            trace(slab(1.0), beam_setup(BENCH), effort)


def test_common_random_numbers_keep_the_mean() -> None:
    effort = Effort(48, 9)
    common = Effort(48, 9, lattice=False, common=True)
    found = [
        trace(slab(2.0, 0.6, 1.4), beam_setup(BENCH), own, seed=8).blocks_by_albedo(
            0, np.array([0.95])
        )[:, 0, 0]
        for own in (effort, common)
    ]
    (a, e), (b, f) = (mean_and_error(blocks) for blocks in found)
    assert abs(a - b) < 4.5 * np.hypot(e, f)
    assert abs(1.05 * a - b) > 4.5 * np.hypot(e, f)
