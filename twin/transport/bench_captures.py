"""Noiseless captures of a sample on the bench, by the Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.bench import Bench, Sample, stack_of
from twin.errors import InputError
from twin.materials import OpticalProperties, optical_properties, reflectance, refractive_index
from twin.spectra import FloatArray
from twin.transport.engine import BLACK, WHITE, Effort, Setup, Tallies, run_many, trace
from twin.transport.geometry import (
    beam_reference_share,
    beam_setup,
    panels_setup,
    reference_factor,
    reference_plane_mm,
)
from twin.transport.tables import FlatStack

PANELS_STREAM, BEAM_STREAM = 1, 2
BLOCKS = 32


@dataclass(frozen=True)
class NoiselessCaptures:
    """What the bench of bench.md would read without noise, at W wavelengths.

    Attributes:
        wavelength_nm: [nm], (W,).
        black, white, collimated: relative intensities, (W,).
        black_se, white_se, collimated_se: their Monte Carlo standard errors, (W,).
        rho_black, rho_white: reflectances of the backgrounds, (W,).
        white_reference_factor: irradiance on the reference white per panel radiance [sr].
        derivatives: d/d albedo, d/d sigma_t [mm], d/d g of black, white and collimated,
            (3 captures, 3 parameters, W), or None.
    """

    wavelength_nm: FloatArray
    black: FloatArray
    white: FloatArray
    collimated: FloatArray
    black_se: FloatArray
    white_se: FloatArray
    collimated_se: FloatArray
    rho_black: FloatArray
    rho_white: FloatArray
    white_reference_factor: float
    derivatives: FloatArray | None = None


def flat_stacks(
    bench: Bench, sample: Sample, wavelength_nm: FloatArray, properties: OpticalProperties
) -> list[FlatStack]:
    """The stack at every wavelength, the sample's albedo left free.

    Args:
        bench: gives the covers.
        sample: gives thickness [mm] and refractive index.
        wavelength_nm: wavelengths [nm], shape (W,).
        properties: sigma_t [1/mm] and g of the sample, shape (W,) each, and its second lobe.

    Returns:
        W stacks of L layers each.

    Raises:
        InputError: a refractive index below 1, a spectrum that does not cover a wavelength, or
            a second lobe that leaves no room for the first.
    """
    layers = stack_of(bench, sample, None)
    counted = len(bench.covers_above)
    n = np.array([refractive_index(layer.n, wavelength_nm) for layer in layers])
    thickness = np.array([layer.thickness_mm for layer in layers])
    sigma_t, g, albedo = np.zeros((3, *n.shape))
    second_share, second_g = np.zeros((2, len(layers)))
    for i, layer in enumerate(layers):
        if layer.medium is not None:
            own = optical_properties(layer.medium, wavelength_nm)
            sigma_t[i], g[i], albedo[i] = own.sigma_t_per_mm, own.g, own.albedo
            second_share[i], second_g[i] = own.second_share, own.second_g
    properties.require_lobes()
    second_share[counted], second_g[counted] = properties.second_share, properties.second_g
    second = (second_share, second_g) if np.any(second_share) else (None, None)
    sigma_t[counted], g[counted] = properties.sigma_t_per_mm, properties.g
    if np.any(n < 1.0):
        raise InputError(f"a refractive index of {n.min():g}", "1 or more", place="n")
    return [
        FlatStack(thickness, n[:, w], sigma_t[:, w], g[:, w], albedo[:, w], counted, *second)
        for w in range(len(wavelength_nm))
    ]


def effort_for(albedo: float, paths: int, derivatives: bool = False) -> Effort:
    """Blocks and roulette for one known albedo.

    Paths are shortened once the albedo has made their contribution small; from there on they
    survive with the albedo itself, so that what is left has equal weight.
    """
    log2_paths = max(4, min(20, round(math.log2(max(1, paths) / BLOCKS))))
    free = 4
    if albedo > 0.05:
        free = int(min(5000.0, max(4.0, math.log(0.3) / math.log(min(albedo, 0.9999)))))
    return Effort(
        blocks=BLOCKS,
        log2_paths=log2_paths,
        roulette_albedo=max(0.05, min(1.0, albedo)),
        roulette_scale=1.0e9,
        roulette_free=free,
        derivatives=derivatives,
    )


def collected_share(bench: Bench, stack_height_mm: float) -> float:
    """Share of the beam that the detector collects on the empty bench, above 0.

    Raises:
        InputError: it collects nothing.
    """
    share = beam_reference_share(bench, stack_height_mm)
    if share <= 0.0:
        raise InputError(
            "a beam of which the detector collects nothing on the empty bench",
            "a beam inside the detector's spot and acceptance",
            place="beam",
        )
    return share


Reading = tuple[float, float, tuple[float, float, float]]


def _evaluate(
    tallies: Tallies, channel: int, albedo: float, rho: float, derivatives: bool
) -> Reading:
    """Value, standard error, and d/d albedo, d/d sigma_t, d/d g."""
    value, error = tallies.estimate(channel, np.array([albedo]), rho)
    slopes = (math.nan, math.nan, math.nan)
    if derivatives and tallies.d_sigma is not None and tallies.d_g is not None:
        mean = tallies.value[:, channel].mean(axis=0)
        bounces = rho**tallies.bounce
        order = np.maximum(tallies.order, 1.0)
        d_powers = tallies.order * albedo ** (order - 1.0)
        powers = albedo**tallies.order
        slopes = (
            float(bounces @ mean @ d_powers),
            float(bounces @ tallies.d_sigma[:, channel].mean(axis=0) @ powers),
            float(bounces @ tallies.d_g[:, channel].mean(axis=0) @ powers),
        )
    return float(value[0]), float(error[0]), slopes


def captures(
    bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    *,
    properties: OpticalProperties | None = None,
    paths: int = 65_536,
    seed: int = 0,
    threads: int | None = None,
    derivatives: bool = False,
    device: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> NoiselessCaptures:
    """Noiseless relative intensities of one sample at wavelengths [nm], shape (W,).

    Args:
        bench: the bench.
        sample: the sample.
        wavelength_nm: where to simulate [nm].
        threads: None takes all processors.
        device: Warp device; None takes a GPU if there is one.
        properties: the sample's medium; None takes `sample.material`.
        paths: paths per wavelength for the panels, rounded to 32 times a power of two.
        seed: the same seed gives the same bytes, whatever the number of threads.
        derivatives: also d/d albedo, d/d sigma_t and d/d g (power series and score functions).
        progress: called with (done, total).

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
    panels, beam = panels_setup(bench, height), beam_setup(bench)
    share = collected_share(bench, height)
    rho_black = reflectance(bench.background.black.reflectance, wavelength)
    rho_white = reflectance(bench.background.white.reflectance, wavelength)

    def job(w: int, setup: Setup, stream: int, fewer: int) -> Callable[[], list[Reading]]:
        albedo = float(properties.albedo[w])
        effort = effort_for(albedo, max(1, paths // fewer), derivatives)

        def run() -> list[Reading]:
            tallies = trace(
                stacks[w], setup, effort, seed=seed, stream=stream + 16 * w, device=device
            )
            if setup is beam:
                return [_evaluate(tallies, BLACK, albedo, 1.0, derivatives)]
            return [
                _evaluate(tallies, BLACK, albedo, float(rho_black[w]), derivatives),
                _evaluate(tallies, WHITE, albedo, float(rho_white[w]), derivatives),
            ]

        return run

    count = len(wavelength)
    jobs = [job(w, panels, PANELS_STREAM, 1) for w in range(count)]
    jobs += [job(w, beam, BEAM_STREAM, 4) for w in range(count)]
    results = run_many(jobs, threads, progress)
    rows = [[*results[w], *results[count + w]] for w in range(count)]
    value = np.array([[entry[0] for entry in row] for row in rows]).T
    error = np.array([[entry[1] for entry in row] for row in rows]).T
    slopes = np.array([[entry[2] for entry in row] for row in rows]).transpose(1, 2, 0)
    value[2] /= share
    error[2] /= share
    slopes[2] /= share
    return NoiselessCaptures(
        wavelength, value[0], value[1], value[2], error[0], error[1], error[2],
        rho_black, rho_white,
        reference_factor(bench, reference_plane_mm(bench, height)),
        slopes if derivatives else None,
    )  # fmt: skip
