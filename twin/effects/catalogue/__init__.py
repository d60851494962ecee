"""The effects that are built in, one small file each, in the order of the light path."""

from twin.effects.catalogue import (
    ambient,
    background,
    beam,
    covers,
    depth,
    detector,
    drift,
    fluorescence_bench,
    fluorescent,
    index,
    lateral,
    panels,
    phase,
    roughness,
    thickness,
    wavelength,
)

EFFECTS = (
    drift.EFFECT,
    *panels.EFFECTS,
    ambient.EFFECT,
    *beam.EFFECTS,
    *thickness.EFFECTS,
    index.EFFECT,
    roughness.EFFECT,
    *covers.EFFECTS,
    *lateral.EFFECTS,
    depth.EFFECT,
    phase.EFFECT,
    fluorescent.EFFECT,
    *background.EFFECTS,
    *detector.EFFECTS,
    *wavelength.EFFECTS,
    *fluorescence_bench.EFFECTS,
)
"""Every built-in effect."""

__all__ = ["EFFECTS"]
