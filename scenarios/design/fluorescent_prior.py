"""What the estimator `donaldson` knows beforehand, linearised about each material of a population.

    cells = sum_k em_k(o) ex_k(i; t)  +  Gaussian background  +  reflectance in neighbouring cells

The products are fitted to the true matrix (not to captures) and linearised in their whitened
parameters t ~ N(0, 1); with the background this gives, for every material and number of products,
one Gaussian prior of the 465 + 31 cells: mean m(t0) - J t0, covariance J J^T + background. A set-up
then only sees this prior through its lights and channels (Rasmussen and Williams 2006, section 2.2;
the expansion of the products as Laplace's approximation in MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.fluorescence.background import BackgroundPrior, Kernels, kernels
from estimators.fluorescence.cells import Cells
from estimators.fluorescence.donaldson import DonaldsonSettings
from estimators.fluorescence.products import Products, ShapePrior
from estimators.fluorescence.search import ALONE
from twin.errors import InputError
from twin.fluorescence import DonaldsonMatrix
from twin.spectra import FloatArray

FIT_NOISE = 1e-3
"""Standard deviation of a cell when products are fitted to a known matrix."""
LEFT_OVER = 3e-4
"""RMSE of the cells that products leave: above it another product is tried."""
STEPS = 40
DIFFERENCE = 1e-4
KNOWN = DonaldsonSettings(
    draws=0,
    shapes=ShapePrior(
        emission_log_width=(4.09, 0.35), emission_skew=(0.25, 0.25),
        excitation_log_width=(5.0, 0.4), excitation_skew=(-0.1, 0.3), deviation=(0.4, 0.4),
        dip=(0.0, 0.0),
    ),
    background=BackgroundPrior(reflectance=((0.4, 50.0),)),
)  # fmt: skip
"""Of the estimator that is predicted and simulated. Its own shapes are broader by now, and it knows
that dyes take from the reflectance: its errors are about a tenth smaller, with a chip those of the
reflectance a quarter. About such shapes one linear step overshoots for few lights, and where it
prefers fewer products than there are, the prediction does not know."""


@dataclass(frozen=True, eq=False)
class LinearPrior:
    """A Gaussian prior of one material's cells; roughness of single cells comes on top.

    Attributes:
        products: how many were linearised.
        mean: of fluorescence cells and diagonal, (C + D,).
        covariance: (C + D, C + D).
        jacobian: of the fluorescence cells by the products' whitened parameters, (C, K P).
        parameters: where they were linearised, (K, P).
    """

    products: int
    mean: FloatArray
    covariance: FloatArray
    jacobian: FloatArray
    parameters: FloatArray


@dataclass(frozen=True, eq=False)
class Population:
    """Materials with the priors about them.

    Attributes:
        materials: B matrices on common wavelengths.
        cells: the unknowns, C + D.
        truth: (B, C + D).
        priors: for each material, with 1, 2 ... products, as many as its cells need.
        smooth: covariance without products, as at the estimator's first pass, (C + D, C + D);
            mean: its mean, (C + D,).
        roughness: standard deviations that the evidence chooses from.
    """

    materials: tuple[DonaldsonMatrix, ...]
    cells: Cells
    truth: FloatArray
    priors: tuple[tuple[LinearPrior, ...], ...]
    smooth: FloatArray
    mean: FloatArray
    roughness: tuple[float, ...]
    model: Products

    @property
    def size(self) -> int:
        """Number of fluorescence cells, C."""
        return self.cells.emission.size

    @cached_property
    def floor(self) -> FloatArray:
        """RMSE of predicting no fluorescence, (B,)."""
        return np.asarray(np.sqrt((self.truth[:, : self.size] ** 2).mean(axis=1)))


def vectors(cells: Cells, matrices: FloatArray) -> FloatArray:
    """Fluorescence cells and diagonal (..., C + D) of matrices (..., Wo, Wi)."""
    return np.concatenate(
        [matrices[..., cells.below_diagonal], matrices[..., cells.diagonal[0], cells.diagonal[1]]],
        axis=-1,
    )


def linearised_population(
    materials: Sequence[DonaldsonMatrix], *, settings: DonaldsonSettings | None = None
) -> Population:
    """Fit products to every material and expand the estimator's prior about them.

    Args:
        materials: B matrices, all on the same wavelengths.
        settings: of the estimator whose accuracy is predicted; None: `KNOWN`.

    Raises:
        InputError: no material, or other wavelengths than the first.
    """
    if not materials:
        raise InputError("no material", "one or more", place="population")
    settings = settings or KNOWN
    first = materials[0]
    for each in materials:
        same = np.array_equal(each.emission_nm, first.emission_nm)
        if not same or not np.array_equal(each.excitation_nm, first.excitation_nm):
            raise InputError(
                f"{each.name!r} on other wavelengths than {first.name!r}",
                "one set of wavelengths", place="population",
            )  # fmt: skip
    cells = Cells(first.emission_nm, first.excitation_nm)
    physical = np.array([each.physical().matrix for each in materials])
    truth = vectors(cells, physical)
    prior, known = settings.background, kernels(cells, settings.background)
    model = Products(np.zeros((1, *cells.below_diagonal.shape)), cells, settings.shapes)
    count = cells.emission.size
    found: list[list[LinearPrior]] = [[] for _ in materials]
    level = np.full(truth.shape[1], prior.reflectance_mean)
    level[:count] = 0.0
    start = np.zeros((len(truth), 0, model.size))
    needed = np.arange(len(truth))
    for number in range(1, settings.products + 1):
        if needed.size == 0:
            break
        parameters = _best(model, truth[needed, :count], start)
        value, jacobian = _expanded(model, parameters)
        for row, index in enumerate(needed):
            mean = level.copy()
            mean[:count] = value[row] - jacobian[row] @ parameters[row].reshape(-1)
            covariance = _background(known, prior, truth[index], settings.amplitudes[-1])
            around = np.minimum(value[row], 1.0) * prior.local
            local = np.outer(around, around) * known.local
            covariance[:count, :count] += jacobian[row] @ jacobian[row].T + local
            found[index].append(
                LinearPrior(number, mean, covariance, jacobian[row], parameters[row])
            )
        # A product more is for what is left over; the estimator rarely takes one for nothing.
        more = ((value - truth[needed, :count]) ** 2).mean(axis=1) > LEFT_OVER**2
        needed, start = needed[more], parameters[more]
    usual = np.where(np.arange(truth.shape[1]) < count, 0.0, prior.reflectance_mean)
    smooth = _background(known, prior, usual, ALONE)
    return Population(
        tuple(materials), cells, truth, tuple(tuple(each) for each in found), smooth, level,
        prior.roughness, model,
    )  # fmt: skip


def _background(
    known: Kernels, prior: BackgroundPrior, truth: FloatArray, amplitude: float
) -> FloatArray:
    """Covariance (C + D, C + D) of all but products and roughness."""
    count = len(known.cell)
    out = np.zeros((truth.size, truth.size))
    out[:count, :count] = amplitude**2 * known.cell
    out[count:, count:] = known.diagonal
    scale = known.neighbour @ np.clip(truth[count:], 0.01, 1.0)
    out[np.ix_(known.near, known.near)] += scale[:, None] * known.leak * scale
    return out


def _expanded(model: Products, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cells (B, C) of parameters (B, K, P) and their derivatives (B, C, K P)."""
    batch, products, size = t.shape
    value = model.fluorescence(t)
    moved = t[:, None] + DIFFERENCE * np.eye(products * size).reshape(-1, products, size)
    shifted = model.fluorescence(moved.reshape(-1, products, size)).reshape(batch, -1, len(value.T))
    return value, np.ascontiguousarray((shifted - value[:, None]).transpose(0, 2, 1) / DIFFERENCE)


def _best(model: Products, target: FloatArray, before: FloatArray) -> FloatArray:
    """One product more (B, K + 1, P) than before (B, K, P): the better of two starts."""
    left = target - (model.fluorescence(before) if before.shape[1] else 0.0)
    grid = model.cells
    trials = []
    starts = [left]
    if before.shape[1] == 1:
        # Peaks of excitation on either side of the middle of what fluoresces.
        middle = (target * grid.excitation).sum(axis=1) / np.maximum(target.sum(axis=1), 1e-12)
        low = target * (grid.excitation <= middle[:, None])
        high = target * (grid.excitation > middle[:, None])
        starts.append(low)
    for number, values in enumerate(starts):
        grown = np.concatenate([before, _at_peak(model, values)[:, None]], axis=1)
        if number == 1:
            grown = np.stack([_at_peak(model, low), _at_peak(model, high)], axis=1)
        trials.append(_fitted(model, target, grown))
    cost = np.array([each[1] for each in trials])
    points = np.array([each[0] for each in trials])
    return np.asarray(points[cost.argmin(axis=0), np.arange(len(target))])


def _at_peak(model: Products, values: FloatArray) -> FloatArray:
    """Start (B, P) at the largest of the cells (B, C)."""
    top = values.argmax(axis=1)
    emission = model.cells.emission[top]
    peak = np.maximum(values.max(axis=1), 1e-4)
    return model.start(peak, emission, emission - model.cells.excitation[top])


def _fitted(
    model: Products, target: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Maximum a posteriori parameters (B, K, P) given the cells (B, C), and the cost (B,).

    Source: Levenberg 1944, Marquardt 1963.
    """
    shape, batch = start.shape, len(start)
    t = start.reshape(batch, -1).copy()
    damping = np.full(batch, 1e-1)
    diagonal = np.arange(t.shape[1])

    def cost_of(points: FloatArray) -> FloatArray:
        value = model.fluorescence(points.reshape(shape))
        square = ((value - target) ** 2).sum(axis=1) / FIT_NOISE**2
        return np.asarray(square + (points**2).sum(axis=1))

    cost = cost_of(t)
    for _ in range(STEPS):
        value, jacobian = _expanded(model, t.reshape(shape))
        transposed = jacobian.transpose(0, 2, 1) / FIT_NOISE**2
        system = transposed @ jacobian
        gradient = np.einsum("bpc,bc->bp", transposed, target - value) - t
        system[:, diagonal, diagonal] = (system[:, diagonal, diagonal] + 1.0) * (
            1.0 + damping[:, None]
        )
        step = np.linalg.solve(system, gradient[..., None])[..., 0]
        step *= np.minimum(1.0, 2.0 / np.maximum(np.abs(step).max(axis=1), 1e-9))[:, None]
        tried = cost_of(t + step)
        better = tried < cost
        t[better] += step[better]
        cost = np.where(better, tried, cost)
        damping = np.clip(damping * np.where(better, 0.2, 5.0), 1e-7, 1e7)
    return t.reshape(shape), cost
