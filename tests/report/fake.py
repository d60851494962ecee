"""A made-up visit, result and map from closed forms (two-stream), quick enough for every test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.result import QUANTILE_LEVELS, EstimateResult, Status, gaussian_quantiles
from twin.bench import Background, Backgrounds, Beam, Bench, Sample
from twin.instrument.spec import MultispectralChip, Spectrometer
from twin.measurement import (
    Captures,
    Measurement,
    Provenance,
    Shot,
    Truth,
    relative_intensities,
)
from twin.spectra import FloatArray, SpectralTable

REFLECTIONS = 24


def two_stream(
    albedo: FloatArray, sigma_t: FloatArray, g: FloatArray, thickness_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Reflectance, diffuse and collimated transmittance of a slab (Kubelka and Munk 1931)."""
    scatter = np.maximum(0.75 * albedo * (1 - g) * sigma_t, 1e-9)
    absorb = np.maximum(1.6 * (1 - albedo) * sigma_t, 1e-9)
    a = 1 + absorb / scatter
    b = np.sqrt(a * a - 1)
    depth = np.minimum(b * scatter * thickness_mm, 300.0)
    bottom = a * np.sinh(depth) + b * np.cosh(depth)
    return np.sinh(depth) / bottom, b / bottom, np.exp(-sigma_t * thickness_mm)


@dataclass(frozen=True)
class FakeMap:
    """The attributes of twin.appearance.AppearanceMap that a report reads."""

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray
    thickness_mm: float
    n: float
    exponent: FloatArray
    black_series: FloatArray
    white_series: FloatArray
    collimated: FloatArray


def fake_map(thickness_mm: float) -> FakeMap:
    albedo = np.concatenate([np.linspace(0, 0.9, 19), 1 - np.geomspace(0.09, 1e-4, 20)])
    sigma = np.geomspace(0.02, 60, 50)
    g = np.linspace(-0.2, 0.9, 6)
    reflected, passed, collimated = two_stream(
        albedo[:, None, None], sigma[None, :, None], g[None, None, :], thickness_mm
    )
    exponent = np.arange(REFLECTIONS, dtype=np.float64)
    series = np.empty((*reflected.shape, REFLECTIONS))
    series[..., 0] = reflected
    for k in range(1, REFLECTIONS):
        series[..., k] = passed**2 * reflected ** (k - 1)
    collimated = np.broadcast_to(collimated, reflected.shape).copy()
    return FakeMap(albedo, sigma, g, thickness_mm, 1.5, exponent, series, series, collimated)


WAVELENGTH = np.arange(400.0, 701.0, 4.0)
CHIP = np.array([415.0, 445.0, 480.0, 515.0, 555.0, 590.0, 630.0, 680.0])
FULL_SCALE, DARK = 65535.0, 2396.0
RHO_WHITE = 0.99
THICKNESS = (0.4, 0.8)


def generator(*key: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=np.array([7, *key][:2], dtype=np.uint64)))


def rho_black(wavelength: FloatArray) -> FloatArray:
    return 0.02 + 0.05 / (1 + np.exp(-(wavelength - 675) / 12))


def lamp(wavelength: FloatArray) -> FloatArray:
    return np.exp(-(((wavelength - 450) / 15) ** 2)) + 0.8 * np.exp(
        -(((wavelength - 580) / 90) ** 2)
    )


def ink(wavelength: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Albedo, sigma_t [1/mm] and g of a made-up magenta ink with some white in it."""
    absorption = 0.02 + 1.3 * np.exp(-(((wavelength - 545) / 38) ** 2))
    absorption += 0.35 * np.exp(-(((wavelength - 410) / 30) ** 2))
    scattering = 4.0 * (wavelength / 500) ** -1.2
    g = 0.75 - 0.0003 * (wavelength - 400)
    return scattering / (scattering + absorption), scattering + absorption, g


def intensities(
    wavelength: FloatArray, thickness: tuple[float, ...], properties: tuple[FloatArray, ...]
) -> FloatArray:
    """Relative intensities, shape (S, 3, W)."""
    values = []
    for extent in thickness:
        reflected, passed, collimated = two_stream(*properties, extent)
        over = [
            reflected + passed**2 * rho / (1 - rho * reflected)
            for rho in (rho_black(wavelength), np.full(wavelength.shape, RHO_WHITE))
        ]
        values.append([*over, collimated])
    return np.array(values)


def bench(chip: bool = False) -> Bench:
    grid = np.arange(380.0, 801.0, 5.0)

    def table(values: FloatArray) -> SpectralTable:
        return SpectralTable(wavelength_nm=tuple(grid.tolist()), value=tuple(values.tolist()))

    return Bench(
        panel_spectrum=table(lamp(grid)),
        beam=Beam(spectrum=table(np.exp(-(((grid - 600) / 90) ** 2)))),
        background=Backgrounds(
            black=Background(
                reflectance=table(rho_black(grid)), shape="rectangle", size_mm=(40, 40)
            ),
            white=Background(reflectance=RHO_WHITE),
        ),
        instrument=MultispectralChip() if chip else Spectrometer(),
    )


def visit(
    *,
    chip: bool = False,
    truth: bool = True,
    saturated: int = 0,
    names: tuple[str, ...] = ("magenta thin", "magenta thick"),
    wavelength: FloatArray | None = None,
) -> Measurement:
    """Counts of a visit with noise; the first `saturated` pixels of the thick one are lost."""
    grid = wavelength if wavelength is not None else CHIP if chip else WAVELENGTH
    properties = ink(grid)
    seen = intensities(grid, THICKNESS, properties)
    light = (0.1 + lamp(grid)) / (0.1 + lamp(grid)).max()
    shots, counts = [], []
    for index, name in enumerate(names):
        levels = {
            "dark": np.zeros(grid.shape),
            "white_reference": RHO_WHITE * light,
            "black_reference": rho_black(grid) * light,
            "beam_reference": light,
            "black": seen[index, 0] * light,
            "white": seen[index, 1] * light,
            "collimated": seen[index, 2] * light,
        }
        for number, (capture, level) in enumerate(levels.items()):
            for repeat in range(3):
                noise = generator(1000 * index + 10 * number + repeat).standard_normal(grid.size)
                shots.append(Shot(capture, 0.1, name, repeat, averages=10))
                counts.append(DARK + 50000 * level + 12 * noise)
    flags = np.zeros((len(shots), grid.size), dtype=bool)
    last = max(i for i, shot in enumerate(shots) if shot.capture == "collimated")
    flags[last, :saturated] = True
    known = Truth(grid, *(np.stack([row] * len(names)) for row in properties)) if truth else None
    return Measurement(
        bench=bench(chip),
        samples=tuple(
            Sample(name=name, thickness_mm=extent)
            for name, extent in zip(names, THICKNESS, strict=True)
        ),
        captures=Captures(tuple(shots), grid, np.array(counts), flags),
        provenance=Provenance(origin="simulated", seed=1, software="benchtwin 0.1.0"),
        truth=known,
    )


def estimate(measurement: Measurement, status: dict[int, Status] | None = None) -> EstimateResult:
    """The truth of `ink` with made-up errors, and the statuses asked for by index."""
    grid = measurement.wavelength_nm
    count, samples = grid.size, len(measurement.samples)
    true = np.stack(ink(grid), axis=-1)
    error = np.stack([0.1 * (1 - true[:, 0]), 0.01 * true[:, 1], np.full(count, 0.01)], axis=-1)
    draws = generator(99).standard_normal((samples + 1, count, 3))
    value = true + error * draws[0]
    value[:, 0] = np.minimum(value[:, 0], 1.0)
    codes = np.zeros(count, dtype=np.int8)
    for index, found in (status or {}).items():
        codes[index] = found
    covariance = np.einsum("wi,ij->wij", error**2, np.eye(3))
    covariance[codes >= Status.OUTSIDE_MAP] = np.nan
    relative = relative_intensities(measurement)
    normalised = generator(98).standard_normal(relative.value.shape)
    normalised = np.where(relative.valid, normalised, np.nan)
    identifiable = np.ones((count, 3), dtype=bool)
    identifiable[codes == Status.NOT_IDENTIFIABLE, 2] = False
    return EstimateResult(
        estimator="lut",
        wavelength_nm=grid,
        albedo=value[:, 0],
        sigma_t_per_mm=value[:, 1],
        g=value[:, 2],
        covariance=covariance,
        quantile_level=QUANTILE_LEVELS,
        quantile=gaussian_quantiles(value, error),
        identifiable=identifiable,
        status=codes,
        sample_names=tuple(sample.name for sample in measurement.samples),
        thickness_mm=np.array([sample.thickness_mm for sample in measurement.samples]),
        sample_estimate=true + 1.5 * error * draws[1:],
        sample_status=np.stack([codes] * samples),
        distance=np.zeros((samples, count)),
        residual=normalised * relative.sigma,
        residual_normalised=normalised,
        beer_sigma_t_per_mm=-np.log(np.maximum(relative.value[:, 2], 1e-6))
        / np.array(THICKNESS)[:, None],
        beer_standard_error_per_mm=np.full((samples, count), 0.02),
        settings={"samples": 500, "epsilon": 0.02},
        fingerprint="5a" * 32,
    )
