"""Lost light against geometry, against adding-doubling and against its own slopes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.adding_doubling import slab_optics
from twin.errors import InputError
from twin.spheres import LossGeometry, LossTable, walk_losses
from twin.transport.engine import order_bins


def lens(distance: float, a: float, b: float) -> float:
    """Area that two discs share, by a fine grid of strips."""
    x = np.linspace(-a, a, 20001)
    half_a = np.sqrt(np.maximum(a**2 - x**2, 0.0))
    half_b = np.sqrt(np.maximum(b**2 - (x - distance) ** 2, 0.0))
    return float(np.trapezoid(2.0 * np.minimum(half_a, half_b), x))


@pytest.mark.parametrize(("beam", "port"), [(5.0, 6.0), (6.0, 5.0), (4.0, 4.0)])
def test_a_tilted_beam_through_clear_air_misses_by_the_discs_geometry(
    beam: float, port: float
) -> None:
    geometry = LossGeometry(2.0, 1.0, 0.0, beam, port, port, 45.0, diffuse=False)
    lost = walk_losses(geometry, 1e-4, 0.0, 1.0, diffuse=False, paths=256)
    shift = 2.0 * math.tan(math.radians(45.0))
    expected = 1.0 - lens(shift, beam / 2, port / 2) / (math.pi * beam**2 / 4)
    assert lost[:, 1, 0].mean() == pytest.approx(expected, abs=2e-4)
    assert expected > 0.05


@pytest.mark.parametrize("slide", [0.0, 1.0])
@pytest.mark.parametrize("diffuse", [True, False])
def test_all_light_is_what_adding_doubling_says(slide: float, diffuse: bool) -> None:
    geometry = LossGeometry(1.0, 1.5, slide, 2.0, 30.0, 30.0)
    walk = walk_losses(geometry, 3.0, 0.7, 1.4, diffuse=diffuse, paths=2**15)
    albedo = 0.95
    by_block = walk @ albedo ** order_bins()[1]
    mean = by_block.mean(axis=0)
    error = by_block.std(axis=0, ddof=1) / math.sqrt(len(by_block))
    covers = [(1.5, 0.0)] if slide else []
    exact = slab_optics(albedo, 3.0, 0.7, 1.4, covers_above=covers, covers_below=covers)
    pair = (exact.URU, exact.UTU) if diffuse else (exact.UR1, exact.UT1)
    for ours, sigma, theirs in zip(mean[2:], error[2:], pair, strict=True):
        assert abs(ours - float(theirs)) < 4.0 * sigma + 1e-4
    thicker = slab_optics(albedo, 3.3, 0.7, 1.4, covers_above=covers, covers_below=covers)
    assert abs(mean[3] - float(thicker.UTU if diffuse else thicker.UT1)) > 4.0 * error[3]


def test_a_wide_port_loses_nothing_and_a_narrow_one_more() -> None:
    shares = []
    for port in (1e4, 20.0, 12.0):
        table = LossTable.of(
            LossGeometry(2.0, 1.0, 0.0, 5.0, port, port), np.array([0.8]), np.array([1.4]),
            log2_paths=12,
        )  # fmt: skip
        at = table.at(np.array([[0.99, 5.0, 0.8]]), np.array([1.4]))
        shares.append(at.share[0])
    # of diffuse light on a port 10 m wide, what enters within a millimetre of the rim
    assert shares[0][:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.all(shares[0][2:] < 2e-3)
    assert np.all(shares[2] > shares[1])
    assert np.all(shares[1][:2] > 1e-3)


def test_slopes_are_differences_and_the_table_is_the_same_in_any_order() -> None:
    geometry = LossGeometry(2.0, 1.0, 0.0, 5.0, 20.0, 16.0)
    n = np.array([1.38, 1.42])
    table = LossTable.of(geometry, None, n, log2_paths=10)
    point = np.array([[0.98, 4.0, 0.72], [0.9, 2.0, 0.3]])
    at = table.at(point, n)
    for k, step in enumerate((1e-5, 1e-4, 1e-5)):
        up, down = point.copy(), point.copy()
        up[:, k] += step
        down[:, k] -= step
        slope = (table.at(up, n).share - table.at(down, n).share) / (2 * step)
        assert np.allclose(at.slope[:, :, k], slope, rtol=1e-4, atol=1e-8)
    again = LossTable.of(geometry, None, n, log2_paths=10)
    other = again.at(point[::-1], n[::-1])
    assert np.array_equal(other.share[::-1], at.share)
    assert not np.array_equal(
        LossTable.of(geometry, None, n, log2_paths=10, seed=1).at(point, n).share, at.share
    )
    assert again.walks == table.walks


def test_a_port_without_width_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        LossGeometry(1.0, 1.0, 0.0, 1.0, 0.0, 10.0)
    assert caught.value.place == "ports"
