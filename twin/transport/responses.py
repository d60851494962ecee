"""How captures answer to a change of the bench: paired blocks with common random numbers.

Both benches are traced with the same random numbers, so that most of the noise of the
captures is the same in both and leaves their difference. Paths are not sorted here: a sorted
population hands a path's random numbers to its neighbour as soon as one path is lost in one
bench alone, while a path with a stream of its own goes the same way in both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.materials import OpticalProperties, optical_properties, reflectance
from twin.spectra import FloatArray
from twin.transport.bench_captures import (
    BEAM_STREAM,
    PANELS_STREAM,
    collected_share,
    effort_for,
    flat_stacks,
)
from twin.transport.engine import BLACK, WHITE, Setup, mean_and_error, run_many, trace
from twin.transport.geometry import beam_setup, four_fold, panels_setup


def capture_blocks(
    bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    *,
    properties: OpticalProperties | None = None,
    paths: int = 8192,
    seed: int = 0,
    threads: int | None = None,
    turned: bool | None = None,
) -> FloatArray:
    """Noiseless relative intensities by independent blocks, shape (32 blocks, W, 3).

    Args:
        bench: the bench.
        sample: the sample.
        wavelength_nm: [nm], shape (W,).
        properties: the sample's medium; None takes `sample.material`.
        paths: per wavelength for the panels and for the beam, rounded to 32 times a power of two.
        seed: blocks of the same seed and of the same number of paths can be subtracted.
        threads: None takes all processors.
        turned: see `panels_setup`; must be the same in what is subtracted.

    Raises:
        InputError: the sample has no material, or a spectrum does not cover a wavelength.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    if properties is None:
        if sample.material is None:
            raise InputError(
                "no material", "a library name or numbers", place=f"sample {sample.name}.material"
            )
        properties = optical_properties(sample.material, wavelength)
    stacks = flat_stacks(bench, sample, wavelength, properties)
    height = stacks[0].height
    panels, beam = panels_setup(bench, height, turned), beam_setup(bench)
    share = collected_share(bench, height)
    rho = [
        reflectance(background.reflectance, wavelength)
        for background in (bench.background.black, bench.background.white)
    ]
    albedo = np.asarray(properties.albedo, dtype=np.float64)

    def job(w: int, setup: Setup, stream: int) -> Callable[[], list[FloatArray]]:
        effort = replace(effort_for(float(albedo[w]), paths), lattice=False, common=True)

        def run() -> list[FloatArray]:
            tallies = trace(stacks[w], setup, effort, seed=seed, stream=stream + 16 * w)
            own = albedo[[w]]
            if setup is beam:
                return [tallies.blocks_by_albedo(BLACK, own)[:, 0].sum(axis=-1) / share]
            return [
                tallies.blocks_by_albedo(channel, own)[:, 0]
                @ float(rho[channel][w]) ** tallies.bounce
                for channel in (BLACK, WHITE)
            ]

        return run

    count = len(wavelength)
    jobs = [job(w, panels, PANELS_STREAM) for w in range(count)]
    jobs += [job(w, beam, BEAM_STREAM) for w in range(count)]
    found = run_many(jobs, threads)
    rows = [[*found[w], *found[count + w]] for w in range(count)]
    return np.array(rows).transpose(2, 0, 1)


def response(
    bench: Bench,
    changed_bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    *,
    changed_sample: Sample | None = None,
    properties: OpticalProperties | None = None,
    changed_properties: OpticalProperties | None = None,
    paths: int = 8192,
    seed: int = 0,
    threads: int | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Change of the relative intensities from one bench to another, and its standard error.

    For many changes of one bench, `capture_blocks` of the unchanged bench need be computed
    once: the response is `mean_and_error(changed - unchanged)`.

    Args:
        bench: before.
        changed_bench: after.
        sample: on the bench before, and after unless `changed_sample` is given.
        changed_sample: on the bench after.
        wavelength_nm: [nm], shape (W,).
        properties: the medium before; None takes the material of `sample`.
        changed_properties: the medium after; None takes that of `changed_sample` when it is
            given with a material, else that before.
        paths: see `capture_blocks`.
        seed: see `capture_blocks`.
        threads: None takes all processors.

    Returns:
        (difference, standard error), shape (W, 3) each: black, white, collimated.

    Raises:
        InputError: a sample without a material, or a spectrum that does not cover a wavelength.
    """
    after = changed_sample or sample
    if changed_properties is None and (changed_sample is None or after.material is None):
        changed_properties = properties
    turned = four_fold(bench) and four_fold(changed_bench)
    blocks = [
        capture_blocks(
            own_bench, own_sample, wavelength_nm, properties=medium, paths=paths, seed=seed,
            threads=threads, turned=turned,
        )
        for own_bench, own_sample, medium in (
            (bench, sample, properties),
            (changed_bench, after, changed_properties),
        )
    ]  # fmt: skip
    return mean_and_error(blocks[1] - blocks[0])
