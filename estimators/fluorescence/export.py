"""An estimate as Gaussians and moments: the form that the published method gives its results in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estimators.fluorescence.result import FluorescenceResult
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.fluorescence.mixture import MixtureModel

MOMENTS = 8
_FIRST_VARIANCE = 900.0
_SMALLEST_VARIANCE, _LARGEST_VARIANCE = 100.0, 4e4


def mixture_of(result: FluorescenceResult, gaussians: int = 6, *, rounds: int = 40) -> MixtureModel:
    """Gaussians fitted to the cells of an estimate, and the MESE moments of its diagonal.

    Variable projection (Golub and Pereyra 1973, in Kaufman's approximation): weights come from
    non-negative least squares, means and variances from Gauss-Newton steps on what is left. Each
    Gaussian starts at the largest cell that those before do not explain. A result that has a
    mixture of its own keeps it.

    Args:
        result: any estimate.
        gaussians: how many.
        rounds: most Gauss-Newton steps.

    Raises:
        InputError: fewer than one Gaussian.
    """
    if gaussians < 1:
        raise InputError(f"{gaussians} Gaussians", "one or more", place="gaussians")
    if result.mixture is not None and len(result.mixture.gaussians) == gaussians:
        return result.mixture
    from twin.fluorescence.mese import moments
    from twin.fluorescence.mixture import Gaussian, MixtureModel

    grid = result.emission_nm[:, None], result.excitation_nm[None, :]
    mask = np.asarray(grid[0] > grid[1] + 1e-6)
    target = result.fluorescence[mask]
    out, into = (np.broadcast_to(each, mask.shape)[mask] for each in grid)
    shape = np.zeros((0, 4))
    left = target
    for _ in range(gaussians):
        top = int(left.argmax())
        new = [into[top], out[top], _FIRST_VARIANCE, _FIRST_VARIANCE]
        shape = np.concatenate([shape, [new]])
        shape, weight = _improve(shape, target, into, out, rounds)
        left = target - _columns(shape, into, out) @ weight
    area = 2.0 * np.pi * np.sqrt(shape[:, 2] * shape[:, 3])
    span = (float(result.emission_nm[0]), float(result.emission_nm[-1]))
    on = result.emission_nm[np.nonzero(result.is_diagonal)[0]]
    moment = moments(
        result.reflectance, MOMENTS, wavelength_nm=on, range_nm=(float(on[0]), float(on[-1]))
    )
    return MixtureModel(
        name=result.sample,
        bin_nm=float(result.emission_nm[1] - result.emission_nm[0]),
        range_nm=(float(on[0]), float(on[-1])) if on.size else span,
        gaussians=tuple(
            Gaussian(
                weight=float(w * a), excitation_nm=float(p[0]), emission_nm=float(p[1]),
                excitation_variance_nm2=float(p[2]), emission_variance_nm2=float(p[3]),
            )
            for w, a, p in zip(weight, area, shape, strict=True)
        ),
        moments=tuple(float(c) for c in np.asarray(moment)),
    )  # fmt: skip


def _columns(shape: FloatArray, into: FloatArray, out: FloatArray) -> FloatArray:
    """Gaussians of peak 1 at the cells, (C, M)."""
    x = (into[:, None] - shape[:, 0]) ** 2 / shape[:, 2]
    y = (out[:, None] - shape[:, 1]) ** 2 / shape[:, 3]
    return np.asarray(np.exp(-0.5 * (x + y)))


def _improve(
    shape: FloatArray, target: FloatArray, into: FloatArray, out: FloatArray, rounds: int
) -> tuple[FloatArray, FloatArray]:
    from scipy.optimize import nnls

    def evaluate(trial: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        columns = _columns(trial, into, out)
        weight = np.asarray(nnls(columns, target)[0], dtype=np.float64)
        return columns, weight, float(((target - columns @ weight) ** 2).sum())

    columns, weight, cost = evaluate(shape)
    damping = 1e-2
    for _ in range(rounds):
        x, y = into[:, None] - shape[:, 0], out[:, None] - shape[:, 1]
        scaled = columns * weight
        # Variances are stepped in their logarithm.
        jacobian = np.stack(
            [
                scaled * x / shape[:, 2], scaled * y / shape[:, 3],
                0.5 * scaled * x**2 / shape[:, 2], 0.5 * scaled * y**2 / shape[:, 3],
            ],
            axis=2,
        ).reshape(len(target), -1)  # fmt: skip
        used, _ = np.linalg.qr(columns)
        jacobian -= used @ (used.T @ jacobian)
        system = jacobian.T @ jacobian
        ridge = damping * np.diagonal(system) + 1e-12 * max(float(np.trace(system)), 1e-30)
        step = np.linalg.solve(
            system + np.diag(ridge), jacobian.T @ (target - columns @ weight)
        ).reshape(-1, 4)
        trial = shape.copy()
        trial[:, :2] += np.clip(step[:, :2], -30.0, 30.0)
        trial[:, :2] = np.clip(trial[:, :2], into.min() - 100.0, out.max() + 100.0)
        trial[:, 2:] *= np.exp(np.clip(step[:, 2:], -0.5, 0.5))
        trial[:, 2:] = np.clip(trial[:, 2:], _SMALLEST_VARIANCE, _LARGEST_VARIANCE)
        found = evaluate(trial)
        if found[2] < cost:
            done = cost - found[2] < 1e-5 * cost
            shape, (columns, weight, cost) = trial, found
            damping = max(damping / 5.0, 1e-8)
            if done:
                break
        elif damping > 1e4:
            break
        else:
            damping *= 5.0
    return shape, weight
