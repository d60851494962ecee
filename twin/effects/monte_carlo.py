"""The Monte Carlo on a world: captures of all samples, with every effect on the light."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from twin.bench import Bench, Layer, Medium, Sample
from twin.effects.world import Sublayer, World
from twin.errors import InputError
from twin.materials import OpticalProperties, optical_properties
from twin.spectra import FloatArray, Spectral, SpectralTable
from twin.transport import NoiselessCaptures, captures


def world_captures(
    world: World,
    wavelength_nm: FloatArray,
    *,
    properties: OpticalProperties | None = None,
    paths: int = 65_536,
    seeds: Sequence[int] = (0,),
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[NoiselessCaptures]:
    """Noiseless relative intensities of every sample of a world, by the Monte Carlo.

    Args:
        world: the world; mixtures are averaged over, with the same random numbers.
        wavelength_nm: [nm], shape (W,).
        properties: the material of all samples; None takes each sample's own.
        paths: per wavelength for the panels.
        seeds: one for each sample, or one for all.
        threads: None takes all processors.
        progress: called with (done, total) samples.

    Raises:
        InputError: a sample without a material, or a spectrum that does not cover a wavelength.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    views = world.views()
    results = []
    for number, sample in enumerate(world.samples):
        medium = properties
        if medium is None:
            if sample.material is None:
                raise InputError(
                    "no material", "a library name or numbers",
                    place=f"sample {sample.name}.material",
                )  # fmt: skip
            medium = optical_properties(sample.material, wavelength)
        found = []
        for index, view in enumerate(views):

            def part(done: int, all_: int, /, at: float = number + index / len(views)) -> None:
                if progress is not None:
                    progress(at + done / all_ / len(views), len(world.samples))

            bench, own, inside = staged(world, view.bench, view.samples[number], medium)
            found.append(
                captures(
                    bench,
                    own,
                    wavelength,
                    properties=inside,
                    paths=paths,
                    seed=seeds[number % len(seeds)],
                    threads=threads,
                    progress=part,
                )
            )
        results.append(found[0] if len(views) == 1 else _averaged(found, views))
    return results


def _averaged(found: Sequence[NoiselessCaptures], views: Sequence[object]) -> NoiselessCaptures:
    """Weighted mean; the errors of common random numbers add up."""
    weights = np.array([getattr(view, "weight") for view in views])  # noqa: B009
    names = ("black", "white", "collimated")
    fields = {}
    for column, name in enumerate(names):
        for each in (name, f"{name}_se"):
            rows = np.stack([getattr(own, each) for own in found])
            fields[each] = weights[:, column] @ rows
    return replace(found[0], **fields)


def staged(
    world: World, bench: Bench, sample: Sample, medium: OpticalProperties
) -> tuple[Bench, Sample, OpticalProperties]:
    """One sample as the Monte Carlo takes it: its inside in layers, its second lobe.

    Layers of one index have no face between them; all but the lowest go among the covers above.
    """
    share, second_g = world.second_lobe
    if share:
        medium = replace(medium, second_share=share, second_g=second_g)
    if not world.sublayers:
        return bench, sample, medium
    above = list(bench.covers_above)
    for layer in world.sublayers[:-1]:
        own = _scaled(medium, layer)
        above.append(
            Layer(
                thickness_mm=layer.share * sample.thickness_mm,
                n=sample.n,
                medium=Medium(
                    albedo=_table(own.wavelength_nm, own.albedo),
                    sigma_t_per_mm=_table(own.wavelength_nm, own.sigma_t_per_mm),
                    g=_table(own.wavelength_nm, own.g),
                    second_share=own.second_share,
                    second_g=own.second_g,
                ),
            )
        )
    last = world.sublayers[-1]
    rest = sample.model_copy(update={"thickness_mm": last.share * sample.thickness_mm})
    return bench.model_copy(update={"covers_above": tuple(above)}), rest, _scaled(medium, last)


def _scaled(medium: OpticalProperties, layer: Sublayer) -> OpticalProperties:
    """The medium of one layer: scattering and absorption times their factors."""
    scattering = layer.scattering * medium.albedo * medium.sigma_t_per_mm
    absorption = layer.absorption * (1.0 - medium.albedo) * medium.sigma_t_per_mm
    total = scattering + absorption
    albedo = np.divide(scattering, total, out=np.zeros_like(total), where=total > 0.0)
    return replace(medium, albedo=np.clip(albedo, 0.0, 1.0), sigma_t_per_mm=total)


def _table(wavelength_nm: FloatArray, value: FloatArray) -> Spectral:
    if len(wavelength_nm) == 1:
        return float(value[0])
    return SpectralTable(
        wavelength_nm=tuple(wavelength_nm.tolist()), value=tuple(np.asarray(value).tolist())
    )
