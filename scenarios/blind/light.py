"""Light of a world by the Monte Carlo, with errors of black and white that are independent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenarios.stress.design import derived_seed
from twin.effects import World, world_captures
from twin.spectra import FloatArray
from twin.transport import NoiselessCaptures


def light_of(
    world: World, wavelength_nm: FloatArray, paths: int, seed: int, threads: int | None = None
) -> list[NoiselessCaptures]:
    """Noiseless captures of all samples, each of its own material.

    The Monte Carlo takes black and white from the same paths, so that their errors go together
    (correlations up to 0.99 in thick samples), but a measurement states one standard error for
    each. Two independent runs are made: one gives black, the other white, both the collimated.

    Args:
        world: the world; its samples have materials.
        wavelength_nm: [nm], shape (W,).
        paths: per wavelength of each run.
        seed: of the paths.
        threads: None takes all processors.

    Raises:
        InputError: a spectrum that does not cover a wavelength.
    """
    count = len(world.samples)
    first, second = (
        world_captures(
            world, wavelength_nm, paths=paths, threads=threads,
            seeds=[derived_seed(seed, run, number) for number in range(count)],
        )
        for run in (1, 2)
    )  # fmt: skip
    return [
        replace(
            one,
            white=other.white,
            white_se=other.white_se,
            collimated=0.5 * (one.collimated + other.collimated),
            collimated_se=0.5 * np.hypot(one.collimated_se, other.collimated_se),
        )
        for one, other in zip(first, second, strict=True)
    ]
