"""Whether what is left after the best explanation is noise.

Several quadratic forms of the reduced residual are tested together, from the whole chi-square to
deviations that are smooth over wavelength, to what repeats, samples or captures share (fringes,
lines, scales), and a scan over single blocks; the smallest of their p-values is calibrated by
simulation, so that looking in many ways costs what it should. The effects' own directions are
projected out first: the rest is normal whatever their values are. Choosing the effects by the same
data only makes the rest smaller, the test conservative.

What lies in the span of the material's Jacobian, or of the accepted effects, is invisible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from diagnosis.calibration import generator_of
from diagnosis.problem import Problem
from diagnosis.refit import Fit
from diagnosis.unknown import FLOOR, polynomials, smooth_columns
from twin.spectra import FloatArray

DRAWS = 1000
CHUNK = 250
SIGNIFICANT = 0.01
SHARED = ("capture", "all")
"""Of the looks: what several samples or captures share is a factor on their light, however dark."""


@dataclass(frozen=True)
class Adequacy:
    """What is left after an explanation.

    Attributes:
        p: probability of a rest that looks worse in any way, if only noise is left.
        tests: (name, statistic, degrees of freedom, own p) of every look.
        chi_square: of the whole rest.
        freedom: its degrees of freedom.
    """

    p: float
    tests: tuple[tuple[str, float, int, float], ...]
    chi_square: float
    freedom: int

    @property
    def enough(self) -> bool:
        """Whether the explanation is enough."""
        return self.p >= SIGNIFICANT


def _calibrated(seen: float, smallest: FloatArray) -> float:
    """Probability of a p-value as small as the smallest of the looks, of sorted simulated ones.

    Below a hundredth few were simulated, and it goes on in proportion: looks that overlap are
    worth as many independent ones as they are at 1 %.
    """
    rare = float(np.quantile(smallest, 0.01))
    if seen < rare:
        return max(0.01 * seen / rare, 1e-300)
    return (1 + int(np.searchsorted(smallest, seen, side="right"))) / (1 + len(smallest))


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the span of columns, shape (n, rank)."""
    if not columns.shape[1]:
        return columns
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 1e-9 * np.max(size, initial=1e-300)]
    scaled = scaled / np.linalg.norm(scaled, axis=0)
    # By the small Gram matrix: a tall singular value decomposition takes ten times as long.
    value, vector = np.linalg.eigh(scaled.T @ scaled)
    kept = value > 1e-9 * value[-1]
    return np.asarray(scaled @ (vector[:, kept] / np.sqrt(value[kept])))


def off(columns: FloatArray, basis: FloatArray) -> FloatArray:
    """Columns with the directions of a basis taken off."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def adequacy(problem: Problem, found: Fit, *, seed: int = 0, draws: int = DRAWS) -> Adequacy:
    """Test the residual of a fit."""
    own = orthonormal(found.columns)
    reduction = found.reduction
    freedom = reduction.freedom - own.shape[1]
    looks: list[tuple[str, FloatArray]] = []
    several, every = len(problem.repeats) > 1, np.eye(len(problem.wavelength_nm))
    for name, by, functions in (
        ("level of a block", "block", polynomials(problem.wavelength_nm, 1)),
        ("smooth over wavelength", "block", polynomials(problem.wavelength_nm, 3)),
        ("structured over wavelength", "block", polynomials(problem.wavelength_nm, 8)),
        # noise is another in every repeat; what is wrong with a bench is not
        ("alike in all repeats", "block", every if several else None),
        # lamps, films and scales act on all samples of a capture, a detector on all captures
        ("alike in all samples", "capture", every),
        ("alike in all captures", "all", every),
        ("by repeat", "capture_repeat", polynomials(problem.wavelength_nm, 2) if several else None),
    ):
        if functions is not None and not (by in SHARED and problem.one_material):
            floor = 0.0 if by in SHARED else FLOOR
            columns = smooth_columns(problem, found.predicted, functions, by=by, floor=floor)
            looks.append((name, orthonormal(off(reduction(columns), own))))
    shapes = polynomials(problem.wavelength_nm, 4)
    scan = off(reduction(smooth_columns(problem, found.predicted, shapes)), own)
    size = np.linalg.norm(scan, axis=0)
    scan = scan[:, size > 1e-6 * np.max(size, initial=1e-300)]
    scan = scan / np.linalg.norm(scan, axis=0)

    def statistics(flat: FloatArray) -> FloatArray:
        rows = [np.sum(off(flat, own) ** 2, axis=0)]
        rows += [np.sum((basis.T @ flat) ** 2, axis=0) for _, basis in looks]
        rows.append(np.max((scan.T @ flat) ** 2, axis=0, initial=0.0))
        return np.array(rows)

    generator = generator_of(seed, 2)
    null = np.concatenate(
        [
            statistics(reduction.simulate(generator, min(CHUNK, draws - start)))
            for start in range(0, draws, CHUNK)
        ],
        axis=1,
    )
    observed = statistics(found.residual[:, None])
    freedoms = [freedom, *(basis.shape[1] for _, basis in looks), 1]
    degrees = np.array(freedoms)[:, None]

    def own_p(value: FloatArray) -> FloatArray:
        result: FloatArray = np.array(chi2.sf(value, np.maximum(degrees, 1)))
        # The scan is a maximum: its own distribution is the simulated one.
        ordered = np.sort(null[-1])
        result[-1] = (draws - np.searchsorted(ordered, value[-1], side="left") + 1) / (draws + 1)
        return result

    smallest = np.sort(own_p(null).min(axis=0))
    seen = own_p(observed)[:, 0]
    names = ["everything", *(name for name, _ in looks), "scan over blocks"]
    return Adequacy(
        p=_calibrated(float(seen.min()), smallest),
        tests=tuple(
            (name, float(observed[i, 0]), freedoms[i], float(seen[i]))
            for i, name in enumerate(names)
        ),
        chi_square=float(observed[0, 0]),
        freedom=freedom,
    )
