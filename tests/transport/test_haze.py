"""A rough surface as a thin scattering cover: what it scatters, and that it keeps all light."""

from __future__ import annotations

import numpy as np
import pytest

from twin.bench import Bench, Layer, Sample
from twin.errors import InputError
from twin.haze import HAZE_MM, hazed
from twin.materials import OpticalProperties
from twin.transport import Effort, Setup, captures, flat_stacks, trace

NOMINAL = np.array([550.0])
SAMPLE = Sample(name="clear", thickness_mm=1.0)
CLEAR = OpticalProperties(NOMINAL, np.array([0.9]), np.array([1e-9]), np.zeros(1), None)


@pytest.mark.parametrize(("haze", "g"), [(0.05, 0.96), (0.3, 0.9)])
def test_the_share_that_is_not_scattered_and_all_light_is_kept(haze: float, g: float) -> None:
    bench = hazed(Bench(), haze, g)
    plain = flat_stacks(Bench(), SAMPLE, NOMINAL, CLEAR)[0]
    stack = flat_stacks(bench, SAMPLE, NOMINAL, CLEAR)[0]
    assert stack.height == pytest.approx(plain.height, abs=1e-12)
    rough, clear = (
        captures(own, SAMPLE, NOMINAL, properties=CLEAR, paths=16_384) for own in (bench, Bench())
    )
    ratio = float(rough.collimated[0] / clear.collimated[0])
    # within the acceptance of 1 degree some of the scattered light is collected too
    in_cone = haze * (1.0 + g) / (1.0 - g) ** 2 * np.radians(1.0) ** 2 / 4.0 / 1.52**2
    assert ratio == pytest.approx(1.0 - haze + in_cone, abs=0.15 * in_cone + 1e-3)
    around = Setup(from_below=True, up="hemisphere", down="hemisphere")
    tallies = trace(stack, around, Effort(32, 9), seed=1)
    total = sum(tallies.blocks_by_albedo(side, np.ones(1))[:, 0].sum(axis=-1) for side in (0, 1))
    error = total.std(ddof=1) / np.sqrt(len(total))
    assert abs(total.mean() - 1.0) < 4.5 * error + 2e-4
    assert error < 0.01


def test_haze_sends_light_of_the_panels_to_the_detector() -> None:
    found = [
        captures(bench, SAMPLE, NOMINAL, properties=CLEAR, paths=8192)
        for bench in (Bench(), hazed(Bench(), 0.1, 0.9))
    ]
    assert found[1].black[0] > found[0].black[0] + 4.0 * found[1].black_se[0]


def test_no_haze_is_the_same_bench_and_the_rest_is_checked() -> None:
    bench = Bench()
    assert hazed(bench, 0.0) is bench
    bare = Bench(covers_above=(), covers_below=())
    with pytest.raises(InputError, match="bare sample"):
        hazed(bare, 0.1)
    assert hazed(bare, 0.1, n=1.5).covers_above[0].thickness_mm == HAZE_MM
    with pytest.raises(InputError, match="haze of 1"):
        hazed(bench, 1.0)
    with pytest.raises(InputError, match="g 1"):
        hazed(bench, 0.1, 1.0)
    thin = Bench(covers_above=(Layer(thickness_mm=HAZE_MM, n=1.5),))
    with pytest.raises(InputError, match="thinner"):
        hazed(thin, 0.1)
