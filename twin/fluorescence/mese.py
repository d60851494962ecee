"""Bounded maximum entropy spectral estimate (MESE) of a spectrum between 0 and 1, in JAX.

Source: Peters, Merzbach, Hanika, Dachsbacher 2019, "Using Moments to Represent Bounded Signals for
Spectral Rendering" (ACM TOG 38(4)), with the mirrored, linear phase

    phi = pi (wavelength - first) / (last - first) - pi,     -pi <= phi <= 0

Trigonometric moments c (real, because of the mirror) -> exponential moments gamma -> Levinson's
recursion -> Lagrange multipliers -> the signal. Every function works on any leading dimensions,
can be differentiated, jitted and vmapped, and calls no LAPACK (decision 0003).

Any real multipliers give a signal inside (0, 1) that is the MESE of its own moments: a fit that has
the MESE inside can move `multipliers` freely, without bounds and without Levinson's recursion, and
export `moments` at the end.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from twin.adding_doubling.runtime import prepare_jax
from twin.errors import InputError
from twin.spectra import FloatArray

prepare_jax()

RANGE_NM = (400.0, 700.0)
"""Wavelengths [nm] of the phases -pi and 0."""
WAVELENGTH_NM = np.linspace(400.0, 700.0, 31)
WAVELENGTH_NM.flags.writeable = False
EPS = 1e-4
"""Distance from 0 and 1 that samples keep: a constant 1 makes the Toeplitz matrix singular."""
LARGEST_COUNT = 32


class Reconstruction(NamedTuple):
    """A signal and whether its moments are those of any signal between 0 and 1.

    Attributes:
        value: the signal, shape (..., W); NaN where the moments are invalid.
        valid: shape (...).
    """

    value: jax.Array
    valid: jax.Array


class Multipliers(NamedTuple):
    """Lagrange multipliers of a MESE.

    Attributes:
        value: real multipliers, shape (..., n); NaN where the moments are invalid.
        valid: shape (...).
        reflection: reflection coefficients s of Levinson's recursion, complex, shape (..., n - 1);
            the moments are valid where c_0 lies inside (0, 1) and every |s| < 1.
    """

    value: jax.Array
    valid: jax.Array
    reflection: jax.Array


def phase(
    wavelength_nm: ArrayLike = WAVELENGTH_NM, range_nm: tuple[float, float] = RANGE_NM
) -> FloatArray:
    """Mirrored phase, -pi to 0, of wavelengths [nm], shape (W,).

    Raises:
        InputError: a wavelength outside the range, or none.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    low, high = range_nm
    if wavelength.ndim != 1 or wavelength.size == 0:
        raise InputError(f"wavelengths of shape {wavelength.shape}", "a list of one or more [nm]")
    outside = ~((wavelength >= low - 1e-9) & (wavelength <= high + 1e-9))
    if outside.any():
        raise InputError(
            f"{wavelength[outside][0]:g} nm", f"wavelengths from {low:g} to {high:g} nm",
            place="wavelength_nm",
        )  # fmt: skip
    return np.asarray(np.pi * (wavelength - low) / (high - low) - np.pi)


def moment_matrix(
    count: int = 8,
    wavelength_nm: ArrayLike = WAVELENGTH_NM,
    range_nm: tuple[float, float] = RANGE_NM,
) -> FloatArray:
    """Matrix that turns samples into moments, shape (count, W): `moments` is linear.

        c_j = (1 / pi) integral from -pi to 0 of g(phi) cos(j phi),   j = 0 ... count - 1

    exact for a signal that is linear between its samples (equations 2 and 3, mirrored).

    Raises:
        InputError: a count outside 1 to 32, or wavelengths that do not increase from the first to
            the last of the range.
    """
    _check_count(count)
    phi = phase(wavelength_nm, range_nm)
    if phi.size < 2 or np.any(np.diff(phi) <= 0) or phi[0] > -np.pi + 1e-9 or phi[-1] < -1e-9:
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        raise InputError(
            f"{wavelength.size} wavelengths from {wavelength[0]:g} to {wavelength[-1]:g} nm",
            f"increasing wavelengths from {range_nm[0]:g} to {range_nm[1]:g} nm, both included",
            place="wavelength_nm",
        )
    left, right = phi[:-1], phi[1:]
    step = right - left
    matrix = np.zeros((count, phi.size))
    matrix[0, :-1] += step / 2.0
    matrix[0, 1:] += step / 2.0
    for j in range(1, count):
        bend = (np.cos(j * left) - np.cos(j * right)) / (step * j**2)
        matrix[j, :-1] += bend - np.sin(j * left) / j
        matrix[j, 1:] += np.sin(j * right) / j - bend
    return np.asarray(matrix / np.pi)


def clamped(spectrum: ArrayLike, eps: float = EPS) -> int:
    """How many samples `moments` moves to [eps, 1 - eps]: for whoever reports it."""
    value = np.asarray(spectrum, dtype=np.float64)
    return int(np.count_nonzero((value < eps) | (value > 1.0 - eps)))


def moments(
    spectrum: ArrayLike,
    count: int = 8,
    *,
    wavelength_nm: ArrayLike = WAVELENGTH_NM,
    range_nm: tuple[float, float] = RANGE_NM,
    eps: float = EPS,
) -> jax.Array:
    """Trigonometric moments c_0 ... c_{count - 1} of a spectrum.

    Args:
        spectrum: samples, shape (..., W); moved to [eps, 1 - eps] first (`clamped` counts them),
            which makes the moments valid. A NaN stays one.
        count: number of moments; the seed's "m = 7" are 8 of them.
        wavelength_nm: wavelengths [nm] of the samples, shape (W,), from end to end of the range.
        range_nm: wavelengths [nm] of the phases -pi and 0.
        eps: 0 turns the clamp off: values outside [0, 1] then wrap silently, except that
            `reconstruct` says so where it can be seen.

    Returns:
        Real moments, shape (..., count).

    Raises:
        InputError: as `moment_matrix`; samples of another number.
    """
    matrix = moment_matrix(count, wavelength_nm, range_nm)
    value = jnp.asarray(spectrum, dtype=jnp.float64)
    if value.ndim == 0 or value.shape[-1] != matrix.shape[1]:
        raise InputError(
            f"a spectrum of shape {value.shape}", f"{matrix.shape[1]} samples in the last dimension"
        )
    if eps > 0.0:
        value = jnp.clip(value, eps, 1.0 - eps)
    return value @ matrix.T


def exponential_moments(moment: ArrayLike) -> jax.Array:
    """Exponential moments gamma, complex, shape (..., n), of moments, shape (..., n).

        gamma_0 = exp(i pi (c_0 - 1/2)) / (4 pi)
        gamma_l = (2 pi i / l) sum_{j < l} (l - j) gamma_j c_{l - j}

    (Peters et al. 2019, algorithm 1.)
    """
    c = jnp.asarray(moment, dtype=jnp.float64)
    gamma = (jnp.exp(1j * jnp.pi * (c[..., :1] - 0.5)) / (4.0 * jnp.pi)).astype(jnp.complex128)
    for order in range(1, c.shape[-1]):
        rest = np.arange(order, 0, -1)
        term = (2j * np.pi / order) * jnp.sum(rest * gamma * c[..., order:0:-1], axis=-1)
        gamma = jnp.concatenate([gamma, term[..., None]], axis=-1)
    return gamma


def levinson(column: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Solve T q = e_0 for the Hermitian Toeplitz matrix with a first column (Levinson 1947).

    Args:
        column: complex, shape (..., n); the first entry real and above 0.

    Returns:
        q, shape (..., n), and the reflection coefficients s, shape (..., n - 1). T is positive
        definite exactly where every |s| < 1; q means nothing elsewhere.
    """
    q = 1.0 / column[..., :1]
    blank = jnp.zeros_like(q)
    reflections = [jnp.zeros((*column.shape[:-1], 0), dtype=column.dtype)]
    for order in range(1, column.shape[-1]):
        s = jnp.sum(q * column[..., order:0:-1], axis=-1, keepdims=True)
        reflections.append(s)
        # A value on the unit circle divides by 0: kept away from it, the answer is masked later.
        rest = 1.0 - (s * jnp.conj(s)).real
        flipped = jnp.concatenate([blank, jnp.conj(q[..., ::-1])], axis=-1)
        padded = jnp.concatenate([q, blank], axis=-1)
        q = (padded - s * flipped) / jnp.where(rest > 0.0, rest, 1.0)
    return q, jnp.concatenate(reflections, axis=-1)


@jax.jit
def multipliers(moment: ArrayLike) -> Multipliers:
    """Lagrange multipliers of the bounded MESE of moments, shape (..., n).

        T q = e_0 with the first column gamma / (2 pi), its head 2 Re gamma_0 / (2 pi)
        r_k = sum_j conj(q_{j+k}) q_j,   lambda_l = sum_k gamma_k r_{k+l} / (i pi q_0)

    (Peters et al. 2019, algorithm 2.)
    """
    c = jnp.asarray(moment, dtype=jnp.float64)
    inside = (c[..., 0] > 0.0) & (c[..., 0] < 1.0) & jnp.all(jnp.isfinite(c), axis=-1)
    # Invalid moments are replaced before the recursion, so that no NaN leaks into gradients.
    safe = jnp.where(inside[..., None], c, jnp.eye(1, c.shape[-1])[0] * 0.5)
    gamma = exponential_moments(safe)
    head = 2.0 * gamma[..., :1].real + 0j
    q, reflection = levinson(jnp.concatenate([head, gamma[..., 1:]], axis=-1) / (2.0 * jnp.pi))
    size = c.shape[-1]
    r = jnp.stack(
        [jnp.sum(jnp.conj(q[..., k:]) * q[..., : size - k], axis=-1) for k in range(size)], axis=-1
    )
    found = jnp.stack(
        [jnp.sum(gamma[..., : size - k] * r[..., k:], axis=-1) for k in range(size)], axis=-1
    ) / (1j * jnp.pi * q[..., :1])
    valid = inside & jnp.all(jnp.abs(reflection) < 1.0, axis=-1)
    value = jnp.where(valid[..., None], found.real, jnp.nan)
    return Multipliers(value, valid, reflection)


def signal(
    multiplier: ArrayLike,
    wavelength_nm: ArrayLike = WAVELENGTH_NM,
    range_nm: tuple[float, float] = RANGE_NM,
) -> jax.Array:
    """The bounded MESE with given real multipliers, shape (..., n) -> (..., W), inside (0, 1).

        g(phi) = 1/2 + arctan(lambda_0 + 2 sum_{l >= 1} lambda_l cos(l phi)) / pi

    Raises:
        InputError: a wavelength outside the range.
    """
    value = jnp.asarray(multiplier, dtype=jnp.float64)
    basis = cosine_basis(value.shape[-1], wavelength_nm, range_nm)
    return 0.5 + jnp.arctan(value @ basis) / jnp.pi


def cosine_basis(
    count: int,
    wavelength_nm: ArrayLike = WAVELENGTH_NM,
    range_nm: tuple[float, float] = RANGE_NM,
) -> FloatArray:
    """1, 2 cos(phi), 2 cos(2 phi) ...: what the multipliers weigh, shape (count, W).

    Raises:
        InputError: a count outside 1 to 32, a wavelength outside the range.
    """
    _check_count(count)
    order = np.arange(count, dtype=np.float64)[:, None]
    basis = 2.0 * np.cos(order * phase(wavelength_nm, range_nm))
    basis[0] = 1.0
    return np.asarray(basis)


def reconstruct(
    moment: ArrayLike,
    wavelength_nm: ArrayLike = WAVELENGTH_NM,
    range_nm: tuple[float, float] = RANGE_NM,
) -> Reconstruction:
    """The bounded MESE of moments, shape (..., n), at wavelengths [nm], shape (W,).

    Returns:
        The signal inside (0, 1), shape (..., W), and its validity, shape (...). Moments that no
        signal between 0 and 1 has (c_0 outside (0, 1), or a reflection coefficient of 1 or more)
        give NaN and False instead of a curve that has silently wrapped.

    Raises:
        InputError: a wavelength outside the range.
    """
    found = multipliers(moment)
    return Reconstruction(signal(found.value, wavelength_nm, range_nm), found.valid)


def _check_count(count: int) -> None:
    if not 1 <= count <= LARGEST_COUNT:
        raise InputError(f"{count} moments", f"1 to {LARGEST_COUNT}", place="count")
