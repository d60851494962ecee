"""Smooth spectra: albedo, sigma_t and g through knots, all wavelengths and captures at once.

The coordinates of the three parameters are natural cubic splines through knots that lie evenly
over the wavelengths. The priors hold at the knots. Nuisances, and the engine's own error of every
capture, are common to all wavelengths and integrated out in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.posterior_box import FIRST_HALF_WIDTH, Box, bending
from estimators.posterior_coordinates import (
    Coordinates,
    coarse,
    random_state,
    wavelength_stream,
)
from estimators.posterior_emulator import Emulator, Source, emulators
from estimators.posterior_engine import Engine
from estimators.posterior_local import CHECKS, Local, Whitened
from estimators.posterior_mode import ITERATIONS, Mode
from estimators.posterior_sampler import LogProbability, Student, sample
from estimators.posterior_settings import PosteriorSettings
from estimators.posterior_shared import Shared, spline_basis
from twin.spectra import FloatArray

JOINT = 4
"""Purpose of the stream of random numbers."""
PILOT_STEPS = 200
TORN = 0.001


class _Stack:
    """The emulators of all wavelengths, evaluated side by side."""

    def __init__(self, fitted: list[Emulator]) -> None:
        terms = max(len(e.term) for e in fitted)
        count, size = len(fitted), fitted[0].term.shape[1]
        self.term = np.zeros((count, terms, size))
        degree = np.zeros((count, terms, 3), dtype=np.intp)
        for w, e in enumerate(fitted):
            self.term[w, : len(e.term)] = e.term
            degree[w, : len(e.degree)] = e.degree
        self.orders = int(degree.max()) + 1
        # Where to find the three polynomials of every term in a table (W, 3, orders), flat.
        place = (np.arange(count)[:, None, None] * 3 + np.arange(3)) * self.orders + degree
        self.place = place.transpose(2, 0, 1)
        self.centre = np.stack([e.box.centre for e in fitted])
        self.inverse = np.stack([np.linalg.inv(e.box.axes) for e in fitted])
        self.bend = np.stack([e.box.bend for e in fitted])
        self.middle = np.stack([0.5 * (e.box.low + e.box.high) for e in fitted])
        self.half = np.stack([0.5 * (e.box.high - e.box.low) for e in fitted])

    def __call__(self, x: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Whitened captures (K, W * M) of coordinates (K, W, 3), and whether all are inside."""
        t = np.einsum("wij,kwj->kwi", self.inverse, x - self.centre)
        t[..., 0] -= np.einsum("kwp,wp->kw", bending(t), self.bend)
        unit = (t - self.middle) / self.half
        inside = (np.abs(unit) <= 1.0).all(axis=(1, 2))
        angle = np.arccos(np.clip(unit, -1.0, 1.0))
        table = np.cos(angle[..., None] * np.arange(self.orders)).reshape(len(x), -1)
        a, b, c = self.place
        basis = table[:, a] * table[:, b] * table[:, c]
        value = np.matmul(basis.transpose(1, 0, 2), self.term).transpose(1, 0, 2)
        return value.reshape(len(x), -1), inside


def sample_jointly(
    engine: Engine,
    coordinates: Coordinates,
    settings: PosteriorSettings,
    whitened: Whitened,
    mode: Mode,
    relative_error: FloatArray,
) -> tuple[list[Local], tuple[str, ...], NDArray[np.bool_]]:
    """One chain of all wavelengths together.

    Args:
        engine: the engine, at W wavelengths.
        coordinates: priors.
        settings: options.
        whitened: captures by their noise without common errors.
        mode: the most probable materials of every wavelength for itself.
        relative_error: the engine's own, (S, 3).

    Returns:
        The chain by wavelength, messages, and whether the smooth spectra contradict the
        captures, (W,), all alike.

    Raises:
        InputError: fewer wavelengths than knots.
    """
    from scipy.special import chdtri

    wavelength = engine.model.wavelength_nm[list(engine.wanted)]
    basis = spline_basis(wavelength, settings.knots)
    fit = _Fit(engine, coordinates, whitened, basis)
    theta = fit.start(mode)
    theta, shared, precision, chi_square = fit.settle(theta, settings, relative_error)
    freedom = max(int((whitened.white != 0.0).any(axis=2).sum()) - theta.size, 1)
    torn = bool(chi_square > chdtri(freedom, TORN))
    messages: tuple[str, ...] = ()
    scale = 1.0
    if torn:
        scale = float(coarse(np.array(chi_square / freedom)))
        messages = (
            f"joint spectra of {settings.knots} knots: chi-square {chi_square:.4g} with {freedom}"
            " degrees of freedom, the noise was widened by its root; take more knots, or look"
            " for an effect that the bench description lacks",
        )
    inverse = np.linalg.inv(fit.precision_of(precision, theta, scale))
    covariance: FloatArray = np.asarray(inverse, dtype=np.float64)
    centre = coarse(theta, 30)
    source = Source(engine, coordinates, whitened.white)
    boxes = []
    for w in range(len(basis)):
        spread = np.kron(basis[w], np.eye(3))
        own = spread @ covariance @ spread.T + 1e-14 * np.eye(3)
        boxes.append(Box.laplace(basis[w] @ centre.reshape(-1, 3), own, FIRST_HALF_WIDTH + 1.0))
    stream = wavelength_stream(settings.seed, wavelength[0], JOINT)
    walkers = max(settings.walkers, 2 * (-(-3 * theta.size // 2)))
    proposal = Student.normal(centre, covariance)
    first = centre + stream.standard_normal((walkers, theta.size)) @ proposal.factor.T * 0.7
    checks = np.clip(stream.standard_normal((CHECKS, len(basis), 3)), -2.5, 2.5)
    for last in (False, True):
        fitted = emulators(source, boxes, checks, settings.emulator_tolerance)
        log_prob = _log_probability(coordinates, _Stack(fitted), whitened, basis, shared, scale)
        chain = sample(
            log_prob,
            first,
            random_state(stream),
            proposal=proposal,
            burn_in=PILOT_STEPS // 2,
            effective_samples=settings.effective_samples,
            steps=settings.steps if last else PILOT_STEPS,
        )
        flat = chain.values.reshape(-1, settings.knots, 3)
        x = np.einsum("wk,dkp->dwp", basis, flat)
        first = flat[stream.permutation(len(flat))[:walkers]].reshape(walkers, -1)
        if not last:
            every = [box.t(x[:, w]) for w, box in enumerate(boxes)]
            sides = [box.touched_sides(t) for box, t in zip(boxes, every, strict=True)]
            boxes = [Box.around(x[:, w], side) for w, side in enumerate(sides)]
            picked = x[np.linspace(0, len(x) - 1, CHECKS).astype(np.intp)]
            checks = np.stack([box.t(picked[:, w]) for w, box in enumerate(boxes)], axis=1)
    picked = x[np.linspace(0, len(x) - 1, CHECKS).astype(np.intp)]
    truth = source.outputs(picked)
    shape = chain.values.shape[:2]
    found = []
    for w, emulator in enumerate(fitted):
        error = float(np.abs(emulator(emulator.box.t(picked[:, w])) - truth[:, w]).max())
        touched = bool(emulator.box.touched_sides(emulator.box.t(x[:, w])).any())
        by = x[:, w].reshape(*shape, 3)
        found.append(Local(by, np.empty((*shape, 0)), chain, error, False, touched))
    return found, messages, np.full(len(basis), torn)


def _log_probability(
    coordinates: Coordinates,
    stack: _Stack,
    whitened: Whitened,
    basis: FloatArray,
    shared: Shared,
    scale: float,
) -> LogProbability:
    target = whitened.value.reshape(-1)
    knots = basis.shape[1]

    def of(theta: FloatArray) -> FloatArray:
        at_knots = theta.reshape(len(theta), knots, 3)
        value, inside = stack(np.matmul(basis, at_knots))
        score = -0.5 / scale * shared.chi_square(value - target)
        score += coordinates.log_prior(at_knots).sum(axis=1)
        return np.where(inside, score, -np.inf)

    return of


class _Fit:
    """The most probable knots, by Levenberg-Marquardt on the engine itself."""

    def __init__(
        self, engine: Engine, coordinates: Coordinates, whitened: Whitened, basis: FloatArray
    ) -> None:
        self.engine, self.coordinates, self.basis = engine, coordinates, basis
        self.whitened = whitened

    def start(self, mode: Mode) -> FloatArray:
        """Knots (3 K,) nearest to the modes of every wavelength in their own metric."""
        knots = self.basis.shape[1]
        normal = np.einsum("wk,wpq,wl->kplq", self.basis, mode.precision, self.basis)
        right = np.einsum("wk,wpq,wq->kp", self.basis, mode.precision, mode.x)
        flat = normal.reshape(3 * knots, 3 * knots)
        ridge = 1e-6 * np.diag(np.diagonal(flat))
        return np.asarray(np.linalg.solve(flat + ridge, right.reshape(-1)))

    def _shared(
        self, x: FloatArray, settings: PosteriorSettings, relative_error: FloatArray
    ) -> Shared:
        material = self.coordinates.material(x)
        slopes = self.engine.nuisance_slopes(material[None], settings)[0]
        own = relative_error.reshape(-1) * self.engine.at(material[None])[0]
        every = np.concatenate([slopes, own[:, :, None] * np.eye(own.shape[1])], axis=-1)
        return Shared.of(self.whitened.white @ every)

    def settle(
        self, theta: FloatArray, settings: PosteriorSettings, relative_error: FloatArray
    ) -> tuple[FloatArray, Shared, FloatArray, float]:
        """Knots, common errors there, curvature without the prior, chi-square."""
        for _ in range(2):
            shared = self._shared(self._x(theta), settings, relative_error)
            theta, precision, chi_square = self._climb(theta, shared)
        return theta, shared, precision, chi_square

    def _x(self, theta: FloatArray) -> FloatArray:
        return self.basis @ theta.reshape(-1, 3)

    def precision_of(self, precision: FloatArray, theta: FloatArray, scale: float) -> FloatArray:
        """Curvature of minus the log posterior."""
        total = precision / scale
        for k, block in enumerate(self.coordinates.prior_precision(theta.reshape(-1, 3))):
            total[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += block
        return np.asarray(total)

    def _climb(self, theta: FloatArray, shared: Shared) -> tuple[FloatArray, FloatArray, float]:
        damping = 1e-3
        here = self._at(theta, shared)
        for _ in range(ITERATIONS):
            score, precision, gradient, _ = here
            matrix = self.precision_of(precision, theta, 1.0)
            matrix = matrix + damping * np.diag(np.diagonal(matrix))
            step = np.clip(-np.linalg.solve(matrix, gradient), -2.0, 2.0)
            there = self._at(theta + step, shared)
            if there[0] < score:
                theta, here, damping = theta + step, there, damping * 0.2
                if score - there[0] < 1e-7 * (1.0 + abs(score)):
                    break
            else:
                damping *= 8.0
                if damping > 1e8:
                    break
        return theta, here[1], here[3]

    def _at(self, theta: FloatArray, shared: Shared) -> tuple[float, FloatArray, FloatArray, float]:
        x = self._x(theta)
        captures, slope = self.engine.with_jacobian(self.coordinates.material(x))
        white = self.whitened.white
        residual = np.einsum("wij,wj->wi", white, captures) - self.whitened.value
        slope = white @ slope @ self.coordinates.slopes(x)
        jacobian = np.einsum("wip,wk->wikp", slope, self.basis).reshape(residual.size, -1)
        weighed = shared.weighed(jacobian)
        at_knots = theta.reshape(-1, 3)
        chi_square = float(shared.chi_square(residual.reshape(1, -1))[0])
        gradient = weighed.T @ residual.reshape(-1) - self.coordinates.prior_gradient(
            at_knots
        ).reshape(-1)
        score = 0.5 * chi_square - float(self.coordinates.log_prior(at_knots).sum())
        return score, jacobian.T @ weighed, gradient, chi_square
