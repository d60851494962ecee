"""Light and its slopes for many materials and thicknesses, each optical bench evaluated once.

What adding-doubling has to solve depends on covers, panels, view, index, material and thickness
alone; the backgrounds enter by I = direct + rho once / (1 - rho returned), which costs nothing
(Kubelka 1948, eq. 14). Every call has the same shape, so that nothing is compiled twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from scenarios.design.media import Medium
from scenarios.outputs import canonical_json
from twin.bench import Background, Bench, Sample
from twin.materials import reflectance
from twin.spectra import FloatArray

ROWS = 16
"""Wavelengths of one call."""
MATERIAL = 3
SLOPES = (
    "albedo", "sigma_t_per_mm", "g", "n", "thickness_mm", "rho_black", "rho_white",
)  # fmt: skip
"""What light is differentiated by, in this order; the first three are the material."""
_BY_ENGINE = SLOPES[:5]
ENGINE_ERROR = 1e-4
"""Relative standard error of the engine (`twin.adding_doubling.STATED_BOUND`)."""


@dataclass(frozen=True, eq=False)
class Light:
    """Relative intensities of M materials at K thicknesses and W wavelengths.

    Attributes:
        value: black, white, collimated, shape (M, K, W, 3).
        slope: derivatives by `SLOPES`, shape (M, K, W, 3, 7).
    """

    value: FloatArray
    slope: FloatArray


@dataclass(eq=False)
class Optics:
    """The fast engine for the materials and thicknesses of one study.

    Attributes:
        media: M materials.
        thickness_mm: K thicknesses [mm].
    """

    media: tuple[Medium, ...]
    thickness_mm: tuple[float, ...]
    _parts: dict[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict, repr=False)
    _lights: dict[str, Light] = field(default_factory=dict, repr=False)
    calls: int = 0
    """How often the engine was called."""

    def light(self, bench: Bench, wavelength_nm: FloatArray) -> Light:
        """Light on a bench at wavelengths [nm], (W,).

        Raises:
            InputError: a spectrum that does not cover the wavelengths, or a bench that a
                plane-parallel stack cannot show.
        """
        background = bench.background
        rho = [
            reflectance(b.reflectance, wavelength_nm) for b in (background.black, background.white)
        ]
        key = optical_key(bench, wavelength_nm) + "".join(str(each.tobytes()) for each in rho)
        if key not in self._lights:
            self._lights[key] = self._light(bench, wavelength_nm, rho)
        return self._lights[key]

    def _light(self, bench: Bench, wavelength_nm: FloatArray, rho: list[FloatArray]) -> Light:
        value, slope = self.parts(bench, wavelength_nm)
        light = np.empty((*value.shape[:3], 3))
        slopes = np.zeros((*light.shape, len(SLOPES)))
        for capture, own in enumerate(rho):
            direct, once, returned = np.moveaxis(value[..., :3], -1, 0)
            kept = 1.0 / (1.0 - own * returned)
            light[..., capture] = direct + own * once * kept
            by_parts = np.stack([np.ones_like(direct), own * kept, own**2 * once * kept**2], -1)
            slopes[..., capture, :5] = np.einsum("...p,...pd->...d", by_parts, slope[..., :3, :])
            slopes[..., capture, 5 + capture] = once * kept**2
        light[..., 2] = value[..., 3] + value[..., 4]
        slopes[..., 2, :5] = slope[..., 3, :] + slope[..., 4, :]
        return Light(light, slopes)

    def parts(self, bench: Bench, wavelength_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parts of the captures (M, K, W, 5), and their slopes by the first five, (M, K, W, 5, 5).

        Raises:
            InputError: as `light`.
        """
        key = optical_key(bench, wavelength_nm)
        if key not in self._parts:
            rows = [
                [solved(bench, medium, mm, wavelength_nm) for mm in self.thickness_mm]
                for medium in self.media
            ]
            self.calls += len(self.media) * len(self.thickness_mm)
            self._parts[key] = (
                np.array([[value for value, _ in own] for own in rows]),
                np.array([[slope for _, slope in own] for own in rows]),
            )
        return self._parts[key]


def optical_key(bench: Bench, wavelength_nm: FloatArray) -> str:
    """What of a bench decides the parts of the captures, as text."""
    return _bench_key(bench) + str(np.asarray(wavelength_nm).tobytes())


@lru_cache(maxsize=4096)
def _bench_key(bench: Bench) -> str:
    described = bench.model_dump(mode="json", exclude={"instrument", "panel_spectrum"})
    described["beam"].pop("spectrum", None)
    for name in ("black", "white"):
        described["background"][name]["reflectance"] = None
    return canonical_json(described, indent=None)


def intensities(parts: FloatArray, rho: Sequence[FloatArray]) -> FloatArray:
    """Black, white and collimated (..., W, 3) of the parts of the captures (..., W, 5).

    Args:
        parts: direct, once, returned, unscattered, scattered.
        rho: reflectance of the black and of the white, (W,) each.
    """
    direct, once, returned, unscattered, scattered = np.moveaxis(parts, -1, 0)
    seen = [direct + own * once / (1.0 - own * returned) for own in rho]
    return np.stack([*seen, unscattered + scattered], axis=-1)


def calls(wavelength_nm: FloatArray) -> Iterator[tuple[FloatArray, int]]:
    """Wavelengths [nm] in calls of `ROWS`, and how many of each count.

    The last call is filled up with its last wavelength, so that all have the same shape.
    """
    for start in range(0, len(wavelength_nm), ROWS):
        own = wavelength_nm[start : start + ROWS]
        yield np.concatenate([own, np.full(ROWS - len(own), own[-1])]), len(own)


def solved(
    bench: Bench, medium: Medium, thickness_mm: float, wavelength_nm: FloatArray, *,
    more_mm: float = 0.0, more_n: float = 0.0, values: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Parts of the captures of one sample (W, 5) and their slopes by the first five (W, 5, 5).

    Args:
        bench: its backgrounds do not matter.
        medium: of the sample.
        thickness_mm: that the bench is set up for [mm].
        wavelength_nm: [nm], (W,).
        more_mm: by how much the sample is thicker [mm].
        more_n: by how much its index is larger.
        values: albedo, sigma_t [1/mm] and g in the place of the medium's, (W, 3).

    Raises:
        InputError: a spectrum that does not cover the wavelengths, or a bench that a
            plane-parallel stack cannot show.
    """
    from twin.adding_doubling import captures_model

    none = Background(reflectance=0.0)
    plain = bench.background.model_copy(update={"black": none, "white": none})
    dark = bench.model_copy(update={"background": plain})
    sample = Sample(name="one", thickness_mm=thickness_mm, n=medium.n)
    moved: dict[str, Any] = {}
    if more_mm:
        moved["thickness_mm"] = [max(thickness_mm + more_mm, 1e-3)]
    found: list[tuple[FloatArray, FloatArray]] = []
    for number, (own, count) in enumerate(calls(np.asarray(wavelength_nm, dtype=np.float64))):
        rows = np.minimum(number * ROWS + np.arange(ROWS), len(wavelength_nm) - 1)
        material = medium.at(own) if values is None else values[rows]
        model = captures_model(dark, [sample], own)
        if more_n:
            moved["n"] = np.maximum(np.asarray(model.nominal.n) + more_n, 1.0)
        parameters = model.parameters(*material.T, **moved)
        value, slope = _program()(parameters, model.constants, model.form)
        found.append((np.asarray(value)[:count, 0], np.asarray(slope)[:count, 0]))
    value = np.concatenate([each for each, _ in found])
    slope = np.concatenate([each for _, each in found])
    return value, slope


@lru_cache(maxsize=1)
def _program() -> Any:
    import jax
    import jax.numpy as jnp

    from twin.adding_doubling import parts_of, value_and_slopes

    def run(parameters: Any, constants: Any, form: Any) -> Any:
        return value_and_slopes(
            lambda moved: jnp.stack(parts_of(moved, constants, form), axis=-1),
            parameters,
            _BY_ENGINE,
        )

    return jax.jit(run, static_argnames=("form",))
