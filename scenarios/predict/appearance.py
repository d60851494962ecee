"""Spectral reflectance of a slab on a background, with intervals.

The geometry is 45:0 (CIE 15:2018, section 5): light at 45 degrees all around, seen along the
normal, as a radiance factor against the perfect diffuser in the slab's top plane. Light that the
smooth top face mirrors does not reach the detector; the slab is wide, and lies bare in air.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.predict.mixture import ALBEDO, SIGMA_T, G, UncertainMedium
from twin.bench import Background, Backgrounds, Bench, Panel, Sample
from twin.errors import InputError
from twin.spectra import FloatArray, Spectral

ENGINES = ("adding-doubling", "monte-carlo")
COSINES = (math.cos(math.radians(45.0)), 1.0)
AIR, TRAPPED = 12, 8
"""Streams of the fast engine: 1e-4 absolute for g up to 0.9."""
AS_DRAWN = "as drawn"
CHUNK = 2048
"""Slabs of one call: a fixed number, so that nothing is compiled twice."""
FEW = 64


@dataclass(frozen=True)
class Slab:
    """What is done with the material.

    Attributes:
        thickness_mm: [mm], above 0; infinity is a slab through which no light gets.
        n: refractive index of the material.
        background: reflectance of the Lambertian background behind a gap of air: a number, a
            table or a name in the library.
    """

    thickness_mm: float
    n: Spectral = 1.5
    background: Spectral = 0.0

    def __post_init__(self) -> None:
        if not self.thickness_mm > 0:
            raise InputError(
                f"a thickness of {self.thickness_mm:g} mm", "a length above 0 mm", place="thickness"
            )


@dataclass(frozen=True, eq=False)
class Prediction:
    """Radiance factor 45:0 at W wavelengths with D draws.

    Attributes:
        name: of the medium.
        slab: what was predicted.
        wavelength_nm: [nm], shape (W,).
        reflectance: radiance factor, shape (W,); NaN where the medium is not known.
        draws: what the medium's draws give, shape (D, W).
        standard_error: of the engine, shape (W,); in the draws already.
        ordered: whether a draw belongs together over wavelengths.
        notes: what was left out or assumed.
    """

    name: str
    slab: Slab
    wavelength_nm: FloatArray
    reflectance: FloatArray
    draws: FloatArray
    standard_error: FloatArray
    ordered: bool
    notes: tuple[str, ...] = ()

    def interval(self, coverage: float = 0.9) -> FloatArray:
        """Central interval at every wavelength alone, shape (2, W): lower, upper.

        Raises:
            InputError: a coverage outside 0 to 1.
        """
        if not 0 < coverage < 1:
            raise InputError(f"a coverage of {coverage:g}", "above 0 and below 1", place="coverage")
        tails = (0.5 - coverage / 2, 0.5 + coverage / 2)
        return quantile(self.draws, tails)

    def couplings(self, seed: int = 1) -> dict[str, FloatArray]:
        """The draws, each of shape (D, W), for every way in which wavelengths may go together.

        Each wavelength keeps its distribution; only which draws make one spectrum changes.
        Ordered draws stay as they are ("as drawn"). Otherwise nothing is known of it, and there
        are two: "independent" wavelengths, whose errors average out in a colour, and "common"
        errors (all high together, comonotone). Of all couplings the second gives sums with
        positive weights, such as the luminance factor Y, their widest spread (Kaas, Dhaene and
        Goovaerts 2000, Insurance: Mathematics and Economics 27, 151); for the chroma neither is
        a strict bound.
        """
        if self.ordered:
            return {AS_DRAWN: self.draws}
        rng = np.random.Generator(np.random.Philox(key=[seed, self.draws.shape[1]]))
        return {
            "independent": rng.permuted(self.draws, axis=0),
            "common": np.sort(self.draws, axis=0),
        }


def quantile(draws: FloatArray, levels: Sequence[float]) -> FloatArray:
    """Quantiles over the draws, (D, ...) to (levels, ...).

    By (D + 1) p (Weibull): the interval between two of them then holds a further draw as often as
    it says, however few draws there are (Hyndman and Fan 1996, Am. Stat. 50, 361, type 6).
    """
    return np.asarray(np.quantile(draws, levels, axis=0, method="weibull"))


def reflectance_45_0(
    properties: FloatArray,
    thickness_mm: float,
    n: FloatArray | float = 1.5,
    rho: FloatArray | float = 0.0,
    *,
    progress: Callable[[float, float], None] | None = None,
) -> FloatArray:
    """Radiance factor 45:0 of slabs by adding-doubling.

    Args:
        properties: albedo, sigma_t [1/mm] and g, shape (..., W, 3); NaN gives NaN.
        thickness_mm: [mm]; may be infinite.
        n: refractive index, shape (W,) or a number.
        rho: reflectance of the background, shape (W,) or a number.
        progress: called with (done, total).

    Returns:
        Radiance factor, shape (..., W).

    Raises:
        InputError: a property outside its physical range.
    """
    from twin.adding_doubling import slab_optics

    shape = properties.shape[:-1]
    sigma_t = properties[..., SIGMA_T]
    opaque = np.where(sigma_t > 0, np.inf, 0.0)
    depth = opaque if math.isinf(thickness_mm) else sigma_t * thickness_mm
    columns = [properties[..., ALBEDO], depth, properties[..., G], n, rho]
    flat = np.stack([np.broadcast_to(np.asarray(c, float), shape).reshape(-1) for c in columns])
    result = np.full(flat.shape[1], np.nan)
    known = np.flatnonzero(np.isfinite(properties).all(axis=-1).reshape(-1))
    size = FEW if len(known) <= 4 * FEW else CHUNK
    # one index of 1 among others would be given another quadrature: all of a kind at a time
    for matched in (False, True):
        mine = known[(flat[3, known] == 1.0) == matched]
        for start in range(0, len(mine), size):
            part = mine[start : start + size]
            padded = np.concatenate([part, np.full(size - len(part), part[-1])])
            albedo, tau, g, index, backing = flat[:, padded]
            found = slab_optics(
                albedo, tau, g, index, cosines=COSINES, backing=backing, air=AIR, trapped=TRAPPED
            ).reflected_factor
            result[part] = found[: len(part), 1, 0]
            if progress is not None:
                progress(float(min(start + size, len(mine))), float(len(known)))
    return result.reshape(shape)


def predict(
    medium: UncertainMedium,
    slab: Slab,
    *,
    engine: str = "adding-doubling",
    paths: int = 1 << 13,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Prediction:
    """Radiance factor of a slab of the medium, with what the medium's draws make of it.

    Args:
        medium: a measured one (`medium_of`) or a mixture.
        slab: thickness, refractive index, background.
        engine: of the value itself. The draws' deviations from it come from adding-doubling
            either way; the Monte Carlo adds its own noise to them.
        paths: light paths per wavelength of the Monte Carlo.
        seed: of the Monte Carlo.
        threads: of the Monte Carlo; the result does not depend on them.
        progress: called with (done, total).

    Raises:
        InputError: an unknown engine or background, a wavelength that a spectrum does not cover,
            or an infinite thickness for the Monte Carlo.
    """
    from twin.materials import reflectance, refractive_index

    if engine not in ENGINES:
        raise InputError(f'the engine "{engine}"', " or ".join(ENGINES), place="engine")
    wavelength, known = medium.wavelength_nm, medium.known
    n = refractive_index(slab.n, wavelength)
    rho = reflectance(slab.background, wavelength)
    slabs = np.concatenate([medium.value[None], medium.draws])
    fast = reflectance_45_0(slabs, slab.thickness_mm, n, rho, progress=progress)
    value, draws, error = fast[0], fast[1:], np.where(known, 0.0, np.nan)
    if engine == "monte-carlo":
        found, error = monte_carlo_45_0(
            wavelength, medium.value, slab, paths=paths, seed=seed, threads=threads
        )
        rng = np.random.Generator(np.random.Philox(key=[seed, 45]))
        draws = found + (draws - value) + error * rng.standard_normal(draws.shape)
        value = found
    return Prediction(
        medium.name, slab, wavelength, value, draws, error, medium.ordered, medium.notes
    )


def colour_bench(background: Spectral) -> Bench:
    """A bench that is 45:0 to 0.1 %: small far panels, a wide bare slab, top plane as reference."""
    wide = Background(reflectance=background, shape="rectangle", size_mm=(2000.0, 2000.0))
    panel = Panel(width_mm=20.0, length_mm=20.0, distance_mm=3000.0)
    return Bench(
        panels=(panel, panel.model_copy(update={"azimuth_deg": 180.0})),
        covers_above=(),
        covers_below=(),
        size_mm=None,
        background=Backgrounds(gap_mm=0.01, black=wide, white=wide),
        reference_plane_mm=0.0,
    )


def monte_carlo_45_0(
    wavelength_nm: FloatArray,
    properties: FloatArray,
    slab: Slab,
    *,
    paths: int = 1 << 13,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Radiance factor 45:0 of a slab and its standard error by the Monte Carlo.

    Args:
        wavelength_nm: [nm], shape (W,).
        properties: albedo, sigma_t [1/mm] and g, shape (W, 3); NaN gives NaN.
        slab: thickness, refractive index, background.
        paths: light paths per wavelength.
        seed: the same seed, the same bytes.
        threads: of the Monte Carlo; the result does not depend on them.
        progress: called with (done, total).

    Returns:
        Radiance factor and standard error, shape (W,) each.

    Raises:
        InputError: an infinite thickness.
    """
    from twin.materials import checked_properties
    from twin.transport import captures

    if math.isinf(slab.thickness_mm):
        raise InputError(
            "an infinite thickness", "a finite one for the Monte Carlo", place="thickness",
            remedy="Use the engine adding-doubling.",
        )  # fmt: skip
    known = np.isfinite(properties).all(axis=-1)
    value, error = np.full((2, len(wavelength_nm)), np.nan)
    if known.any():
        found = captures(
            colour_bench(slab.background),
            Sample(name="slab", thickness_mm=slab.thickness_mm, n=slab.n),
            wavelength_nm[known],
            properties=checked_properties(wavelength_nm[known], *properties[known].T),
            paths=paths,
            seed=seed,
            threads=threads,
            progress=progress,
        )
        value[known], error[known] = found.black, found.black_se
    return value, error
