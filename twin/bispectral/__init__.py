"""Fluorescence inside the translucent stack: absorbed at one wavelength, re-emitted at a longer.

Two routes: `trace_bispectral`, a Monte Carlo of the whole finite bench in Warp, is the truth;
`donaldson` multiplies two depth profiles of the plane-parallel stack, milliseconds and
differentiable. `energy_ledger` follows light forwards and accounts for all its energy.
`fluorescence_excess` is what a fluorescent sample adds to the white-lit captures.
"""

from __future__ import annotations

from twin.bispectral.engine import BispectralCaptures, trace_bispectral
from twin.bispectral.excess import fluorescence_excess
from twin.bispectral.ledger import Ledger, energy_ledger
from twin.bispectral.medium import (
    FluorescentMedium,
    FluorescentProperties,
    Fluorophore,
    bin_widths,
    emission_table,
    fluorescent_properties,
    photon_density,
)
from twin.bispectral.profiles import Donaldson, donaldson

__all__ = [
    "BispectralCaptures",
    "Donaldson",
    "FluorescentMedium",
    "FluorescentProperties",
    "Fluorophore",
    "Ledger",
    "bin_widths",
    "donaldson",
    "emission_table",
    "energy_ledger",
    "fluorescence_excess",
    "fluorescent_properties",
    "photon_density",
    "trace_bispectral",
]
