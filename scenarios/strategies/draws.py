"""Hypothesis strategies that shrink to small readable cases.

Every number shrinks towards a round one (albedo 0.5, sigma_t 1/mm, g 0), every spectrum towards
a constant, every bench towards the default bench.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from scenarios.strategies.effect_worlds import Effects
from scenarios.strategies.problem import Measured, Noise, Problem, World
from scenarios.strategies.worlds import fast_engine
from twin.bench import COVER_GLASS, Background, Backgrounds, Bench, Detector, Panel
from twin.instrument.spec import MultispectralChip, Spectrometer
from twin.spectra import FloatArray

Instrument = Spectrometer | MultispectralChip


def numbers(simplest: float, low: float, high: float, step: float) -> st.SearchStrategy[float]:
    """Multiples of a step away from the simplest number, inside low to high."""
    least, most = round((low - simplest) / step), round((high - simplest) / step)
    return st.integers(least, most).map(lambda k: round(simplest + k * step, 10))


@st.composite
def materials(
    draw: st.DrawFn,
    wavelengths: int | None = None,
    *,
    optical_depth: tuple[float, float] = (0.25, 4.0),
    albedo: tuple[float, float] = (0.3, 0.98),
    g: tuple[float, float] = (-0.2, 0.8),
) -> FloatArray:
    """Albedo, sigma_t [1/mm] and g of smooth spectra, shape (W, 3).

    The defaults are materials that two samples of 0.5 and 1 mm determine.

    Args:
        draw: given by hypothesis.
        wavelengths: W; None draws 1 to 4.
        optical_depth: least and greatest sigma_t times 1 mm.
        albedo: least and greatest.
        g: least and greatest.
    """
    count = wavelengths or draw(st.integers(1, 4))
    columns = []
    for simplest, (low, high), step in (
        (min(max(0.5, albedo[0]), albedo[1]), albedo, 0.01),
        (min(max(1.0, optical_depth[0]), optical_depth[1]), optical_depth, 0.25),
        (min(max(0.0, g[0]), g[1]), g, 0.05),
    ):
        start = draw(numbers(simplest, low, high, step))
        end = draw(st.just(start) | numbers(simplest, low, high, step))
        columns.append(np.linspace(start, end, count))
    return np.stack(columns, axis=-1)


def benches() -> st.SearchStrategy[Bench]:
    """The default bench, or one with other covers, backgrounds, gap, size and panels."""
    covers = st.sampled_from([(), (COVER_GLASS,)])
    drawn = st.builds(
        _bench,
        covers,
        covers,
        numbers(0.05, 0.0, 0.2, 0.05),
        numbers(0.9, 0.6, 1.0, 0.05),
        numbers(0.5, 0.0, 2.0, 0.5),
        st.sampled_from([None, (40.0, 40.0), (25.0, 60.0)]),
        numbers(300.0, 200.0, 500.0, 50.0),
        numbers(1.0, 0.5, 3.0, 0.5),
    )
    return st.just(Bench()) | drawn


def _bench(
    above: Any,
    below: Any,
    black: float,
    white: float,
    gap: float,
    size: tuple[float, float] | None,
    distance: float,
    acceptance: float,
) -> Bench:
    return Bench(
        panels=tuple(Panel(distance_mm=distance, azimuth_deg=turn) for turn in (0.0, 180.0)),
        covers_above=above,
        covers_below=below,
        size_mm=size,
        background=Backgrounds(
            gap_mm=gap,
            black=Background(reflectance=black, shape="rectangle", size_mm=(40.0, 40.0)),
            white=Background(reflectance=white),
        ),
        detector=Detector(acceptance_deg=acceptance),
    )


def instruments() -> st.SearchStrategy[Instrument]:
    """The default spectrometer, other ones, and multispectral chips."""
    averages = st.sampled_from([10, 1, 100])
    spectrometers = st.builds(
        Spectrometer,
        averages=averages,
        adc_bits=st.sampled_from([16, 14, 12]),
        dark_level_counts=st.sampled_from([100.0, 500.0]),
        read_noise_electrons=numbers(31.0, 1.0, 101.0, 10.0),
        bandwidth_nm=numbers(2.0, 1.0, 10.0, 1.0),
        step_nm=st.sampled_from([10.0, 2.0, 5.0]),
    )
    chips = st.builds(MultispectralChip, averages=averages)
    default: st.SearchStrategy[Instrument] = st.just(Spectrometer())
    return default | spectrometers | chips


def noises() -> st.SearchStrategy[Noise]:
    """1 % of one shot, or another level, and 1, 4 or 9 shots averaged."""
    return st.builds(
        Noise,
        relative=st.sampled_from([0.01, 0.003, 0.02]),
        averages=st.sampled_from([1, 4, 9]),
    )


@st.composite
def problems(
    draw: st.DrawFn,
    wavelengths: int | None = None,
    *,
    bench: st.SearchStrategy[Bench] | None = None,
    thickness_mm: st.SearchStrategy[tuple[float, ...]] | None = None,
    material: st.SearchStrategy[FloatArray] | None = None,
    effects: st.SearchStrategy[Effects] | None = None,
) -> Problem:
    """Problems on the default bench with samples of 0.5 and 1 mm, unless told otherwise.

    A new bench costs the engine seconds of compilation, a new material milliseconds: hence
    only the material and the noise vary by default.

    Args:
        draw: given by hypothesis.
        wavelengths: W; None draws 1 to 4.
        bench: for example `benches()`.
        thickness_mm: thicknesses [mm] of the samples.
        material: for example `materials(optical_depth=(10.0, 20.0))`, shape (W, 3).
        effects: what is true and not told, for example `effects()`, on the samples above.
    """
    values = draw(materials(wavelengths) if material is None else material)
    return Problem.of(
        values,
        bench=draw(bench or st.just(Bench())),
        thickness_mm=draw(thickness_mm or st.just((0.5, 1.0))),
        noise=draw(noises()),
        seed=draw(st.integers(0, 99)),
        effects=draw(effects) if effects is not None else None,
    )


def measurements(
    problem: st.SearchStrategy[Problem] | None = None, world: World = fast_engine
) -> st.SearchStrategy[Measured]:
    """Relative intensities of problems by an engine: `fast_engine` or `monte_carlo`.

    Args:
        problem: for example `problems(effects=effects())`, a world that is not as described.
        world: the engine.
    """
    drawn = problems() if problem is None else problem
    return drawn.map(lambda found: found.measured(world))
