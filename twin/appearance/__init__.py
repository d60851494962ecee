"""The appearance map: what the bench reads for every (albedo, sigma_t, g) of a thin sample.

Iser et al. 2022, section 3: the map relates (I_black, I_white, I_collimated) to (albedo,
sigma_t, g) for one thickness, refractive index and bench. One set of paths per (sigma_t, g)
serves all albedos, and the map keeps the powers of the backgrounds' reflectance apart, so one
map serves every wavelength whatever the backgrounds' spectra.
"""

from twin.appearance.compute import MAP_VERSION, appearance_map, map_key, map_slab, slab_path
from twin.appearance.factors import FiniteFactors, finite_captures
from twin.appearance.grid import MapGrid
from twin.appearance.table import AppearanceMap

__all__ = [
    "MAP_VERSION",
    "AppearanceMap",
    "FiniteFactors",
    "MapGrid",
    "appearance_map",
    "finite_captures",
    "map_key",
    "map_slab",
    "slab_path",
]
