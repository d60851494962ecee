"""What the finite bench and further re-emissions change, by one Monte Carlo near the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from twin.bench import Bench, Sample
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bispectral import FluorescentProperties


SLOPE = 0.02
"""Expected size of the slopes of a fluorescent ratio over the range of wavelengths."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Ratios of the whole bench to the plane-parallel stack; smooth over wavelength.

    Attributes:
        elastic: (S, 3, W); fluorescent: (S, 2, W out, W in).
        error, emission_error: relative standard errors of both, medians.
    """

    elastic: FloatArray
    fluorescent: FloatArray
    error: float
    emission_error: float


def correction_of(
    bench: Bench,
    samples: Sequence[Sample],
    properties: FluorescentProperties,
    *,
    paths: int = 32_768,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Correction:
    """Ratios of the Monte Carlo to the plane-parallel engine at one material.

    The ratios are a few parts in a hundred from 1 and depend on the material weakly, so a
    straight line over wavelength (for fluorescence a plane over both) averages the Monte
    Carlo's noise away; elastic captures of both worlds are told by the same paths.

    Args:
        bench: the bench.
        samples: what was measured on it.
        properties: of the first estimate.
        paths: for each wavelength and sample.
        seed: of the Monte Carlo.
        threads: None takes all processors.
        progress: called with (done, total) samples.
    """
    from twin.bispectral import donaldson, trace_bispectral

    wave = properties.wavelength_nm
    fast = donaldson(bench, samples, properties)
    elastic = np.ones_like(fast.elastic)
    fluorescent = np.ones_like(fast.fluorescent[:, :2])
    errors, emission_errors = [], []
    for s, sample in enumerate(samples):
        ratio, error = _paired(
            bench, sample, properties, fast.elastic[s], paths=paths, seed=seed + s, threads=threads
        )
        # a straight line through W ratios is known better than each of them
        errors.append(float(np.median(error[:2])) * np.sqrt(2.0 / len(wave)))
        traced = trace_bispectral(
            bench, sample, properties, paths=paths, seed=seed + s, threads=threads
        )
        for c in range(3):
            elastic[s, c] = _line(wave, ratio[c])
        for b in range(2):
            fluorescent[s, b], deviation = _plane(
                wave, fast.fluorescent[s, b], traced.fluorescent[b]
            )
            emission_errors.append(deviation)
        if progress is not None:
            progress(s + 1, len(samples))
    return Correction(
        elastic, fluorescent, float(np.median(errors)), float(np.median(emission_errors))
    )


def _paired(
    bench: Bench,
    sample: Sample,
    properties: FluorescentProperties,
    unbounded: FloatArray,
    *,
    paths: int,
    seed: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Elastic captures of the whole bench over those of the unbounded stack, by the same paths.

    Args:
        bench: the bench.
        sample: on it.
        properties: of its medium.
        unbounded: captures of the unbounded stack by the fast engine, (3, W).
        paths: for each wavelength.
        seed: of the Monte Carlo.
        threads: None takes all processors.

    Returns:
        Ratios and their standard errors, (3, W) each.
    """
    from twin.materials import reflectance
    from twin.transport import Tallies, beam_setup, flat_stacks, panels_setup, run_many, trace
    from twin.transport.bench_captures import BEAM_STREAM, PANELS_STREAM, effort_for
    from twin.transport.engine import BLACK, UNBOUNDED_STACK, WHITE

    wave, optical = properties.wavelength_nm, properties.optical()
    stacks = flat_stacks(bench, sample, wave, optical)
    setups = (panels_setup(bench, stacks[0].height), beam_setup(bench))
    rho = (
        reflectance(bench.background.black.reflectance, wave),
        reflectance(bench.background.white.reflectance, wave),
    )

    def job(w: int, lamp: int) -> Callable[[], Tallies]:
        effort = replace(effort_for(float(optical.albedo[w]), paths), paired=True)
        stream = (PANELS_STREAM, BEAM_STREAM)[lamp] + 16 * w
        return lambda: trace(stacks[w], setups[lamp], effort, seed=seed, stream=stream)

    jobs = [job(w, lamp) for lamp in range(2) for w in range(len(wave))]
    traced = run_many(jobs, threads)
    ratio, error = np.empty((2, 3, len(wave)))
    for w in range(len(wave)):
        albedo = np.array([optical.albedo[w]])
        for c, (channel, bounced) in enumerate(
            ((BLACK, float(rho[0][w])), (WHITE, float(rho[1][w])), (BLACK, 1.0))
        ):
            tallies = traced[w + (len(wave) if c == 2 else 0)]
            powers = bounced**tallies.bounce
            # differences: light that is not scattered is the same in both, and not in both tallies
            apart = tallies.blocks_by_albedo(channel, albedo)[:, 0] @ powers
            apart = apart - tallies.blocks_by_albedo(channel, np.zeros(1))[:, 0] @ powers
            apart = apart - tallies.blocks_by_albedo(UNBOUNDED_STACK, albedo)[:, 0] @ powers
            apart = apart + tallies.blocks_by_albedo(UNBOUNDED_STACK, np.zeros(1))[:, 0] @ powers
            ratio[c, w] = 1.0 + apart.mean() / unbounded[c, w]
            error[c, w] = apart.std(ddof=1) / np.sqrt(len(apart)) / unbounded[c, w]
    return ratio, error


def _line(x: FloatArray, ratio: FloatArray) -> FloatArray:
    """Straight line through ratios over x, (W,)."""
    design = np.stack([np.ones_like(x), x - x.mean()], axis=1)
    return np.asarray(design @ np.linalg.lstsq(design, ratio, rcond=None)[0])


def _plane(wave: FloatArray, fast: FloatArray, traced: FloatArray) -> tuple[FloatArray, float]:
    """Plane through the ratios over (out, in), (W, W), weighted by how much each fluoresces."""
    scale = np.ptp(wave)
    out, into = np.meshgrid(*(2 * [(wave - wave.mean()) / scale]), indexing="ij")
    design = np.stack([np.ones_like(out), out, into], axis=-1)
    # cells that hardly fluoresce say nothing. A cell's own standard error must not weigh it: a
    # cell that came out low looks well known, so the variance is taken as that of counting
    known = fast > 1e-3 * fast.max()
    if known.sum() < 4:
        return np.ones_like(fast), 0.0
    rows, ratio, weight = design[known], traced[known] / fast[known], fast[known]
    level = float(weight @ ratio / weight.sum())
    scatter = float(weight @ (ratio - level) ** 2) / max(1, len(ratio) - 1)
    # slopes of more than a few parts in a hundred are noise: the ratio depends on little
    before = np.diag([0.0, 1.0, 1.0]) * scatter / SLOPE**2
    normal = np.linalg.inv(rows.T @ (rows * weight[:, None]) + before)
    line = normal @ (rows.T @ (weight * ratio))
    spread = np.sqrt(scatter * np.einsum("ki,ij,kj->k", rows, normal, rows))
    return design @ line, float(np.average(spread, weights=weight))
