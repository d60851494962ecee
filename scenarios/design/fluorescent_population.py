"""Fluorescent materials that a set-up shall measure: varied dyes of the library in varied bases."""

from __future__ import annotations

import numpy as np

from twin.errors import InputError
from twin.fluorescence import (
    FLUOROPHORES,
    GRID_NM,
    Band,
    DonaldsonMatrix,
    Fluorophore,
    from_photons,
)
from twin.spectra import FloatArray

FIRST_EXCITATION_NM = 370.0
"""Dyes that peak at shorter wavelengths show nothing from 400 nm on."""
SHIFT_NM = 8.0
"""Standard deviation of the peaks of one dye in different solvents and binders."""
WIDTH = 0.15
"""Standard deviation of the logarithm of the half-widths."""


def fluorescent_population(
    count: int,
    *,
    seed: int = 1,
    emission_nm: FloatArray = GRID_NM,
    excitation_nm: FloatArray = GRID_NM,
) -> tuple[DonaldsonMatrix, ...]:
    """Generated materials: one dye and two dyes in turn, in a coloured diffuse base.

    The dyes are those of `twin.fluorescence.FLUOROPHORES` (published peaks and yields), moved and
    widened at random; the base is a step of random place, height and width. Nothing here was
    fitted to the prior of an estimator, and the bands are not of its family of shapes.

    Args:
        count: number of materials, B.
        seed: of the random numbers; a longer population begins with the shorter one.
        emission_nm: rows, (Wo,).
        excitation_nm: columns, (Wi,).

    Raises:
        InputError: a count below 1.
    """
    if count < 1:
        raise InputError(f"{count} materials", "1 or more", place="count")
    names = [n for n, d in FLUOROPHORES.items() if d.excitation.peak_nm > FIRST_EXCITATION_NM]
    out, into = np.asarray(emission_nm, float), np.asarray(excitation_nm, float)
    found = []
    for number in range(count):
        random = np.random.Generator(np.random.Philox(key=[seed, number]))
        step = np.tanh((out - random.uniform(450.0, 650.0)) / random.uniform(20.0, 80.0))
        rho = np.clip(random.uniform(0.3, 0.9) + random.uniform(-0.3, 0.3) * step, 0.03, 0.97)
        cells = np.zeros((out.size, into.size))
        chosen = random.choice(names, size=1 + number % 2, replace=False)
        for name in chosen:
            dye, share = _varied(FLUOROPHORES[name], random), random.uniform(0.2, 0.7)
            cells += from_photons(dye.photons(share, out, into), out, into)
            rho = rho * (1.0 - share * dye.excitation.at(out))
        same = np.abs(out[:, None] - into) < 1e-6
        found.append(
            DonaldsonMatrix(
                cells + same * rho[:, None],
                out,
                into,
                name=f"material {number + 1}: {' + '.join(chosen)}",
                source="generated",
            )
        )
    return tuple(found)


def _varied(dye: Fluorophore, random: np.random.Generator) -> Fluorophore:
    shift = random.normal(0.0, SHIFT_NM)

    def band(one: Band) -> Band:
        short, long = np.exp(random.normal(0.0, WIDTH, size=2))
        return Band(
            peak_nm=one.peak_nm + shift, short_nm=one.short_nm * short, long_nm=one.long_nm * long
        )

    return dye.model_copy(
        update={"excitation": band(dye.excitation), "emission": band(dye.emission)}
    )
