"""Slabs against closed forms, published values, conservation and other people's programs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.adding_doubling import make_streams, slab_optics
from twin.adding_doubling.streams import condensed, interpolation, radau
from twin.errors import InputError
from twin.optics import stack

# published values: (albedo, optical thickness, g, n) -> quantity
PUBLISHED = [
    # van de Hulst (1980), Multiple Light Scattering, vol. 2, table 35: g 0.75 in the open
    ((0.9, 2.0, 0.75, 1.0), "UR1", 0.09739),
    ((0.9, 2.0, 0.75, 1.0), "UT1", 0.66096),
    # Giovanelli (1955), Optica Acta 2, 153: semi-infinite, isotropic, n 1.5, specular included
    ((0.9, 1e5, 0.0, 1.5), "UR1", 0.2600),
    # van de Hulst (1980), vol. 1, p. 256: isotropic; and Prahl, tests of iadpython (MIT licence)
    ((0.8, 1e5, 0.0, 1.0), "UR1", 0.28525),
    ((0.8, 1e5, 0.0, 1.0), "URU", 0.34187),
    ((0.8, 1.0, 0.0, 1.0), "UT1", 0.54140),
    ((0.8, 1.0, 0.0, 1.0), "UTU", 0.41624),
    ((0.8, 1.0, 0.8, 1.0), "UT1", 0.76388),
]
# the same table 35: exit cosine, reflected and diffusely transmitted radiance factor of a
# beam along the normal
TABLE_35 = np.array(
    [
        (0.1, 0.13304, 0.16486),
        (0.3, 0.13856, 0.22473),
        (0.9, 0.07132, 0.72155),
        (1.0, 0.06180, 2.40270),
    ]
)
SIX = np.array([0.1, 0.3, 0.5, 0.7, 0.9, 1.0])


def chandrasekhar_h(albedo: float, mu: float) -> float:
    """H function of an isotropic half-space by its integral (Chandrasekhar 1950, sec. 39)."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    angle, weight = (nodes + 1) * math.pi / 4, weights * math.pi / 4
    cotangent = angle / np.tan(angle)
    integrand = (
        mu * np.log(1 - albedo * cotangent) / (np.cos(angle) ** 2 + mu**2 * np.sin(angle) ** 2)
    )
    return float(np.exp(-np.sum(weight * integrand) / math.pi))


@pytest.mark.parametrize(("problem", "name", "value"), PUBLISHED)
def test_published_values(problem: tuple[float, ...], name: str, value: float) -> None:
    assert float(getattr(slab_optics(*problem), name)) == pytest.approx(value, abs=1e-4)


def test_published_radiances() -> None:
    optics = slab_optics(0.9, 2.0, 0.75, cosines=tuple(TABLE_35[:, 0]))
    assert np.allclose(optics.reflected_factor[:, -1], TABLE_35[:, 1], rtol=1e-3, atol=1e-4)
    assert np.allclose(optics.transmitted_factor[:, -1], TABLE_35[:, 2], rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("albedo", [0.5, 0.9, 0.99])
def test_half_space_is_chandrasekhars(albedo: float) -> None:
    s = math.sqrt(0.5)
    optics = slab_optics(albedo, 1e6, cosines=(s, 1.0))
    h_s, h_1 = chandrasekhar_h(albedo, s), chandrasekhar_h(albedo, 1.0)
    assert float(optics.UR1) == pytest.approx(1 - h_1 * math.sqrt(1 - albedo), abs=2e-6)
    expected = albedo / 4 * h_s * h_1 / (1 + s)
    assert float(optics.reflected_factor[1, 0]) == pytest.approx(expected, rel=1e-5)


def test_without_scattering_it_is_the_closed_form() -> None:
    depth = np.array([0.0, 0.01, 0.3, 2.0, 20.0])
    cosines = (0.1, 0.7, 1.0)
    optics = slab_optics(
        0.0, depth, 0.5, 1.5, cosines=cosines, covers_above=[(1.6, 0.1)], covers_below=[(1.4, 0.0)]
    )
    exact = stack([1.6, 1.5, 1.4], [0.1, depth[:, None], 0.0], cosine=np.array(cosines))
    assert np.allclose(optics.transmittance, exact.transmittance_down, atol=1e-9)
    assert np.allclose(optics.reflectance, exact.reflectance_above, atol=1e-9)
    assert np.allclose(optics.unscattered_transmittance, exact.transmittance_down, atol=1e-12)


@settings(max_examples=15)
@given(depth=st.floats(0.01, 60.0), g=st.floats(-0.5, 0.9), n=st.sampled_from([1.0, 1.3, 1.5, 1.9]))
def test_nothing_is_lost_without_absorption(depth: float, g: float, n: float) -> None:
    optics = slab_optics(1.0, depth, g, n, air=8, trapped=8)
    assert float(optics.UR1 + optics.UT1) == pytest.approx(1.0, abs=1e-9)
    assert float(optics.URU + optics.UTU) == pytest.approx(1.0, abs=1e-9)
    absorbing = slab_optics(0.999, depth, g, n, air=8, trapped=8)
    assert float(absorbing.UR1 + absorbing.UT1) < 1.0 - 1e-6


def test_directions_can_be_swapped() -> None:
    optics = slab_optics(
        [0.9, 0.99], [1.0, 4.0], [0.9, 0.3], 1.5, cosines=(0.3, 0.71, 1.0),
        covers_above=[(1.52, 0.05)],
    )  # fmt: skip
    swapped = optics.reflected_factor.swapaxes(1, 2)
    assert np.allclose(optics.reflected_factor, swapped, rtol=1e-9)
    assert not np.allclose(optics.transmitted_factor, optics.reflected_factor, rtol=0.1)


def test_doubling_two_halves_is_the_whole() -> None:
    """Adding with a matched interface: layer responses of tau/2 twice give those of tau."""
    from twin.adding_doubling.faces import inside
    from twin.adding_doubling.layer import layer_modes, polynomials, respond
    from twin.adding_doubling.phase import henyey_greenstein_moments

    import jax.numpy as jnp  # isort: skip

    streams = make_streams(8, 0)
    here = inside(streams, jnp.asarray(1.0))
    layer = layer_modes(
        here,
        polynomials(here, 8),
        jnp.asarray(0.95),
        henyey_greenstein_moments(jnp.asarray(0.6), 8),
    )
    eye, zero = jnp.eye(8), jnp.zeros((8, 8))
    open_window = layer.shape.T @ layer.shape

    def operators(depth: float) -> tuple[np.ndarray, np.ndarray]:
        top, bottom = respond(layer, open_window, None, jnp.asarray(depth), 2 * eye, zero)
        return np.asarray(top - eye), np.asarray(bottom)

    r, t = operators(0.7)
    r2, t2 = operators(1.4)
    inner = np.linalg.inv(np.eye(8) - r @ r)
    assert np.allclose(r + t @ inner @ r @ t, r2, atol=1e-12)
    assert np.allclose(t @ inner @ t, t2, atol=1e-12)


def test_more_streams_change_little() -> None:
    problem = ([0.9, 0.99, 0.5], [4.0, 1.0, 1.0], [0.9, 0.8, 0.5], 1.5)
    few, many = (slab_optics(*problem, air=a, trapped=a, cones_deg=(2, 10)) for a in (16, 28))
    for name in ("UR1", "UT1", "URU", "UTU", "cone_transmittance"):
        assert np.allclose(getattr(few, name), getattr(many, name), rtol=1e-3, atol=5e-5)
    coarse = slab_optics(*problem, air=4, trapped=4)
    assert not np.allclose(coarse.UT1, many.UT1, rtol=1e-3, atol=1e-4)


def test_tabulated_moments_are_the_same_medium() -> None:
    g, problem = 0.7, (0.9, 2.0)
    moments = np.asarray(g ** np.arange(200), dtype=np.float64)
    named = slab_optics(*problem, g, 1.4, cosines=(0.7, 1.0), cones_deg=(2, 10))
    table = slab_optics(*problem, 0.0, 1.4, cosines=(0.7, 1.0), cones_deg=(2, 10), moments=moments)
    assert np.allclose(named.UR1, table.UR1, rtol=1e-10)
    assert np.allclose(named.reflected_factor, table.reflected_factor, rtol=1e-5)
    assert np.allclose(named.cone_transmittance, table.cone_transmittance, rtol=1e-8)


def test_a_black_backing_and_a_matched_contact_change_nothing() -> None:
    open_air = slab_optics(0.9, 2.0, 0.5, 1.0, cosines=(0.7, 1.0), backing=0.6)
    contact = slab_optics(0.9, 2.0, 0.5, 1.0, cosines=(0.7, 1.0), backing=0.6, contact=True)
    alone = slab_optics(0.9, 2.0, 0.5, 1.0, cosines=(0.7, 1.0))
    assert np.allclose(open_air.reflected_factor, contact.reflected_factor, rtol=1e-9)
    assert np.all(open_air.reflected_factor > alone.reflected_factor + 0.01)
    # an index step keeps light inside, optical contact lets it reach the backing
    near = slab_optics(0.9, 0.5, 0.5, 1.5, cosines=(1.0,), backing=0.9, contact=True)
    apart = slab_optics(0.9, 0.5, 0.5, 1.5, cosines=(1.0,), backing=0.9)
    assert abs(float(near.reflected_factor[0, 0] - apart.reflected_factor[0, 0])) > 0.01


@pytest.mark.parametrize("points", [16, 24])
def test_iadpython_agrees(points: int) -> None:
    iadpython = pytest.importorskip("iadpython")
    cases = [(0.9, 2.0, 0.5, 1.5), (0.5, 1.0, 0.8, 1.4), (0.99, 4.0, 0.0, 1.0)]
    for a, b, g, n in cases:
        theirs = iadpython.Sample(a=a, b=b, g=g, n=n, quad_pts=points).rt()[:4]
        ours = slab_optics(a, b, g, n)
        four = [float(getattr(ours, name)) for name in ("UR1", "UT1", "URU", "UTU")]
        assert np.allclose(four, np.array(theirs, dtype=float), atol=1e-3)
        thicker = slab_optics(a, 1.03 * b, g, n)
        assert abs(float(thicker.UT1) - float(theirs[1])) > 1e-3


def test_pythonic_disort_agrees() -> None:
    """Fluxes of a beam at 45 degrees; its radiances at mu = 1 are not right (traps.md)."""
    disort = pytest.importorskip("PythonicDISORT")
    albedo, depth, g, mu0 = 0.95, 2.0, 0.6, math.sqrt(0.5)
    _, up, down, *_ = disort.pydisort(
        np.array([depth]), np.array([albedo]), 32, g ** np.arange(65)[None, :], mu0, 1.0 / mu0,
        0.0, only_flux=True, f_arr=g**32, NLeg=32,
    )  # fmt: skip
    ours = slab_optics(albedo, depth, g, cosines=(mu0,))
    diffuse, direct = down(depth)
    assert float(ours.reflectance[0]) == pytest.approx(float(up(0.0)), abs=1e-5)
    assert float(ours.transmittance[0]) == pytest.approx(float(diffuse + direct), abs=1e-5)


def test_quadrature_is_exact_for_polynomials() -> None:
    nodes, weights = radau(7)
    for degree in range(13):
        assert float(weights @ nodes**degree) == pytest.approx(1 / (degree + 1), rel=1e-12)
    assert abs(float(weights @ nodes**14) - 1 / 15) > 1e-12
    assert np.allclose(interpolation(nodes, SIX) @ nodes**6, SIX**6)
    spread = np.linspace(0.5, 0.9, 1000)
    rule, share = condensed(spread, spread, 5)
    assert float(share @ rule**9) == pytest.approx(float(spread @ spread**9 / spread.sum()))


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        ({"albedo": 1.2, "optical_thickness": 1.0}, "albedo"),
        ({"albedo": 0.5, "optical_thickness": -1.0}, "optical thickness"),
        ({"albedo": 0.5, "optical_thickness": 1.0, "n": 0.9}, "n"),
        ({"albedo": 0.5, "optical_thickness": math.nan}, "optical thickness"),
        ({"albedo": 0.5, "optical_thickness": 1.0, "moments": np.array([0.5])}, "moments"),
        ({"albedo": 0.5, "optical_thickness": 1.0, "cosines": (0.0,)}, "looked_at"),
        ({"albedo": 0.5, "optical_thickness": 1.0, "n": 1.5, "air": 2}, "streams"),
    ],
)
def test_what_cannot_be_is_said(arguments: dict[str, object], place: str) -> None:
    with pytest.raises(InputError) as caught:
        slab_optics(**arguments)  # type: ignore[arg-type]
    assert caught.value.place == place
