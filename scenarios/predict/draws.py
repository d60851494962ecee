"""Draws of the optical properties behind an estimate: its posterior, or its covariance."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from estimators import EstimateResult, Status
from estimators.result import normal_deviate
from scenarios.predict.mixture import UncertainMedium
from twin.errors import InputError
from twin.spectra import FloatArray

DEFAULT_DRAWS = 200
LOWEST = np.array([0.0, 0.0, -0.999])
HIGHEST = np.array([1.0, np.inf, 0.999])
"""Physical bounds of (albedo, sigma_t, g); g as far as the light transport goes."""
WIDEST = np.array([3.0, np.inf, 6.0])
"""Standard errors beyond these are cut to them: inside the bounds both are uniform to 2 %."""
ROUNDS = 400


def medium_of(
    result: EstimateResult, *, count: int = DEFAULT_DRAWS, seed: int = 1, name: str = ""
) -> UncertainMedium:
    """The medium of an estimate, with draws for what follows from it.

    Posterior draws are used when the estimate has them, every k-th of them when there are more
    than asked for. Otherwise draws have the estimate's stated quantiles (normal ones where it
    states none) and the correlations of its covariance, truncated to albedo 0 to 1, sigma_t of
    at least 0 and |g| below 1, at each wavelength on its own.

    Args:
        result: the estimate.
        count: number of draws.
        seed: of the draws; the same seed, the same draws.
        name: of the medium; "" takes the estimator's.

    Returns:
        The medium. A wavelength is unknown where the status has no value, or a value or a
        covariance is not finite; how many and why is in the notes.

    Raises:
        InputError: no wavelength is known, or fewer than 2 draws are asked for.
    """
    if not 2 <= count <= 100_000:
        raise InputError(f"{count} draws", "2 to 100000", place="draws")
    value = result.parameters
    usable, notes = _usable(result)
    if not usable.any():
        why = ", ".join(f"{n} {status}" for status, n in result.counts().items())
        raise InputError(
            f"an estimate without albedo, sigma_t and g at any of its {len(usable)} wavelengths"
            f" ({why})",
            "an estimate of all three with their covariance",
            remedy="Estimate with an estimator that determines all three, such as lut.",
        )
    unsure = usable & ~result.identifiable.all(axis=-1)
    if unsure.any():
        notes.append(
            f"at {int(unsure.sum())} of {len(usable)} wavelengths the captures do not determine"
            " all of albedo, sigma_t and g; the wide intervals there weigh more in mixtures than in"
            " the material itself"
        )
    draws = np.full((count, *value.shape), np.nan)
    if result.draws is not None:
        picked = np.linspace(0, len(result.draws) - 1, min(count, len(result.draws)))
        draws = result.draws[picked.round().astype(int)].astype(np.float64)
        ordered = belongs_together(draws[:, usable])
        if not ordered:
            notes.append(
                "the posterior's draws at neighbouring wavelengths are uncorrelated: it was drawn"
                " for each wavelength alone"
            )
    else:
        ordered = False
        rng = np.random.Generator(np.random.Philox(key=[seed, len(usable)]))
        drawn, short = bounded_draws(
            rng,
            value[usable],
            result.covariance[usable],
            count,
            result.quantile[:, usable],
            result.quantile_level,
        )
        draws[:, usable] = drawn
        if short:
            notes.append(
                f"at {short} wavelengths the covariance reaches far outside the physical bounds;"
                " accepted draws are used several times there"
            )
    draws = np.where(usable[:, None], draws, np.nan)
    return UncertainMedium(
        name or result.estimator,
        np.array(result.wavelength_nm, dtype=np.float64),
        np.where(usable[:, None], value, np.nan),
        draws,
        ordered,
        tuple(notes),
    )


def _usable(result: EstimateResult) -> tuple[NDArray[np.bool_], list[str]]:
    """Wavelengths with a value and a covariance, and what to say of the others."""
    valued = np.array([Status(code).has_value for code in result.status])
    finite = np.isfinite(result.parameters).all(axis=-1)
    if result.draws is not None:
        finite &= np.isfinite(result.draws).all(axis=(0, 2))
    else:
        finite &= np.isfinite(result.covariance).all(axis=(1, 2))
    usable = valued & finite
    if usable.all():
        return usable, []
    why = Counter(Status(code).name.lower() for code in result.status[~valued])
    if (valued & ~finite).any():
        why["without a finite value and covariance"] = int((valued & ~finite).sum())
    listed = ", ".join(f"{number} {reason}" for reason, number in why.most_common())
    where = np.asarray(result.wavelength_nm)[~usable]
    return usable, [
        f"{int((~usable).sum())} of {len(usable)} wavelengths have no usable estimate ({listed}),"
        f" {where[0]:g} to {where[-1]:g} nm: nothing is predicted there"
    ]


def belongs_together(draws: FloatArray) -> bool:
    """Whether draws (D, W, 3) are correlated between neighbouring wavelengths.

    A posterior that was drawn for each wavelength alone has correlations of about 1/sqrt(D).
    """
    if len(draws) < 8 or draws.shape[1] < 2:
        return False
    spread = draws - draws.mean(axis=0)
    size = np.sqrt((spread**2).mean(axis=0))
    spread = np.divide(spread, size, out=np.zeros_like(spread), where=size > 0)
    neighbours = (spread[:, 1:] * spread[:, :-1]).mean(axis=0)
    return bool(np.median(np.abs(neighbours).max(axis=-1)) > 4.0 / np.sqrt(len(draws)))


def bounded_draws(
    rng: np.random.Generator,
    mean: FloatArray,
    covariance: FloatArray,
    count: int,
    quantile: FloatArray | None = None,
    level: FloatArray | None = None,
) -> tuple[FloatArray, int]:
    """Draws inside the physical bounds, by rejection.

    Args:
        rng: source of randomness.
        mean: shape (W, 3).
        covariance: shape (W, 3, 3); an eigenvalue below 0 counts as 0.
        count: D.
        quantile: stated quantiles of every parameter, shape (Q, W, 3); where all are finite they
            replace the normal ones, and the covariance gives the correlations alone (a normal
            copula: Nelsen 2006, An Introduction to Copulas, section 2.3). A draw beyond the
            outermost one takes its value.
        level: of the quantiles, shape (Q,).

    Returns:
        Draws, shape (D, W, 3), and the number of wavelengths at which too few were accepted, so
        that accepted ones (or the mean, where there is none) are repeated.
    """
    error = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    inverse = np.divide(1.0, error, out=np.zeros_like(error), where=error > 0)
    values, vectors = np.linalg.eigh(covariance * inverse[:, :, None] * inverse[:, None, :])
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    scale = np.minimum(error, WIDEST)
    stated: NDArray[np.bool_] = np.zeros(len(mean), dtype=bool)
    if quantile is not None and level is not None:
        stated = np.asarray(np.isfinite(quantile).all(axis=(0, 2)))
    drawn = np.empty((count, *mean.shape))
    filled = np.zeros(len(mean), dtype=int)
    for _ in range(ROUNDS):
        open_ = np.flatnonzero(filled < count)
        if open_.size == 0:
            break
        normal = rng.standard_normal((open_.size, count, 3))
        normal = np.einsum("wij,wdj->wdi", root[open_], normal)
        tried = mean[open_, None, :] + scale[open_, None, :] * normal
        for row, w in enumerate(open_):
            if stated[w] and quantile is not None and level is not None:
                tried[row] = _at_quantiles(normal[row], quantile[:, w], level)
            inside = ((tried[row] >= LOWEST) & (tried[row] <= HIGHEST)).all(axis=-1)
            good = tried[row, inside][: count - filled[w]]
            drawn[filled[w] : filled[w] + len(good), w] = good
            filled[w] += len(good)
    short = np.flatnonzero(filled < count)
    for w in short:
        pool = drawn[: filled[w], w] if filled[w] else np.clip(mean[w], LOWEST, HIGHEST)[None]
        drawn[filled[w] :, w] = pool[np.arange(count - filled[w]) % len(pool)]
    return drawn, len(short)


def _at_quantiles(normal: FloatArray, quantile: FloatArray, level: FloatArray) -> FloatArray:
    """Standard normal numbers (D, 3) as values with the stated quantiles (Q, 3)."""
    deviate = normal_deviate(level)
    return np.stack([np.interp(normal[:, p], deviate, quantile[:, p]) for p in range(3)], axis=-1)
