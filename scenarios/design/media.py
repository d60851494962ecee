"""Materials that a study is about: of the library, or points of a range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from twin.spectra import FloatArray, Part, Spectral


class MaterialOfInterest(Part):
    """A material of the library, or a range of materials."""

    name: str = Field(min_length=1)
    """A name of the library or a composition; with a range, what it is called."""
    n: Spectral = 1.5
    """Refractive index."""
    albedo: tuple[float, float] | float | None = None
    """A range, or a number; all three of them or none."""
    sigma_t_per_mm: tuple[float, float] | float | None = None
    g: tuple[float, float] | float | None = None
    count: int = Field(default=4, ge=1, le=64)
    """Materials that stand for a range."""

    @model_validator(mode="after")
    def _range(self) -> MaterialOfInterest:
        given = [self.albedo, self.sigma_t_per_mm, self.g]
        if any(each is None for each in given) and any(each is not None for each in given):
            raise ValueError("found a part of a range; expected albedo, sigma_t_per_mm and g")
        limits = (("albedo", 0.0, 1.0), ("sigma_t_per_mm", 0.0, 1e3), ("g", -0.999, 0.999))
        for name, low, high in limits:
            value = getattr(self, name)
            if value is None:
                continue
            ends = value if isinstance(value, tuple) else (value, value)
            if not low <= ends[0] <= ends[1] <= high or (name == "sigma_t_per_mm" and ends[0] <= 0):
                raise ValueError(
                    f"found {name} {value}; expected increasing numbers from {low:g} to {high:g}"
                )
        return self

    def media(self) -> list[Medium]:
        """The materials that stand for it: itself, or points of a Halton sequence."""
        if self.albedo is None:
            return [Medium(self.name, self.n, None)]
        from scipy.stats import qmc

        ends = np.array(
            [
                each if isinstance(each, tuple) else (each, each)
                for each in (self.albedo, self.sigma_t_per_mm, self.g)
            ]
        )  # fmt: skip
        if np.all(ends[:, 0] == ends[:, 1]):
            return [
                Medium(self.name, self.n, (float(ends[0, 0]), float(ends[1, 0]), float(ends[2, 0])))
            ]
        places = qmc.Halton(3, scramble=False).random(self.count + 1)[1:]
        low, high = ends.T.copy()
        low[1], high[1] = np.log(low[1]), np.log(high[1])
        values = low + places * (high - low)
        values[:, 1] = np.exp(values[:, 1])
        return [
            Medium(f"{self.name} {number}", self.n, (float(a), float(s), float(g)))
            for number, (a, s, g) in enumerate(values, 1)
        ]


@dataclass(frozen=True)
class Medium:
    """One material: of the library, or the same at all wavelengths.

    Attributes:
        name: what it is called; the library's name where `values` is None.
        n: refractive index.
        values: albedo, sigma_t [1/mm], g; None: of the library.
    """

    name: str
    n: Spectral
    values: tuple[float, float, float] | None

    @property
    def material(self) -> Any:
        """As a sample of a scenario says it."""
        if self.values is None:
            return self.name
        names = ("albedo", "sigma_t_per_mm", "g")
        return dict(zip(names, self.values, strict=True))

    def at(self, wavelength_nm: FloatArray) -> FloatArray:
        """Albedo, sigma_t [1/mm] and g, shape (W, 3).

        Raises:
            InputError: an unknown name, or wavelengths that its spectrum does not cover.
        """
        from twin.materials import optical_properties

        if self.values is not None:
            return np.tile(self.values, (len(wavelength_nm), 1))
        found = optical_properties(self.name, wavelength_nm)
        return np.stack([found.albedo, found.sigma_t_per_mm, found.g], axis=-1)
