"""Published spectra of glasses, backgrounds, lamps and scattering media, each with its citation.

A `Spectral` that a person wrote (number, table or name) becomes an array here:
`refractive_index`, `reflectance`, `lamp`, and `optical_properties` for a medium. Nothing is
extrapolated: a wavelength outside the source raises `InputError`. docs/materials.md lists all.
"""

from __future__ import annotations

from twin.materials.entry import Entry
from twin.materials.library import (
    Kind,
    checked_properties,
    entry,
    lamp,
    material,
    names,
    optical_properties,
    reflectance,
    refractive_index,
)
from twin.materials.material import Coefficients, Material, OpticalProperties, Share, mixture

__all__ = [
    "Coefficients",
    "Entry",
    "Kind",
    "Material",
    "OpticalProperties",
    "Share",
    "checked_properties",
    "entry",
    "lamp",
    "material",
    "mixture",
    "names",
    "optical_properties",
    "reflectance",
    "refractive_index",
]
