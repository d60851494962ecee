"""Layers of unlike media inside a sample: closed forms, the Monte Carlo, and a control."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.adding_doubling.benches import medium, unbounded
from twin.adding_doubling import CapturesModel, captures_model
from twin.adding_doubling.single import Ray, reflected_once, reflected_once_inside
from twin.bench import Sample
from twin.effects import World, world_captures
from twin.effects.world import Sublayer
from twin.errors import InputError

SAMPLES = (
    Sample(name="thin", thickness_mm=0.4, n=1.5),
    Sample(name="thick", thickness_mm=1.2, n=1.5),
)
MEDIA = medium([0.9, 0.97, 0.6], [3.0, 5.0, 2.0], [0.7, 0.5, 0.8])
NAMES = ("black", "white", "collimated")
CONTRASTS = {
    "scattering": ((0.5, 1.3, 1.0), (0.5, 0.7, 1.0)),
    "absorption": ((0.5, 1.0, 1.5), (0.5, 1.0, 0.5)),
    "three": ((0.2, 0.5, 2.0), (0.3, 1.6, 1.0), (0.5, 0.8, 0.4)),
}


def model(*layers: tuple[float, float, float]) -> CapturesModel:
    return captures_model(unbounded(), SAMPLES, MEDIA.wavelength_nm, sublayers=layers)


def seen(*layers: tuple[float, float, float]) -> np.ndarray:
    """Captures (W, S, 3)."""
    own = model(*layers)
    return np.asarray(own.forward(own.parameters(MEDIA.albedo, MEDIA.sigma_t_per_mm, MEDIA.g)))


@settings(deadline=None, derandomize=True, max_examples=5)
@given(st.floats(0.05, 0.95))
def test_layers_alike_are_one_layer(share: float) -> None:
    assert np.allclose(seen((share, 1.0, 1.0), (1.0 - share, 1.0, 1.0)), seen(), atol=1e-9)


def test_factors_of_all_layers_are_factors_of_the_sample() -> None:
    own = model()
    scattering = 1.4 * MEDIA.albedo * MEDIA.sigma_t_per_mm
    total = scattering + 0.7 * (1.0 - MEDIA.albedo) * MEDIA.sigma_t_per_mm
    whole = own.forward(own.parameters(scattering / total, total, MEDIA.g))
    assert np.allclose(seen((0.5, 1.4, 0.7), (0.5, 1.4, 0.7)), whole, atol=1e-9)


def test_what_goes_through_does_not_know_which_layer_comes_first() -> None:
    """Reciprocity (van de Hulst 1980, chapter 3): the same covers above and below."""
    layers = CONTRASTS["absorption"]
    there, back = (model(*each) for each in (layers, layers[::-1]))
    one, other = (
        each.parts(each.parameters(MEDIA.albedo, MEDIA.sigma_t_per_mm, MEDIA.g))
        for each in (there, back)
    )
    # along the normal both ways; the panels look along other directions than the detector
    assert np.allclose(one.scattered, other.scattered, rtol=1e-6)
    assert np.allclose(one.unscattered, other.unscattered, rtol=1e-9)
    assert np.max(np.abs(np.asarray(one.direct) / np.asarray(other.direct) - 1.0)) > 0.05


def test_scattered_once_in_layers_is_the_sum_of_a_fine_cut() -> None:
    """By the midpoint rule over depth, with one reflection at the far window."""
    ray = Ray(*(np.array(each) for each in (0.8, 0.95, 0.04, 0.3)))
    view = Ray(*(np.array(each) for each in (0.95, 0.96, 0.05, 0.2)))
    albedo, depth = np.array([0.9, 0.5, 0.7]), np.array([0.3, 0.8, 0.2])
    count = 2000
    edges = np.concatenate([[0.0], np.cumsum(depth)])
    whole, total = edges[-1], 0.0
    fade_l, fade_v = np.exp(-whole / ray.cosine), np.exp(-whole / view.cosine)
    for own, low, high in zip(albedo, edges[:-1], edges[1:], strict=True):
        t = low + (np.arange(count) + 0.5) * (high - low) / count
        down_l, up_v = np.exp(-t / ray.cosine), np.exp(-t / view.cosine)
        up_l = ray.far * fade_l * np.exp(-(whole - t) / ray.cosine)
        down_v = view.far * fade_v * np.exp(-(whole - t) / view.cosine)
        back, ahead = down_l * up_v + up_l * down_v, down_l * down_v + up_l * up_v
        total += own * (1.3 * back + 0.4 * ahead).sum() * (high - low) / count
    n = 1.5
    entered = ray.through / (1.0 - ray.near * ray.far * fade_l**2)
    left = view.through / (1.0 - view.near * view.far * fade_v**2)
    expected = total * entered * left / (4.0 * n**2 * ray.cosine * view.cosine)
    found = reflected_once_inside(ray, view, n, albedo, depth, 1.3, 0.4)
    assert float(found) == pytest.approx(float(expected), rel=1e-6)
    one = reflected_once_inside(ray, view, n, albedo[:1], depth[:1], 1.3, 0.4)
    assert float(one) == pytest.approx(
        float(reflected_once(ray, view, n, albedo[0], depth[0], 1.3, 0.4)), rel=1e-12
    )


@pytest.mark.parametrize("name", CONTRASTS)
def test_captures_agree_with_the_monte_carlo(name: str) -> None:
    layers = CONTRASTS[name]
    world = World.nominal(unbounded(), SAMPLES).changed(
        sublayers=tuple(Sublayer(*each) for each in layers)
    )
    traced = world_captures(
        world, MEDIA.wavelength_nm, properties=MEDIA, paths=1 << 15, seeds=[5, 6]
    )
    value = np.stack([[getattr(own, each) for each in NAMES] for own in traced]).transpose(2, 0, 1)
    error = np.stack([[getattr(own, f"{each}_se") for each in NAMES] for own in traced])
    # black and white are compared with panels as far away as they are: 0.5 % for their distance
    allowed = 4.0 * error.transpose(2, 0, 1) + 5e-3 * value
    assert np.all(np.abs(seen(*layers) - value) < allowed)
    assert np.any(np.abs(seen() - value) > 2.0 * allowed), "one layer must not explain it"


@pytest.mark.parametrize(
    "layers",
    [((0.5, 1.0, 1.0),), ((0.5, 1.0), (0.5, 1.0)), ((1.5, 1.0, 1.0), (-0.5, 1.0, 1.0)),
     ((0.5, -0.1, 1.0), (0.5, 1.0, 1.0))],
)  # fmt: skip
def test_layers_that_are_none_are_refused(layers: tuple[tuple[float, ...], ...]) -> None:
    with pytest.raises(InputError, match=r"sublayers.*all together 1"):
        captures_model(unbounded(), SAMPLES, MEDIA.wavelength_nm, sublayers=layers)  # type: ignore[arg-type]
