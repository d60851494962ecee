"""From a spectrum of light to what every pixel or channel of an instrument sees of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError
from twin.instrument.spec import Instrument, MultispectralChip, Spectrometer
from twin.spectra import FloatArray

# A Gaussian of full width F has exp(-4 ln 2 (2F)^2 / F^2) = 1.5e-5 of its peak left at two widths.
_REACH_IN_WIDTHS = 2.0
# Three samples a width leave a relative error of exp(-2 (pi sigma / step)^2) = 1e-14 of the area.
_SAMPLES_PER_WIDTH = 3.0
_COARSEST_STEP_NM = 1.0


def light_range_nm(instrument: Instrument) -> tuple[float, float]:
    """Wavelengths [nm] between which light reaches any pixel."""
    if isinstance(instrument, MultispectralChip):
        return instrument.range_nm
    pixels = instrument.wavelength_nm
    reach = _REACH_IN_WIDTHS * instrument.bandwidth_nm if instrument.has("bandwidth") else 0.0
    return pixels[0] - reach, pixels[-1] + reach


def fine_grid_nm(instrument: Instrument) -> FloatArray:
    """The wavelengths [nm] at which the light is wanted, increasing, shape (W,).

    Without "bandwidth" a spectrometer wants the light at its pixels and nowhere else.
    """
    if isinstance(instrument, Spectrometer) and not instrument.has("bandwidth"):
        return np.asarray(instrument.wavelength_nm, dtype=np.float64)
    low, high = light_range_nm(instrument)
    step = min(_COARSEST_STEP_NM, min(instrument.fwhm_nm) / _SAMPLES_PER_WIDTH)
    return np.linspace(low, high, int(np.ceil((high - low) / step - 1e-9)) + 1)


def response_matrix(instrument: Instrument, wavelength_nm: ArrayLike) -> FloatArray:
    """Share of every wavelength in every pixel's reading, shape (P, W); each row sums to 1.

    Args:
        instrument: the instrument.
        wavelength_nm: increasing wavelengths [nm], shape (W,), that cover `light_range_nm` with
            steps of at most two thirds of the narrowest band.

    Raises:
        InputError: the wavelengths do not increase, do not cover the range, or are too far apart.
    """
    wavelength = _checked_grid(instrument, wavelength_nm)
    centre = np.asarray(instrument.wavelength_nm, dtype=np.float64)[:, None]
    quadrature = _trapezoid_weights(wavelength)
    if instrument.has("bandwidth"):
        width = np.asarray(instrument.fwhm_nm, dtype=np.float64)[:, None]
        response = np.exp(-4.0 * np.log(2.0) * ((wavelength - centre) / width) ** 2) * quadrature
        if isinstance(instrument, MultispectralChip):
            for row, channel in zip(response, instrument.channels, strict=True):
                if channel.response is not None:
                    row[:] = _inside(instrument, wavelength, channel.response.at) * quadrature
    else:
        response = _interpolation_matrix(wavelength, centre[:, 0])
    if isinstance(instrument, MultispectralChip):
        within = _inside(instrument, wavelength, np.ones_like)
        response = _rows_to_one(response * within)
        if instrument.has("stray_light"):
            leak = instrument.leak_fraction
            flat = within * quadrature
            response = (1.0 - leak) * response + leak * flat / flat.sum()
    return _rows_to_one(response)


def band_average(
    instrument: Instrument,
    wavelength_nm: ArrayLike,
    spectrum: ArrayLike,
    weight: ArrayLike | None = None,
) -> FloatArray:
    """A spectrum as the instrument's pixels or bands see it.

    Args:
        instrument: the instrument.
        wavelength_nm: increasing wavelengths [nm], shape (W,).
        spectrum: any quantity per wavelength, shape (..., W).
        weight: light under which the quantity is seen (such as the lamp), shape (W,), in any
            unit; None is light of constant power per nm.

    Returns:
        The averages in the unit of `spectrum`, shape (..., P). A constant stays the same.

    Raises:
        InputError: the wavelengths do not serve (see `response_matrix`), the shapes differ, a
            value is not finite, or the weight leaves a pixel without light.
    """
    matrix = response_matrix(instrument, wavelength_nm)
    values = _checked_spectrum("the spectrum", spectrum, matrix.shape[1])
    if weight is None:
        return np.asarray(values @ matrix.T)
    light = _checked_spectrum("the weight", weight, matrix.shape[1])
    total = matrix @ light
    if light.ndim != 1 or light.min() < 0 or total.min() <= 0:
        raise InputError(
            f"a weight from {light.min():g} to {light.max():g}",
            "one spectrum of light, nowhere below 0 and above 0 in every band",
            place="weight",
        )
    return np.asarray((values * light) @ matrix.T / total)


def electron_rates(
    instrument: Instrument,
    wavelength_nm: ArrayLike,
    spectrum: ArrayLike,
    *,
    reference: ArrayLike,
    peak_rate_electrons_per_s: float,
) -> FloatArray:
    """Signal of every pixel, before stray light and the sensor's fixed pattern.

    The reference (the white or the beam without a sample) sets the scale: its brightest pixel
    collects `peak_rate_electrons_per_s`, usually `instrument.white_rate_electrons_per_s` or
    `instrument.beam_rate_electrons_per_s`.

    Args:
        instrument: the instrument.
        wavelength_nm: increasing wavelengths [nm], shape (W,).
        spectrum: light, lamp times relative intensity, in any unit of power per nm, shape (..., W).
        reference: light of the reference in the same unit, shape (W,).
        peak_rate_electrons_per_s: signal [electrons/s] of the reference's brightest pixel.

    Returns:
        Signal [electrons/s], shape (..., P).

    Raises:
        InputError: as `band_average`; negative light; a reference without light.
    """
    matrix = response_matrix(instrument, wavelength_nm)
    grid = np.asarray(wavelength_nm, dtype=np.float64)
    light = _checked_spectrum("the spectrum", spectrum, matrix.shape[1])
    scale = _checked_spectrum("the reference", reference, matrix.shape[1])
    if light.size and light.min() < 0:
        raise InputError(f"light of {light.min():g}", "no negative light", place="spectrum")
    if scale.ndim != 1 or scale.min() < 0:
        raise InputError(
            f"a reference of shape {scale.shape}, lowest value {scale.min():g}",
            "one spectrum without negative light",
            place="reference",
        )
    responsivity = np.broadcast_to(_responsivity(instrument, grid), grid.shape)
    seen = matrix * responsivity
    if isinstance(instrument, MultispectralChip):
        seen = seen * np.array([[channel.sensitivity] for channel in instrument.channels])
    peak = float((seen @ scale).max())
    if peak <= 0:
        raise InputError(
            "no light in any pixel", "light in the reference", place="reference",
            remedy="Check that the lamp reaches into the instrument's range.",
        )  # fmt: skip
    return np.asarray((light @ seen.T) * (peak_rate_electrons_per_s / peak))


def _responsivity(instrument: Instrument, wavelength: FloatArray) -> float | FloatArray:
    table = instrument.responsivity
    if isinstance(table, float):
        return table
    try:
        return table.at(wavelength)
    except ValueError as error:
        raise InputError(
            f"a responsivity from {table.wavelength_nm[0]:g} to {table.wavelength_nm[-1]:g} nm",
            f"a table that covers {wavelength[0]:g} to {wavelength[-1]:g} nm",
            place="instrument.responsivity",
        ) from error


def _checked_grid(instrument: Instrument, wavelength_nm: ArrayLike) -> FloatArray:
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    if wavelength.ndim != 1 or wavelength.size == 0 or not np.all(np.isfinite(wavelength)):
        raise InputError(
            f"wavelengths of shape {wavelength.shape}", "a list of finite numbers",
            place="wavelength_nm",
        )  # fmt: skip
    steps = np.diff(wavelength)
    if np.any(steps <= 0):
        raise InputError(
            "wavelengths that do not increase", "increasing wavelengths", place="wavelength_nm"
        )
    low, high = light_range_nm(instrument)
    if wavelength[0] > low + 1e-6 or wavelength[-1] < high - 1e-6:
        raise InputError(
            f"light from {wavelength[0]:g} to {wavelength[-1]:g} nm",
            f"light from {low:g} to {high:g} nm, which the instrument's bands reach",
            place="wavelength_nm",
            remedy="Use a shorter wavelength range in the instrument or a longer one in the light.",
        )
    if instrument.has("bandwidth"):
        coarsest = 2.0 / 3.0 * min(instrument.fwhm_nm)
        if steps.size and steps.max() > coarsest * (1 + 1e-9):
            raise InputError(
                f"light every {steps.max():g} nm", f"steps of at most {coarsest:g} nm",
                place="wavelength_nm",
                remedy="Take the wavelengths from fine_grid_nm.",
            )  # fmt: skip
    return wavelength


def _checked_spectrum(what: str, spectrum: ArrayLike, wavelengths: int) -> FloatArray:
    values = np.asarray(spectrum, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] != wavelengths:
        raise InputError(
            f"{what} of shape {values.shape}", f"{wavelengths} wavelengths in the last dimension"
        )
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise InputError(f"{bad} values in {what} that are not finite", "finite numbers")
    return values


def _trapezoid_weights(wavelength: FloatArray) -> FloatArray:
    if wavelength.size == 1:
        return np.ones(1)
    steps = np.diff(wavelength)
    weights = np.zeros_like(wavelength)
    weights[:-1] += steps / 2
    weights[1:] += steps / 2
    return weights


def _interpolation_matrix(wavelength: FloatArray, centre: FloatArray) -> FloatArray:
    return np.stack([np.interp(centre, wavelength, unit) for unit in np.eye(wavelength.size)], 1)


def _inside(
    chip: MultispectralChip, wavelength: FloatArray, function: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Values of a function inside the chip's range, 0 outside."""
    low, high = chip.range_nm
    mask = (wavelength >= low) & (wavelength <= high)
    values = np.zeros_like(wavelength)
    values[mask] = function(wavelength[mask])
    return values


def _rows_to_one(matrix: FloatArray) -> FloatArray:
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))
