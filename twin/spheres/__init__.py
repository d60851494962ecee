"""Integrating spheres: what they read from a slab, substitution error and lost light included.

`sphere_readings` holds the formulas, `SphereModel` ties them to a measurement (see
`twin.measurement.rxt`) and to the adding-doubling engine, `LossTable` finds the light that
misses the ports.
"""

from __future__ import annotations

from twin.spheres.lost import LossGeometry, LossTable, LostLight, walk_losses
from twin.spheres.model import SphereModel
from twin.spheres.readings import (
    Lost,
    SampleLight,
    SphereSetup,
    Surfaces,
    exchange,
    sphere_readings,
)
from twin.spheres.sphere import IntegratingSphere, cap_share

__all__ = [
    "IntegratingSphere",
    "LossGeometry",
    "LossTable",
    "Lost",
    "LostLight",
    "SampleLight",
    "SphereModel",
    "SphereSetup",
    "Surfaces",
    "cap_share",
    "exchange",
    "sphere_readings",
    "walk_losses",
]
