"""What broad bands do to light: a channel sees its average, not the light of the average material.

Where a spectrum is steep, light passes mostly where extinction is low. What an estimate makes of
that, which takes a channel as one wavelength: `scenarios.design.apparent`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scenarios.design.media import Medium
from scenarios.design.optics import Light, Optics
from twin.bench import Bench
from twin.errors import InputError
from twin.instrument import MultispectralChip, band_average, fine_grid_nm
from twin.materials import lamp
from twin.spectra import FloatArray

LEAST = 1e-12
"""Relative intensity below which nothing is known of a capture."""
STEP_NM = 10.0
"""Longest step at which light is solved for a chip: collimated light in its bands is then known to
0.5 % (20 nm: to 4 %) where the extinction of the library's white resin falls."""


@dataclass(frozen=True, eq=False)
class Bands:
    """Light inside the bands of a chip.

    Attributes:
        wavelength_nm: inside the bands [nm], (F,).
        between: light there from that solved, (F, C).
        shares: of it in the channels under panels, panels and beam, (3, W, F).
    """

    wavelength_nm: FloatArray
    between: FloatArray
    shares: FloatArray

    def inside(self, solved: FloatArray) -> FloatArray:
        """Captures (..., F, 3) inside the bands: logarithms are straight where spectra are."""
        log = np.log(np.maximum(solved, LEAST))
        return np.asarray(np.exp(np.einsum("fc,...ci->...fi", self.between, log)))


@dataclass(frozen=True, eq=False)
class View:
    """How a detector sees light.

    Attributes:
        wavelength_nm: judged channels [nm], (W,).
        solved_nm: wavelengths [nm] at which light is solved, (C,); a spectrometer's are its own,
            whose bins are judged as one pixel each.
        bands: of a chip; None: none.
    """

    wavelength_nm: FloatArray
    solved_nm: FloatArray
    bands: Bands | None = None

    @classmethod
    def of(cls, bench: Bench, wavelength_nm: FloatArray) -> View:
        """The view of a bench's detector at judged wavelengths [nm], (W,).

        Raises:
            InputError: a lamp that is not known all over what a chip sees.
        """
        chip = bench.instrument
        if not isinstance(chip, MultispectralChip):
            return cls(wavelength_nm, wavelength_nm)
        fine, (low, high) = fine_grid_nm(chip), chip.range_nm
        coarse = np.linspace(low, high, math.ceil((high - low) / STEP_NM) + 1)
        judged = np.searchsorted(np.asarray(chip.wavelength_nm), wavelength_nm)
        try:
            panels, beam = lamp(bench.panel_spectrum, fine), lamp(bench.beam.spectrum, fine)
        except InputError as error:
            raise error.at(error.file, _seen(coarse)) from error
        by_lamp = [
            band_average(chip, fine, np.eye(len(fine)), own).T[judged] for own in (panels, beam)
        ]
        between = np.stack([np.interp(fine, coarse, unit) for unit in np.eye(len(coarse))], axis=-1)
        shares = np.array([by_lamp[0], by_lamp[0], by_lamp[1]])
        return cls(wavelength_nm, coarse, Bands(fine, between, shares))

    def value(self, solved: FloatArray) -> FloatArray:
        """Captures as they are seen, (..., W, 3), of those solved, (..., C, 3)."""
        own = self.bands
        if own is None:
            return solved
        return np.asarray(np.einsum("iwf,...fi->...wi", own.shares, own.inside(solved)))

    def light(self, optics: Optics, bench: Bench) -> Light:
        """Light of materials as it is seen, with its slopes.

        Raises:
            InputError: as `Optics.light`.
        """
        own = self.bands
        if own is None:
            return optics.light(bench, self.solved_nm)
        try:
            solved = optics.light(bench, self.solved_nm)
        except InputError as error:
            raise error.at(error.file, _seen(self.solved_nm)) from error
        inside = own.inside(solved.value)
        relative = solved.slope / np.maximum(solved.value, LEAST)[..., None]
        # of the log of every capture, which is what is interpolated
        slopes = np.einsum("fc,...cip->...fip", own.between, relative) * inside[..., None]
        return Light(
            np.asarray(np.einsum("iwf,...fi->...wi", own.shares, inside)),
            np.asarray(np.einsum("iwf,...fip->...wip", own.shares, slopes)),
        )

    def mean(self, medium: Medium) -> FloatArray:
        """The material averaged over each band, which is the truth that estimates are held to.

        As `twin.measurement.seen_truth` has it: sigma_t under the beam, the others under the
        panels. Shape (W, 3).

        Raises:
            InputError: a spectrum that does not cover what is seen.
        """
        own = self.bands
        if own is None:
            return medium.at(self.wavelength_nm)
        try:
            values = medium.at(own.wavelength_nm)
        except InputError as error:
            raise error.at(error.file, _seen(self.solved_nm)) from error
        return np.asarray(np.einsum("pwf,fp->wp", own.shares[[0, 2, 0]], values))


def _seen(solved_nm: FloatArray) -> str:
    return f"a chip from {solved_nm[0]:g} to {solved_nm[-1]:g} nm"
