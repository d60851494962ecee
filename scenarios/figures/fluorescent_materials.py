"""The materials of chapter 5's figures: generated ones, or those of a folder of BFC-450 files."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.fluorescence import GRID_NM, Band, DonaldsonMatrix, from_photons, read_bfc
from twin.spectra import FloatArray

SHOULDER_PER_CM = 1300.0
"""Distance [1/cm] of the vibronic shoulder that most dyes show."""


@dataclass(frozen=True)
class Materials:
    """Materials with one fluorophore and with two.

    Attributes:
        one: matrices with one fluorophore.
        two: sums: the fluorescence of two, the reflectance of the first.
        source: where they come from, in words.
    """

    one: tuple[DonaldsonMatrix, ...]
    two: tuple[DonaldsonMatrix, ...]
    source: str


def generated(count: int, seed: int) -> Materials:
    """Materials as coloured papers and plastics look, drawn at random.

    Every fluorophore is absorbed and emits in a skewed band with a vibronic shoulder (Kasha's
    rule, no emission shorter than the excitation); the base is a smooth pigment with one edge; a
    smooth error of 3 % of the brightest cell that no product explains lies over the fluorescence,
    since measured matrices are no exact products.

    Args:
        count: how many of each kind.
        seed: of the random numbers.
    """
    one = tuple(
        _material(np.random.Generator(np.random.Philox(key=[seed, number])), f"dye {number + 1}")
        for number in range(count)
    )
    order = sorted(range(count), key=lambda k: float(_emission_peak(one[k])))
    half = max(count // 2, 1)
    # Far apart in emission, as the seed sorted them "to prevent entirely overlapping spectra".
    pairs = [(order[k], order[(k + half) % count]) for k in range(count)]
    two = tuple(one[a].with_fluorescence_of(one[b]) for a, b in pairs if a != b)
    return Materials(one, two, f"{count} generated materials and {len(two)} sums of two")


def from_folder(folder: str | Path) -> Materials:
    """The `.BFC` files of a folder on 400 to 700 nm, and all sums of two.

    The noise of measured matrices below the diagonal and below 0, which cannot be lit, is set to 0.

    Raises:
        InputError: no folder, no such files, or a file that is wrong.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no folder", "a folder with .BFC files", file=folder, place="--materials")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".bfc")
    if len(files) < 2:
        raise InputError(
            f"{len(files)} .BFC files", "two or more", file=folder, place="--materials"
        )
    one = tuple(read_bfc(path, below="zero").on(GRID_NM).physical() for path in files)
    two = tuple(a.with_fluorescence_of(b) for a, b in itertools.permutations(one, 2))
    return Materials(one, two, f"{len(one)} measured materials and {len(two)} sums of two")


def _material(random: np.random.Generator, name: str) -> DonaldsonMatrix:
    absorbed = Band(
        peak_nm=random.uniform(410.0, 545.0), short_nm=random.uniform(18.0, 45.0),
        long_nm=random.uniform(12.0, 28.0),
    )  # fmt: skip
    emitted = Band(
        peak_nm=min(absorbed.peak_nm + random.uniform(20.0, 80.0), 630.0),
        short_nm=random.uniform(12.0, 24.0), long_nm=random.uniform(22.0, 50.0),
    )  # fmt: skip
    excitation = _with_shoulder(absorbed, random.uniform(0.15, 0.6), +SHOULDER_PER_CM)
    emission = _with_shoulder(emitted, random.uniform(0.15, 0.5), -SHOULDER_PER_CM)
    share, quantum_yield = random.uniform(0.3, 0.8), random.uniform(0.15, 0.9)
    cells = share * quantum_yield * np.outer(emission / emission.sum(), excitation)
    below = GRID_NM[:, None] > GRID_NM[None, :]
    cells = np.where(below, from_photons(cells), 0.0)
    cells += np.where(below, _smooth(random, 0.03 * float(cells.max())), 0.0)
    edge, width = random.uniform(430.0, 620.0), random.uniform(15.0, 40.0)
    low, high = random.uniform(0.15, 0.6), random.uniform(0.65, 0.92)
    base = low + (high - low) / (1.0 + np.exp(-(GRID_NM - edge) / width))
    reflectance = base * (1.0 - share * excitation)
    matrix = np.maximum(cells, 0.0) + np.diag(reflectance)
    return DonaldsonMatrix(matrix, name=name, source="generated")


def _with_shoulder(band: Band, share: float, shift_per_cm: float) -> FloatArray:
    """A band and its shoulder, peak 1, on the grid, (31,)."""
    other = band.model_copy(update={"peak_nm": 1e7 / (1e7 / band.peak_nm + shift_per_cm)})
    value = band.at(GRID_NM) + share * other.at(GRID_NM)
    return np.asarray(value / max(float(value.max()), 1e-12))


def _smooth(random: np.random.Generator, size: float) -> FloatArray:
    """A smooth error of about a given size, correlated over 30 nm, (31, 31)."""
    distance = (GRID_NM[:, None] - GRID_NM[None, :]) / 30.0
    kernel = np.exp(-0.5 * distance**2)
    kernel /= np.linalg.norm(kernel, axis=1, keepdims=True)
    return np.asarray(size * kernel @ random.standard_normal((31, 31)) @ kernel.T)


def _emission_peak(matrix: DonaldsonMatrix) -> float:
    return float(matrix.emission_nm[int(matrix.fluorescence.sum(axis=1).argmax())])
