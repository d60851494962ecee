"""Fluorophores take from the reflectance: the model against its formula, and what it gains."""

from __future__ import annotations

import numpy as np

from estimators.fluorescence.cells import gather
from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
from estimators.fluorescence.products import Products, ShapePrior
from scenarios.design.fluorescent_population import fluorescent_population
from tests.fluorescence.cases import BELOW, data, material, system
from twin.spectra import FloatArray

WITHOUT = ShapePrior(dip=(0.0, 0.0))


def model(shapes: ShapePrior) -> Products:
    captures = gather([data(material(1), system("chip"))])
    return Products(captures.design * BELOW, captures.cells, shapes, captures.diagonal_design)


def test_captures_are_those_of_the_matrix_that_the_products_make() -> None:
    products = model(ShapePrior())
    point = 0.3 * np.random.Generator(np.random.Philox(key=3)).standard_normal((2, 2, 32))
    assert point.shape[-1] == products.size
    matrix = products.cells.matrix(products.fluorescence(point), products.reflectance(point))
    design = gather([data(material(1), system("chip"))]).design
    assert np.allclose(products.values(point), np.tensordot(matrix, design, axes=((1, 2), (1, 2))))


def test_reflectance_lacks_the_dip_times_the_excitation() -> None:
    products = model(ShapePrior(dip=(0.2, 0.1)))
    point = np.zeros((1, 1, products.size))
    point[0, 0, -1] = 2.0
    _, excitation = products.spectra(point)
    assert np.allclose(products.reflectance(point), -(0.2 + 2.0 * 0.1) * excitation[:, 0])
    none = model(WITHOUT)
    assert none.size == products.size - 1
    assert not none.reflectance(np.ones((1, 2, none.size))).any()


def test_slopes() -> None:
    products = model(ShapePrior())
    random = np.random.Generator(np.random.Philox(key=2))
    point = 0.3 * random.standard_normal((1, 2, products.size))
    value, jacobian = products.values_and_jacobian(point)
    assert np.allclose(value, products.values(point), rtol=1e-10)
    for index in range(2 * products.size):
        step = np.zeros(2 * products.size)
        step[index] = 1e-5
        step = step.reshape(1, 2, -1)
        slope = (products.values(point + step) - products.values(point - step)) / 2e-5
        assert np.allclose(jacobian[0, :, index], slope[0], rtol=2e-2, atol=2e-3)


def relative_error(truth: FloatArray) -> tuple[float, float]:
    """Errors of cells and reflectance over those of a model without dips, geometric means."""
    given = [data(matrix, system("chip"), seed) for seed, matrix in enumerate(truth)]
    found = []
    for shapes in (ShapePrior(), WITHOUT):
        estimator = DonaldsonEstimator(DonaldsonSettings(draws=0, shapes=shapes))
        wrong = np.array([one.matrix for one in estimator.estimate_batch(given)]) - truth
        on = np.einsum("bii->bi", wrong)
        found.append([(wrong[:, BELOW] ** 2).mean(axis=1), (on**2).mean(axis=1)])
    ratio = np.log(np.array(found[0]) / np.array(found[1])).mean(axis=1)
    cells, reflectance = np.exp(0.5 * ratio)
    return float(cells), float(reflectance)


def test_dips_of_the_reflectance_tell_of_the_excitation() -> None:
    """Published dyes in coloured bases; the control has every reflectance of another material."""
    own = np.array([each.physical().matrix for each in fluorescent_population(24, seed=7)])
    other, on = own.copy(), np.arange(31)
    other[:, on, on] = np.roll(own[:, on, on], 1, axis=0)
    cells, reflectance = relative_error(own)
    assert cells < 0.85
    assert reflectance < 0.9
    assert relative_error(other)[0] > 0.95
