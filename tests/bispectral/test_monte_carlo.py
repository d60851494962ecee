"""The coupled walk and the forward walk: against each other, closed forms and the fast route."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.bispectral.world import IN, OUT, WAVELENGTH, dye, medium, open_bench, sample
from twin.adding_doubling.panels import panel_light, plane_factors
from twin.bench import Background, Backgrounds, Bench, Medium, Panel
from twin.bispectral import (
    BispectralCaptures,
    Donaldson,
    FluorescentMedium,
    Ledger,
    donaldson,
    energy_ledger,
    fluorescent_properties,
    trace_bispectral,
)
from twin.errors import InputError

PATHS = 32_768
FAR_OFF = 4.0
"""Standard errors beyond which a deviation is none of chance."""


@cache
def traced(g: float = 0.0, generations: int = 2) -> BispectralCaptures:
    bench = open_bench()
    return trace_bispectral(
        bench, sample(), medium(g=g), out=(OUT,), paths=PATHS, generations=generations, seed=3
    )


@cache
def fast(g: float = 0.0) -> Donaldson:
    return donaldson(open_bench(), [sample()], medium(g=g))


@cache
def ledger(wrong: bool = False) -> Ledger:
    bench, own = open_bench(), medium()
    extinction = own.sigma_t_per_mm - own.fluorophore_per_mm if wrong else None
    light = panel_light(bench)
    return energy_ledger(
        bench, sample(), own, IN, cosines=tuple(light.cosine), shares=tuple(light.share),
        paths=PATHS, seed=1, extinction=extinction,
    )  # fmt: skip


@pytest.mark.parametrize("g", [0.0, 0.6])
def test_the_coupled_walk_agrees_with_the_product_of_profiles(g: float) -> None:
    found, expected = traced(g), fast(g).fluorescent[0, :2, OUT]
    once = found.fluorescent[:, 0] - found.again[:, 0]
    lit = expected[0] > 0.0
    assert lit.sum() == OUT
    pull = (once - expected)[:, lit] / found.fluorescent_se[:, 0][:, lit]
    assert np.abs(pull).max() < FAR_OFF
    # the test can fail: radiance not divided by n^2, or emission of a Lambertian kind
    assert np.abs((once - 1.2 * expected)[:, lit] / found.fluorescent_se[:, 0][:, lit]).max() > 4.0


def test_the_coupled_walk_sees_the_elastic_light_too() -> None:
    found, expected = traced(), fast().elastic[0, :2, OUT]
    # the fast engine lights the background as if it lay on z = 0
    allowance = FAR_OFF * found.elastic_se[:, 0] + 0.005 * expected
    assert np.all(np.abs(found.elastic[:, 0] - expected) < allowance)


def test_all_energy_is_accounted_for() -> None:
    found = ledger()
    assert abs(found.total - 1.0) < FAR_OFF * found.total_se
    assert found.total_se < 0.003
    assert found.share["fluoresced_up"] > 0.05
    assert found.share["fluoresced_down"] > 0.05


def test_energy_is_not_accounted_for_when_the_dye_is_left_out_of_extinction() -> None:
    found = ledger(wrong=True)
    assert abs(found.total - 1.0) > 6.0 * found.total_se


def test_fluorescence_escapes_in_proportion_to_the_quantum_yield() -> None:
    bench, light = open_bench(), panel_light(open_bench())
    pump = {"cosines": tuple(light.cosine), "shares": tuple(light.share), "paths": PATHS // 4}
    half = energy_ledger(bench, sample(), medium(quantum_yield=0.4), IN, **pump)
    nothing = energy_ledger(bench, sample(), medium(quantum_yield=0.0), IN, **pump)
    assert nothing.share["fluoresced_up"] == 0.0
    ratio = ledger().share["fluoresced_up"] / half.share["fluoresced_up"]
    # twice, and a little more: what is reabsorbed may be emitted again
    assert 1.9 < ratio < 2.35


def test_the_forward_walk_has_the_depth_profile_of_the_fast_route() -> None:
    from twin.bispectral.fields import depth_nodes, fields_of
    from twin.bispectral.profiles import fast_model

    own, bench = medium(), open_bench()
    model = fast_model(bench, [sample()], own.wavelength_nm, own.g)
    parameters = model.parameters(own.albedo, own.sigma_t_per_mm, own.g)
    profile = np.asarray(fields_of(parameters, model.constants, model.form).panels)[IN, 0]
    nodes, _ = depth_nodes()
    found = ledger()
    edges = np.linspace(0.0, 1.0, len(found.fluence) + 1)
    fine = np.polynomial.Polynomial.fit(nodes, profile, 10).integ()
    expected = np.diff(fine(edges)) * len(found.fluence)
    assert np.abs((found.fluence - expected) / found.fluence_se).max() < FAR_OFF
    assert np.abs((found.fluence[::-1] - expected) / found.fluence_se).max() > 10.0


def test_a_slab_that_does_not_scatter_has_a_closed_form() -> None:
    """Light goes straight in at the panels' angles, and straight out to the detector."""
    bench, slab = open_bench(rho=(0.0, 0.0)), sample(0.5, 1.0)
    own = medium(sigma_a=0.4, sigma_s=0.0)
    light, height = panel_light(bench), np.exp(plane_factors(bench, (slab,))[0, 0])
    sigma_in, sigma_out = own.sigma_t_per_mm[[IN, OUT]]
    slope = sigma_in / light.cosine + sigma_out
    profile = light.share @ ((1.0 - np.exp(-slope * 0.5)) / slope / light.cosine)
    expected = own.source[OUT, IN] / 4.0 * profile * height
    quick = donaldson(bench, [slab], own).fluorescent[0, 0, OUT, IN]
    assert quick == pytest.approx(expected, rel=1e-4)
    found = trace_bispectral(bench, slab, own, out=(OUT,), paths=PATHS, generations=1, seed=5)
    assert abs(found.fluorescent[0, 0, IN] - expected) < FAR_OFF * found.fluorescent_se[0, 0, IN]


def test_a_thin_film_has_a_closed_form() -> None:
    """Illumination x absorption x thickness x yield x escape 1 / (4 n^2), any index."""
    for n in (1.0, 1.5):
        bench, film = open_bench(rho=(0.0, 0.0)), sample(1e-3, n)
        own = medium(sigma_a=0.0, sigma_s=0.0, absorption=1e-3)
        light, height = panel_light(bench), np.exp(plane_factors(bench, (film,))[0, 0])
        inside = np.sqrt(1.0 - (1.0 - light.cosine**2) / n**2)
        expected = own.source * 1e-3 / (4.0 * n**2) * (light.share @ (1.0 / inside)) * height
        found = donaldson(bench, [film], own).fluorescent[0, 0]
        assert np.allclose(found, expected, rtol=2e-4, atol=0.0)


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads() -> None:
    own = {"out": (4, OUT), "paths": 2048, "seed": 9}
    one, two, other = (
        trace_bispectral(Bench(), sample(), medium(), threads=threads, **{**own, "seed": seed})
        for threads, seed in ((1, 9), (2, 9), (2, 10))
    )
    assert one.fluorescent.tobytes() == two.fluorescent.tobytes()
    assert one.fluorescent.tobytes() != other.fluorescent.tobytes()


def test_a_second_emission_is_told_apart() -> None:
    single = traced(0.0, generations=1)
    assert np.all(single.again == 0.0)
    share = traced().again[:, 0].sum(axis=1) / traced().fluorescent[:, 0].sum(axis=1)
    assert np.all((share > 0.01) & (share < 0.12))


def test_a_finite_bench_gets_less_light_from_its_white_background() -> None:
    found = trace_bispectral(
        Bench(size_mm=(6.0, 6.0)), sample(), medium(), out=(OUT,), paths=8192, seed=2
    )
    wide = fast().fluorescent[0, 1, OUT].sum()
    assert found.fluorescent[1, 0].sum() < 0.85 * wide


def test_lights_are_summed_over_their_bins() -> None:
    own = medium()
    lights = np.eye(len(own.wavelength_nm))[[IN, IN + 1]]
    found = trace_bispectral(Bench(), sample(), own, out=(OUT,), lights=lights, paths=2048, seed=4)
    expected = found.fluorescent[:, :, [IN, IN + 1]] * own.step_nm[[IN, IN + 1]]
    assert np.allclose(found.lit, expected, rtol=1e-12)
    assert np.all(found.lit_se > 0.0)


@pytest.mark.parametrize(
    "wrong", [{"out": (99,)}, {"out": ()}, {"generations": 0}, {"lights": np.zeros((1, 3))}]
)
def test_wrong_input_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        trace_bispectral(Bench(), sample(), medium(), paths=64, **wrong)  # type: ignore[arg-type]


def test_effects_that_are_not_followed_are_refused_and_others_act() -> None:
    glossy = Bench(background=Backgrounds(white=Background(reflectance=0.9, gloss=0.1)))
    with pytest.raises(InputError):
        trace_bispectral(glossy, sample(), medium(), out=(OUT,), paths=64)
    host = Medium(albedo=0.9, sigma_t_per_mm=2.0, second_share=0.1)
    with pytest.raises(InputError):
        fluorescent_properties(FluorescentMedium(host=host, fluorophores=(dye(0.1),)), WAVELENGTH)
    # twice the radiance of both panels is twice the light and twice the reference
    bright = Bench(panels=(Panel(level=2.0), Panel(azimuth_deg=180.0, level=2.0)))
    moved = Bench(size_mm=(6.0, 6.0), offset_mm=(0.9, 0.0))
    plain, level, aside = (
        trace_bispectral(bench, sample(), medium(), out=(OUT,), paths=2048, seed=8)
        for bench in (Bench(), bright, moved)
    )
    assert np.allclose(level.fluorescent, plain.fluorescent, rtol=1e-4)
    assert not np.allclose(aside.fluorescent, plain.fluorescent, rtol=1e-2)
