"""The forward world: bench, materials, light transport, instruments, measurements.

A `Bench` and a `Sample` go into `twin.transport.captures`, which gives noiseless relative
intensities; `twin.instrument` turns spectra into counts; `twin.measurement` keeps the counts of
a visit and corrects them; `appearance_map` tabulates the bench for estimators.
"""

from twin.appearance import AppearanceMap, MapGrid, appearance_map
from twin.bench import Background, Backgrounds, Beam, Bench, Detector, Layer, Medium, Panel, Sample
from twin.errors import InputError
from twin.materials import OpticalProperties, optical_properties
from twin.spectra import Spectral, SpectralTable

__all__ = [
    "AppearanceMap",
    "Background",
    "Backgrounds",
    "Beam",
    "Bench",
    "Detector",
    "InputError",
    "Layer",
    "MapGrid",
    "Medium",
    "OpticalProperties",
    "Panel",
    "Sample",
    "Spectral",
    "SpectralTable",
    "appearance_map",
    "optical_properties",
]
