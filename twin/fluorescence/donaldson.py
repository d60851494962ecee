"""The Donaldson matrix: what comes back at every wavelength per light that comes in at another.

Index order everywhere: matrix[emission, excitation], in energy units with the bin width included
(Donaldson 1954; as CIE 15 and the BFC-450 have it): the energy that leaves in the emission bin over
the energy that arrived in the excitation bin, relative to a perfect diffuser. The diagonal is the
reflectance, the rest fluorescence; emission is never shorter than excitation. In photon units

    D_photon[out, in] = D_energy[out, in] * out / in

because a photon of wavelength lambda has the energy h c / lambda.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError
from twin.spectra import FloatArray

GRID_NM: FloatArray = np.linspace(400.0, 700.0, 31)
"""The seed's wavelengths [nm]."""
GRID_NM.flags.writeable = False

Below = Literal["error", "zero", "keep"]
"""What to do with energy below the diagonal (emission shorter than excitation)."""


@dataclass(frozen=True, eq=False)
class DonaldsonMatrix:
    """A Donaldson matrix in energy units.

    Attributes:
        matrix: [emission, excitation], shape (Wo, Wi); see the module's text for its unit.
        emission_nm: wavelengths [nm] of the rows, evenly spaced, shape (Wo,).
        excitation_nm: wavelengths [nm] of the columns, evenly spaced, shape (Wi,); same step, and
            wavelengths that both have are the same numbers.
        name: what it is of.
        source: citation or file.
        below: "error" refuses energy below the diagonal, "zero" removes it, "keep" leaves the
            noise of a measured matrix there.
        notes: what was changed on the way in, in words with counts.

    Raises:
        InputError: shapes, wavelengths or numbers that cannot be; energy below the diagonal with
            "error".
    """

    matrix: FloatArray
    emission_nm: FloatArray = field(default_factory=lambda: GRID_NM)
    excitation_nm: FloatArray = field(default_factory=lambda: GRID_NM)
    name: str = ""
    source: str = ""
    below: Below = "error"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        emission = checked_grid(self.emission_nm, "emission_nm")
        excitation = checked_grid(self.excitation_nm, "excitation_nm")
        step = emission[1] - emission[0]
        offset = (excitation[0] - emission[0]) / step
        if abs(excitation[1] - excitation[0] - step) > 1e-6 or abs(offset - round(offset)) > 1e-6:
            raise InputError(
                f"emission every {step:g} nm from {emission[0]:g} nm and excitation every"
                f" {excitation[1] - excitation[0]:g} nm from {excitation[0]:g} nm",
                "one step and common wavelengths",
                place="wavelengths",
            )
        matrix = np.array(self.matrix, dtype=np.float64)
        if matrix.shape != (emission.size, excitation.size):
            raise InputError(
                f"a matrix of shape {matrix.shape}",
                f"{emission.size} rows (emission) and {excitation.size} columns (excitation)",
                place="matrix",
            )
        bad = ~np.isfinite(matrix)
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise InputError(
                f"{int(bad.sum())} cells that are no number, the first at emission"
                f" {emission[row]:g} nm, excitation {excitation[column]:g} nm",
                "a number in every cell",
                place="matrix",
                remedy="Measure them again, or fill them in and say how.",
            )
        under = emission[:, None] < excitation[None, :] - 1e-6
        notes = self.notes
        if self.below not in ("error", "zero", "keep"):
            raise InputError(f"below={self.below!r}", "error, zero or keep", place="below")
        if np.any(matrix[under] != 0.0) and self.below != "keep":
            energy = float(np.abs(matrix[under]).sum())
            if self.below == "error":
                row, column = np.argwhere(under & (matrix != 0.0))[0]
                raise InputError(
                    f"energy below the diagonal ({energy:.3g} in all, the first at emission"
                    f" {emission[row]:g} nm, excitation {excitation[column]:g} nm)",
                    "nothing there: emission is never shorter than excitation",
                    place="matrix",
                    remedy="A transposed matrix? The noise of a measured one: below='zero' removes"
                    " it, below='keep' leaves it.",
                )
            notes = (*notes, f"{energy:.3g} of energy below the diagonal removed")
            matrix[under] = 0.0
        matrix.flags.writeable = False
        for name, value in (("matrix", matrix), ("emission_nm", emission), ("notes", notes)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "excitation_nm", excitation)

    @property
    def wavelength_nm(self) -> FloatArray:
        """The common wavelengths [nm] of a square matrix, shape (W,).

        Raises:
            InputError: emission and excitation have different ones.
        """
        if not np.array_equal(self.emission_nm, self.excitation_nm):
            raise InputError(
                f"emission {_span(self.emission_nm)} and excitation {_span(self.excitation_nm)}",
                "the same wavelengths", place="wavelengths", remedy="Cut it with .on(...).",
            )  # fmt: skip
        return self.emission_nm

    @property
    def step_nm(self) -> float:
        """Width [nm] of a bin."""
        return float(self.emission_nm[1] - self.emission_nm[0])

    @property
    def reflectance(self) -> FloatArray:
        """The diagonal, at every emission wavelength that is an excitation wavelength too, (D,)."""
        return np.asarray(self.matrix[self.is_diagonal])

    @property
    def is_diagonal(self) -> NDArray[np.bool_]:
        """Which cells are the diagonal, shape (Wo, Wi)."""
        return np.abs(self.emission_nm[:, None] - self.excitation_nm[None, :]) < 1e-6

    @property
    def is_fluorescence(self) -> NDArray[np.bool_]:
        """Which cells can hold fluorescence (emission longer than excitation), (Wo, Wi)."""
        return self.emission_nm[:, None] > self.excitation_nm[None, :] + 1e-6

    @property
    def fluorescence(self) -> FloatArray:
        """The matrix with everything but fluorescence set to 0, shape (Wo, Wi)."""
        return np.where(self.is_fluorescence, self.matrix, 0.0)

    @property
    def photons(self) -> FloatArray:
        """The matrix in photon units, shape (Wo, Wi)."""
        return to_photons(self.matrix, self.emission_nm, self.excitation_nm)

    @property
    def photon_yield(self) -> FloatArray:
        """Emitted photons per incident photon at every excitation wavelength, shape (Wi,)."""
        cells = to_photons(self.fluorescence, self.emission_nm, self.excitation_nm)
        return np.asarray(cells.sum(axis=0))

    def on(
        self, emission_nm: ArrayLike = GRID_NM, excitation_nm: ArrayLike | None = None
    ) -> DonaldsonMatrix:
        """The part of the matrix on some of its own wavelengths; nothing is interpolated.

        Args:
            emission_nm: wavelengths [nm] wanted, (Wo,).
            excitation_nm: the same for the columns; None takes `emission_nm`.

        Raises:
            InputError: a wavelength that the matrix does not have.
        """
        rows = _positions(self.emission_nm, emission_nm, "emission", self.name)
        wanted = emission_nm if excitation_nm is None else excitation_nm
        columns = _positions(self.excitation_nm, wanted, "excitation", self.name)
        return replace(
            self,
            matrix=self.matrix[np.ix_(rows, columns)],
            emission_nm=self.emission_nm[rows],
            excitation_nm=self.excitation_nm[columns],
        )

    def physical(self) -> DonaldsonMatrix:
        """The matrix a simulation can light: no energy below the diagonal, no negative cell.

        The noise of a measured matrix is the only reason for either; `notes` counts what went.
        """
        matrix = np.where(
            self.emission_nm[:, None] < self.excitation_nm[None, :] - 1e-6, 0.0, self.matrix
        )
        notes = list(self.notes)
        removed = int(np.count_nonzero(matrix != self.matrix))
        if removed:
            total = float((self.matrix - matrix).sum())
            notes.append(f"{removed} cells of noise below the diagonal ({total:.3g}) set to 0")
        negative = matrix < 0.0
        if negative.any():
            total = float(matrix[negative].sum())
            notes.append(f"{int(negative.sum())} negative cells ({total:.3g}) set to 0")
        return replace(self, matrix=np.maximum(matrix, 0.0), below="error", notes=tuple(notes))

    def with_fluorescence_of(self, *others: DonaldsonMatrix) -> DonaldsonMatrix:
        """This matrix plus the fluorescence of others, its own reflectance kept.

        The seed's two-fluorophore samples: transparent fluorescent slides on top of each other.

        Raises:
            InputError: other wavelengths.
        """
        total = np.array(self.matrix)
        for other in others:
            same = np.array_equal(other.emission_nm, self.emission_nm) and np.array_equal(
                other.excitation_nm, self.excitation_nm
            )
            if not same:
                raise InputError(
                    f"{other.name or 'a matrix'} on {_span(other.emission_nm)}",
                    f"the wavelengths of {self.name or 'the first'}, {_span(self.emission_nm)}",
                    place="wavelengths",
                )
            total = total + other.fluorescence
        return replace(
            self,
            matrix=total,
            name=" + ".join(each.name for each in (self, *others)),
            source="; ".join(dict.fromkeys(e.source for e in (self, *others) if e.source)),
        )

    def reflected(self, light: ArrayLike) -> FloatArray:
        """Energy per emission bin under light of given energies per excitation bin.

        Args:
            light: energy per bin, shape (..., Wi).

        Returns:
            Shape (..., Wo), in the unit of the light.

        Raises:
            InputError: another number of wavelengths.
        """
        energy = np.asarray(light, dtype=np.float64)
        if energy.ndim == 0 or energy.shape[-1] != self.excitation_nm.size:
            raise InputError(
                f"light of shape {energy.shape}", f"{self.excitation_nm.size} bins at the end"
            )
        return np.asarray(energy @ self.matrix.T)


def from_photons(
    matrix: ArrayLike, emission_nm: ArrayLike = GRID_NM, excitation_nm: ArrayLike = GRID_NM
) -> FloatArray:
    """A photon matrix in energy units, D_energy[out, in] = D_photon[out, in] in / out, (Wo, Wi)."""
    out, into = np.asarray(emission_nm, float), np.asarray(excitation_nm, float)
    return np.asarray(np.asarray(matrix, dtype=np.float64) * into[None, :] / out[:, None])


def to_photons(
    matrix: ArrayLike, emission_nm: ArrayLike = GRID_NM, excitation_nm: ArrayLike = GRID_NM
) -> FloatArray:
    """An energy matrix in photon units, D_photon[out, in] = D_energy[out, in] out / in, (Wo, Wi).

    A photon of wavelength lambda has the energy h c / lambda.
    """
    out, into = np.asarray(emission_nm, float), np.asarray(excitation_nm, float)
    return np.asarray(np.asarray(matrix, dtype=np.float64) * out[:, None] / into[None, :])


def checked_grid(wavelength_nm: ArrayLike, place: str) -> FloatArray:
    """Evenly spaced increasing wavelengths [nm] above 0, shape (W,), read-only.

    Raises:
        InputError: they are not.
    """
    grid = np.array(wavelength_nm, dtype=np.float64)
    if grid.ndim != 1 or grid.size < 2 or not np.all(np.isfinite(grid)) or grid.min() <= 0:
        raise InputError(
            f"wavelengths of shape {grid.shape}", "two or more numbers above 0 [nm]", place=place
        )
    steps = np.diff(grid)
    if steps.min() <= 0 or np.ptp(steps) > 1e-6:
        raise InputError(
            f"steps of {steps.min():g} to {steps.max():g} nm",
            "wavelengths that increase evenly", place=place,
        )  # fmt: skip
    grid.flags.writeable = False
    return grid


def _positions(have: FloatArray, wanted: ArrayLike, what: str, name: str) -> NDArray[np.intp]:
    grid = checked_grid(wanted, f"{what}_nm")
    distance = np.abs(have[:, None] - grid[None, :])
    missing = distance.min(axis=0) > 1e-6
    if missing.any():
        raise InputError(
            f"{what} at {grid[missing][0]:g} nm asked of {name or 'a matrix'}",
            f"wavelengths of its own, {_span(have)} in steps of {have[1] - have[0]:g} nm",
            place=f"{what}_nm", remedy="Nothing is interpolated or extrapolated.",
        )  # fmt: skip
    return np.asarray(distance.argmin(axis=0))


def _span(grid: FloatArray) -> str:
    return f"{grid[0]:g} to {grid[-1]:g} nm"
