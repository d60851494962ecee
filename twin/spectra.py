"""Spectra as a person writes them (number, table or library name) and as arrays."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

FloatArray = NDArray[np.float64]


class Part(BaseModel):
    """Base of every description a person writes: immutable, no unknown keys, no NaN."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


class SpectralTable(Part):
    """A sampled spectrum: linear between its samples, undefined outside them."""

    wavelength_nm: tuple[float, ...]
    """Wavelengths [nm], strictly increasing, at least two."""
    value: tuple[float, ...]
    """Values, one per wavelength."""

    @model_validator(mode="after")
    def _check(self) -> SpectralTable:
        if len(self.wavelength_nm) != len(self.value):
            raise ValueError(
                f"found {len(self.wavelength_nm)} wavelengths and {len(self.value)} values;"
                " expected as many of each"
            )
        if len(self.value) < 2:
            raise ValueError("found fewer than two samples; expected two or more")
        steps = np.diff(self.wavelength_nm)
        if np.any(steps <= 0):
            index = int(np.argmax(steps <= 0))
            raise ValueError(
                f"found {self.wavelength_nm[index + 1]:g} nm after"
                f" {self.wavelength_nm[index]:g} nm; expected wavelengths that increase"
            )
        return self

    def at(self, wavelength_nm: FloatArray) -> FloatArray:
        """Linear interpolation at wavelengths [nm], shape (W,).

        Raises:
            ValueError: a wavelength lies outside the table.
        """
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        low, high = self.wavelength_nm[0], self.wavelength_nm[-1]
        if wavelength.size and (wavelength.min() < low or wavelength.max() > high):
            raise ValueError(
                f"found wavelengths {wavelength.min():g} to {wavelength.max():g} nm; expected them"
                f" inside the table's {low:g} to {high:g} nm"
            )
        return np.interp(wavelength, self.wavelength_nm, self.value)


Spectral = Annotated[
    Annotated[float, Field(strict=True)] | str | SpectralTable, Field(union_mode="left_to_right")
]
"""A number (the same at every wavelength), a name in the library, or a table."""
