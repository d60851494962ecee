"""Launching the coupled walk: bispectral captures of the whole finite bench, with errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bispectral.medium import FluorescentProperties
    from twin.transport import FlatStack, Setup

BLOCKS = 32
STREAM = 7
_MODULES: dict[str, Any] = {}


@dataclass(frozen=True)
class BispectralCaptures:
    """What the detector reads at O wavelengths of light at W, by the Monte Carlo of the bench.

    Attributes:
        wavelength_nm: [nm], (W,); out: indices of the emitted wavelengths, (O,).
        elastic, elastic_se: relative intensities black and white without re-emission at the
            emitted wavelengths, and their standard errors, (2, O).
        fluorescent, fluorescent_se: bispectral radiance factor per nm [1/nm] over black and
            white, all re-emissions, and standard errors, (2, O, W in).
        again: the part of `fluorescent` that was emitted twice or more, (2, O, W in).
        lit, lit_se: fluorescent radiance factor [1/nm] under each asked light, sum over bins
            of light times `fluorescent`, (2, O, lights), and its standard error.
    """

    wavelength_nm: FloatArray
    out: tuple[int, ...]
    elastic: FloatArray
    elastic_se: FloatArray
    fluorescent: FloatArray
    fluorescent_se: FloatArray
    again: FloatArray
    lit: FloatArray
    lit_se: FloatArray


def _warp() -> Any:
    """Warp with this package's kernels, loaded once."""
    if not _MODULES:
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        wp.init()
        from twin.bispectral import kernels, ledger_kernels
        from twin.transport import connect_kernels

        _MODULES.update(wp=wp, kernels=kernels, ledger=ledger_kernels, connect=connect_kernels)
    return _MODULES["wp"]


def fluorescent_stacks(
    bench: Bench, sample: Sample, properties: FluorescentProperties
) -> list[FlatStack]:
    """The stack at every wavelength, the fluorophores' absorption in the sample's extinction.

    Raises:
        InputError: a second lobe of the phase function, a glossy background, or as
            `twin.transport.flat_stacks`.
    """
    from dataclasses import replace

    from twin.transport import flat_stacks

    if bench.background.glossy:
        raise InputError(
            "a glossy background",
            "backgrounds without gloss: fluorescent light is followed over those alone",
            place="background",
        )
    stacks = flat_stacks(bench, sample, properties.wavelength_nm, properties.optical())
    found = []
    for stack, albedo in zip(stacks, properties.albedo, strict=True):
        if stack.second_share is not None and np.any(stack.second_share):
            raise InputError(
                "a second lobe of the phase function",
                "one lobe: fluorescent light is followed with that alone",
                place="second_share",
            )
        own = stack.albedo.copy()
        own[stack.counted] = albedo
        found.append(replace(stack, albedo=own))
    return found


def stacked(stacks: Sequence[FlatStack], panels: Sequence[Any], device: str) -> Any:
    """One `Stack` of the kernels with L + 2 rows for every wavelength: see `kernels`."""
    from twin.transport.tables import transfer_table

    wp, connect = _warp(), _MODULES["connect"]
    rows: dict[str, list[float]] = {
        name: [] for name in ("n", "sigma_t", "g", "albedo", "top", "bottom")
    }
    tables = []
    for stack in stacks:
        bottom = -np.cumsum(stack.thickness)
        columns = {
            "n": stack.n, "sigma_t": stack.sigma_t, "g": stack.g, "albedo": stack.albedo,
            "top": bottom + stack.thickness, "bottom": bottom,
        }  # fmt: skip
        for name, column in columns.items():
            copy = 0.0 if name == "g" else column[stack.counted]
            rows[name] += [*column, 0.0, copy]
        table = transfer_table(stack, False)
        tables.append(np.concatenate([table, table[stack.counted][None]]))

    def array(values: Any, dtype: Any = float) -> Any:
        return wp.array(values, dtype=dtype, device=device)

    layers = connect.Stack()
    for name, values in rows.items():
        setattr(layers, name, array(values))
    layers.table = array(np.concatenate(tables).astype(np.float32))
    layers.panel_centre = array([s.centre for s in panels], wp.vec3)
    layers.panel_u = array([s.u for s in panels], wp.vec3)
    layers.panel_v = array([s.v for s in panels], wp.vec3)
    layers.panel_normal = array([s.normal for s in panels], wp.vec3)
    layers.panel_half = array([s.half for s in panels], wp.vec2)
    layers.uneven = int(any(s.level != 1.0 or s.gradient != 0.0 for s in panels))
    layers.panel_light = array([(s.level, s.gradient) for s in panels], wp.vec2)
    return layers


def problem_of(setup: Setup, two_ways: bool) -> Any:
    """The kernels' description of everything around the stack."""
    from twin.transport.engine import MAX_ORDER, TARGETS, Outline

    _warp()
    problem = _MODULES["connect"].Problem()
    problem.start_cone_sine, problem.start_radius = np.sin(setup.cone), setup.radius
    problem.target_up = TARGETS["panels"]
    problem.exit_radius = setup.exit_radius
    problem.n_panels, problem.panel_scale = len(setup.panels), setup.panel_scale
    problem.half_x, problem.half_y = setup.half_size
    problem.offset_x, problem.offset_y = setup.offset
    problem.has_background, problem.gap = 1, setup.gap
    for name, outline in (("black", setup.black), ("white", setup.white)):
        edge = outline or Outline(False, -1.0, -1.0)
        setattr(problem, f"{name}_disc", int(edge.disc))
        setattr(problem, f"{name}_half_x", edge.half_x)
        setattr(problem, f"{name}_half_y", edge.half_y)
    problem.two_ways, problem.max_order = int(two_ways), MAX_ORDER
    return problem


def dyes_of(
    properties: FluorescentProperties,
    stack: FlatStack,
    generations: int,
    rho: tuple[FloatArray, FloatArray],
    device: str,
) -> Any:
    """The kernels' description of what is excited by what."""
    wp = _warp()

    def array(values: Any) -> Any:
        return wp.array(np.asarray(values, dtype=np.float32), dtype=float, device=device)

    sigma = properties.sigma_t_per_mm
    table = properties.source / np.where(sigma > 0.0, sigma, 1.0)[:, None]
    total = table.sum(axis=1)
    share = np.cumsum(table, axis=1) / np.where(total > 0.0, total, 1.0)[:, None]
    dyes = _MODULES["kernels"].Dyes()
    dyes.count, dyes.layers, dyes.sample = len(sigma), len(stack.n), stack.counted
    dyes.generations = generations
    dyes.excited, dyes.draw, dyes.step = array(total), array(share), array(properties.step_nm)
    dyes.rho_black, dyes.rho_white = array(rho[0]), array(rho[1])
    dyes.floor = 0.1
    return dyes


def trace_bispectral(
    bench: Bench,
    sample: Sample,
    properties: FluorescentProperties,
    *,
    out: Sequence[int] | None = None,
    lights: FloatArray | None = None,
    paths: int = 65_536,
    generations: int = 2,
    seed: int = 0,
    threads: int | None = None,
    device: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> BispectralCaptures:
    """Captures black and white of a fluorescent sample on the finite bench.

    Light is followed backwards: from the detector at the emitted wavelength through scattering,
    faces, background and sides to a re-emission, and on at the exciting wavelength to the
    panels. One trace for each emitted wavelength gives all exciting ones.

    Args:
        bench: the bench.
        sample: thickness and index.
        properties: of `fluorescent_properties`.
        out: indices of the wavelengths to look at, (O,); None: all.
        lights: spectral power per nm of the panels in several lights, (lights, W): for `lit`.
        paths: paths for each emitted wavelength.
        generations: re-emissions that are followed, 1 to 4.
        seed: the same seed gives the same bytes, whatever the number of threads.
        threads: None takes all processors.
        device: Warp device; None takes a GPU if there is one.
        progress: called with (done, total).

    Raises:
        InputError: indices or generations out of range, lights of another shape, or a spectrum
            that does not cover a wavelength.
    """
    from twin.materials import reflectance
    from twin.transport import mean_and_error, panels_setup, run_many
    from twin.transport.engine import TWO_WAYS_G, default_device

    wp = _warp()
    wave = properties.wavelength_nm
    asked = tuple(range(len(wave))) if out is None else tuple(int(o) for o in out)
    if not asked or min(asked) < 0 or max(asked) >= len(wave) or not 1 <= generations <= 4:
        raise InputError(
            f"wavelengths {asked} and {generations} generations",
            f"indices from 0 to {len(wave) - 1} and 1 to 4 generations",
            place="out",
        )
    light = np.zeros((0, len(wave))) if lights is None else np.asarray(lights, dtype=np.float64)
    if light.ndim != 2 or light.shape[1] != len(wave):
        raise InputError(f"lights of shape {light.shape}", f"(lights, {len(wave)})", place="lights")
    where = device or default_device()
    stacks = fluorescent_stacks(bench, sample, properties)
    setup = panels_setup(bench, stacks[0].height)
    rho = (
        reflectance(bench.background.black.reflectance, wave),
        reflectance(bench.background.white.reflectance, wave),
    )
    sharp = max(float(np.max(np.abs(stack.g))) for stack in stacks)
    problem = problem_of(setup, sharp > TWO_WAYS_G)
    layers = stacked(stacks, setup.panels, where)
    dyes = dyes_of(properties, stacks[0], generations, rho, where)
    each = max(1, paths // BLOCKS)
    wp.load_module(_MODULES["kernels"], device=where)

    def job(o: int) -> Callable[[], FloatArray]:
        def run() -> FloatArray:
            shape = (BLOCKS, 2, generations + 1, len(wave))
            tally = wp.zeros(shape, dtype=wp.float64, device=where)
            wp.launch(
                _MODULES["kernels"].coupled_kernel,
                dim=BLOCKS,
                inputs=[
                    problem, layers, dyes, tally, wp.uint64(seed), STREAM + 16 * o, 0, each, o,
                ],
                device=where,
            )  # fmt: skip
            return np.asarray(tally.numpy() / each)

        return run

    blocks = np.stack(run_many([job(o) for o in asked], threads, progress), axis=1)
    # [block, out, background, generation, in]
    fluorescent = blocks[:, :, :, 1:].sum(axis=3)
    under = np.einsum("bocw,lw->bocl", fluorescent, light * properties.step_nm)
    again = blocks[:, :, :, 2:].sum(axis=3).mean(axis=0)
    plain = np.stack([blocks[:, k, :, 0, o] for k, o in enumerate(asked)], axis=-1)
    value, error = (np.moveaxis(part, 0, 1) for part in mean_and_error(fluorescent))
    lit, lit_se = (np.moveaxis(part, 0, 1) for part in mean_and_error(under))
    elastic, elastic_se = mean_and_error(plain)
    return BispectralCaptures(
        wave, asked, elastic, elastic_se, value, error, np.moveaxis(again, 0, 1), lit, lit_se
    )
