"""What a fluorescent sample looks like under a light: reflected spectra, colours, differences.

CIE 1931 2 degree observer. Sums run over the matrix's own bins and nothing is extrapolated. Under
D65, A and FL4 the white point is that of a perfect diffuser under the same light, seen through the
same bins; light of one wavelength has no white of its own, so the eye stays adapted to equal energy
there (as in `estimators.fluorescence.colour`). Colour differences are CIEDE2000 (CIE 142-2001).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from estimators.fluorescence.colour import ciede2000, lab_of
from scenarios.report.colour import Swatch
from scenarios.report.colour import ciede2000 as swatch_difference
from twin.spectra import FloatArray

STANDARD = ("D65", "A", "FL4")
"""CIE illuminants that the report shows."""
NARROW_NM = (410.0, 450.0, 530.0, 600.0)
"""Monochromatic lights that the report shows, where the matrix has them [nm]."""
SHOWN_LUMINANCE = 0.6
"""Y that the brighter of estimate and truth is exposed to for a swatch of monochromatic light."""


@dataclass(frozen=True)
class Light:
    """One light on the excitation bins.

    Attributes:
        name: as the report calls it.
        energy: energy per excitation bin, the brightest 1, shape (Wi,).
        wavelength_nm: of a monochromatic light, else None.
    """

    name: str
    energy: FloatArray
    wavelength_nm: float | None = None


@dataclass(frozen=True)
class Appearance:
    """What the sample looks like under one light.

    Attributes:
        light: the light.
        spectrum: reflected energy per emission bin of the estimate, (Wo,).
        band: its 0.05 and 0.95 quantiles, (2, Wo), or None.
        truth_spectrum: of the true matrix, (Wo,), or None.
        patch: colour of the estimate; truth_patch: of the truth, or None. What a screen shows of
            them is brightened by the exposure.
        difference: CIEDE2000 between estimate and truth, or None.
        uncertainty: 0.9 quantile of CIEDE2000 between draws and estimate, or None.
        exposure: factor that the swatch was brightened by.
    """

    light: Light
    spectrum: FloatArray
    band: FloatArray | None
    truth_spectrum: FloatArray | None
    patch: Swatch
    truth_patch: Swatch | None
    difference: float | None
    uncertainty: float | None
    exposure: float


def lights_for(excitation_nm: FloatArray) -> tuple[Light, ...]:
    """The report's lights on excitation bins [nm], (Wi,), in energy per bin."""
    import colour

    step = float(excitation_nm[1] - excitation_nm[0])
    found = []
    for name in STANDARD:
        table = colour.SDS_ILLUMINANTS[name]
        grid, value = np.asarray(table.wavelengths, float), np.asarray(table.values, float)
        energy = _binned(grid, value, excitation_nm, step)
        found.append(Light(name, energy / energy.max()))
    for wavelength in NARROW_NM:
        at = np.abs(excitation_nm - wavelength) < 1e-6
        if at.any():
            found.append(Light(f"{wavelength:g} nm", at.astype(np.float64), wavelength))
    return tuple(found)


def _binned(
    grid: FloatArray, value: FloatArray, centre_nm: FloatArray, step_nm: float
) -> FloatArray:
    """Means over bins of a sampled spectrum, linear in between and 0 outside its table."""
    parts = max(1, round(step_nm))
    inside = (np.arange(parts) + 0.5) / parts - 0.5
    fine = centre_nm[:, None] + step_nm * inside
    return np.asarray(np.interp(fine, grid, value, left=0.0, right=0.0).mean(axis=1))


@lru_cache(maxsize=8)
def _observer(emission_nm: tuple[float, ...]) -> FloatArray:
    """Colour matching functions, means over the bins, (Wo, 3)."""
    import colour

    table = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    grid = np.asarray(table.wavelengths, dtype=np.float64)
    values = np.asarray(table.values, dtype=np.float64)
    centre = np.asarray(emission_nm)
    step = float(centre[1] - centre[0])
    return np.stack([_binned(grid, column, centre, step) for column in values.T], axis=1)


def appearance(
    light: Light,
    matrix: FloatArray,
    emission_nm: FloatArray,
    excitation_nm: FloatArray,
    *,
    draws: FloatArray | None = None,
    truth: FloatArray | None = None,
) -> Appearance:
    """What a Donaldson matrix looks like under a light.

    Args:
        light: energy per excitation bin, (Wi,).
        matrix: the estimate, (Wo, Wi).
        emission_nm: rows, (Wo,).
        excitation_nm: columns, (Wi,).
        draws: posterior draws, (D, Wo, Wi), or None.
        truth: the true matrix, (Wo, Wi), or None.
    """
    cmf = _observer(tuple(emission_nm.tolist()))
    energy = light.energy
    same = np.abs(emission_nm[:, None] - excitation_nm[None, :]) < 1e-6
    spectrum = matrix @ energy
    others = None if draws is None else draws @ energy
    right = None if truth is None else truth @ energy
    # Under one wavelength a perfect diffuser at 555 nm has Y = 1, and equal energy is white.
    narrow = light.wavelength_nm is not None
    white = np.full(3, cmf[:, 1].max()) if narrow else (same @ energy) @ cmf
    scale = white[1]
    xyz, white_xyz = spectrum @ cmf / scale, white / scale
    right_xyz = None if right is None else right @ cmf / scale
    exposure = 1.0
    if light.wavelength_nm is not None:
        brightest = max(xyz[1], 0.0 if right_xyz is None else right_xyz[1])
        exposure = SHOWN_LUMINANCE / max(brightest, 1e-6)
    patch = _patch(xyz, white_xyz, exposure)
    truth_patch = None if right_xyz is None else _patch(right_xyz, white_xyz, exposure)
    spread = None
    if others is not None:
        labs = lab_of(others @ cmf / scale / white_xyz)
        spread = float(np.quantile(ciede2000(labs, np.array(patch.lab)), 0.9))
    return Appearance(
        light, spectrum, None if others is None else np.quantile(others, [0.05, 0.95], axis=0),
        right, patch, truth_patch,
        swatch_difference(patch, truth_patch),
        spread, exposure,
    )  # fmt: skip


def _patch(xyz: FloatArray, white: FloatArray, exposure: float) -> Swatch:
    import colour

    white_xy = white[:2] / white.sum()
    srgb = colour.XYZ_to_sRGB(xyz * exposure, illuminant=white_xy)
    x, y, z = (float(value) for value in xyz)
    lightness, a, b = (float(value) for value in lab_of(xyz / white))
    red, green, blue = (float(value) for value in srgb)
    return Swatch((x, y, z), (lightness, a, b), (red, green, blue))
