"""Evidence against numerical integration; orthant probabilities against sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal, norm

from diagnosis.evidence import SCALES, WEIGHTS, Scores, bivariate, log_evidence, log_orthant


def integrated(gram, inner, positive):
    """Mixture over prior scales of the likelihood ratio's mean under the prior."""
    size = len(inner)
    total = 0.0
    for scale, weight in zip(SCALES, WEIGHTS, strict=True):

        def integrand(*a, scale=scale):
            a = np.array(a[::-1])
            prior = np.prod(norm.pdf(a / scale) / scale * np.where(positive, 2.0, 1.0))
            return prior * np.exp(inner @ a - 0.5 * a @ gram @ a)

        low = [0.0 if p else -9 * scale for p in positive]
        if size == 1:
            value = quad(integrand, low[0], 9 * scale, limit=200)[0]
        else:
            value = dblquad(integrand, low[0], 9 * scale, low[1], 9 * scale, epsabs=1e-7)[0]
        total += weight * value
    return np.log(total)


@pytest.mark.parametrize("positive", [(False,), (True,)])
@pytest.mark.parametrize("inner", [2.0, -1.5])
def test_single_evidence_is_the_integral(positive, inner):
    gram, vector = np.array([[1.7]]), np.array([inner])
    scores = Scores(gram, vector[None], np.array(positive), ((0,),))
    found = log_evidence(scores, [(0,)])[0, 0]
    assert found == pytest.approx(integrated(gram, vector, positive), abs=1e-6)


@pytest.mark.parametrize("positive", [(True, False), (True, True)])
def test_pair_evidence_is_the_integral(positive):
    gram, inner = np.array([[1.2, 0.7], [0.7, 0.9]]), np.array([0.6, -0.4])
    scores = Scores(gram, inner[None], np.array(positive), ((0,), (1,)))
    found = log_evidence(scores, [(0, 1)])[0, 0]
    assert found == pytest.approx(integrated(gram, inner, positive), abs=2e-4)


@pytest.mark.parametrize("rho", [-0.95, -0.3, 0.0, 0.6, 0.99])
@pytest.mark.parametrize(("h", "k"), [(0.3, 1.2), (-1.0, 0.5), (2.0, -2.0), (0.0, 0.0)])
def test_bivariate_orthant_is_that_of_scipy(h, k, rho):
    expected = multivariate_normal(cov=[[1, rho], [rho, 1]]).cdf([h, k])
    assert float(bivariate(np.array(h), np.array(k), np.array(rho))) == pytest.approx(
        expected, abs=2e-6
    )


def test_tiny_orthants_keep_their_logarithm():
    """A wrong sign must cost what it gains, at any number of standard deviations."""
    height = np.array([-12.0, 3.0])
    found = float(log_orthant(height, np.eye(2)))
    assert found == pytest.approx(norm.logcdf(-12) + norm.logcdf(3), rel=1e-6)


def test_three_signed_parameters_are_approximated_well():
    correlation = np.array([[1, 0.4, 0.2], [0.4, 1, -0.3], [0.2, -0.3, 1]])
    height = np.array([0.5, -0.4, 1.0])
    exact = multivariate_normal(cov=correlation).cdf(height)
    assert np.exp(float(log_orthant(height, correlation))) == pytest.approx(exact, rel=0.03)


def test_a_signed_effect_of_the_wrong_sign_has_no_evidence():
    gram = np.array([[100.0]])
    for turn, more in ((1.0, True), (-1.0, False)):
        scores = Scores(gram, np.array([[turn * 80.0]]), np.array([True]), ((0,),))
        assert (log_evidence(scores, [(0,)])[0, 0] > 0) == more
