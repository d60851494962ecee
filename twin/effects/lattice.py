"""Responses of the Monte Carlo on a lattice of materials: computed when asked for, and kept.

How captures answer to a change of the bench is a smooth function of (ln sigma_t, -ln(1 - g)) and
a power series in albedo and background reflectance, so that a few traces with common random
numbers serve every spectrum that a bench will ever see.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin.bench import Bench
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.effects.monte_carlo import staged
from twin.effects.world import Sublayer, World
from twin.materials import OpticalProperties, reflectance
from twin.spectra import FloatArray
from twin.transport import Effort, FlatStack, Setup, flat_stacks, mean_and_error, trace
from twin.transport.bench_captures import BEAM_STREAM, PANELS_STREAM, collected_share
from twin.transport.engine import BLACK, WHITE, bounce_bins, order_bins, run_many
from twin.transport.geometry import beam_setup, four_fold, panels_setup

VERSION = 3
STEP = 0.5
"""Of the lattice, in ln sigma_t [1/mm] and in -ln(1 - g)."""
DARK_STEP = 0.7
"""Of the lattice in -ln(1 - albedo), where layers inside a sample forbid the power series."""
ERRORS_AT = (0.5, 0.9, 0.99)
"""Albedos at which standard errors are kept."""
BLOCKS = 32
MOST_KEPT = 64
"""Traces kept in memory, 1 MB each."""

Node = tuple[int, int, int]
"""Numbers on the lattice: ln sigma_t, -ln(1 - g), and -ln(1 - albedo) or -1 for all albedos."""


@dataclass(frozen=True, eq=False)
class NodeResponse:
    """Change of the captures of one sample at one node.

    Attributes:
        black, white: by scattering order and bounce, shape (O, B); O is 1 at a fixed albedo.
        collimated: by scattering order, shape (O,).
        error: standard errors at the albedos `ERRORS_AT` (or the fixed one), shape (A, 3).
    """

    black: FloatArray
    white: FloatArray
    collimated: FloatArray
    error: FloatArray

    def at(self, albedo: FloatArray, rho_black: FloatArray, rho_white: FloatArray) -> FloatArray:
        """Change of black, white, collimated for N albedos and reflectances, shape (N, 3)."""
        exponent = bounce_bins()[1]
        powers = np.ones((len(albedo), 1))
        if len(self.collimated) > 1:
            powers = np.asarray(albedo)[:, None] ** order_bins()[1][: len(self.collimated)]
        over = [
            np.einsum("no,ob,nb->n", powers, series, np.asarray(rho)[:, None] ** exponent)
            for series, rho in ((self.black, rho_black), (self.white, rho_white))
        ]
        return np.stack([*over, powers @ self.collimated], axis=-1)

    def error_at(self, albedo: FloatArray) -> FloatArray:
        """Standard errors, linear between the albedos at which they are known, shape (N, 3)."""
        if len(self.error) == 1:
            return np.broadcast_to(self.error[0], (len(albedo), 3))
        return np.stack([np.interp(albedo, ERRORS_AT, column) for column in self.error.T], axis=-1)


@dataclass(frozen=True, eq=False)
class Lattice:
    """Responses of one bench, kept in a folder.

    Attributes:
        world: before every effect.
        wavelength_nm: where indices and nominal reflectances are taken [nm].
        paths: of the panels for a thin sample, and four times as many of the beam.
        seed: of all random numbers.
        folder: of the cache.
        say: told of damaged files.
        threads: None takes all processors.
    """

    world: World
    wavelength_nm: float
    paths: int = 8192
    seed: int = 0
    folder: Path | None = None
    say: Callable[[str], None] = print
    threads: int | None = None
    _kept: dict[Any, tuple[Setup, FlatStack, FloatArray]] = field(default_factory=dict, repr=False)

    def nodes(self, changed: World, sample: int, nodes: set[Node]) -> dict[Node, NodeResponse]:
        """Responses of a sample from `world` to `changed` at nodes: loaded, or computed."""
        found: dict[Node, NodeResponse] = {}
        jobs, missing = [], []
        for node in sorted(nodes):
            path = self._path(changed, sample, node)
            stored = load_arrays(path, self.say)
            if stored is not None:
                found[node] = NodeResponse(**stored)
                continue
            missing.append((node, path))
            jobs.append(self._job(changed, sample, node))
        for (node, path), result in zip(missing, run_many(jobs, self.threads), strict=True):
            store_arrays(path, vars(result))
            found[node] = result
        return found

    def _path(self, changed: World, sample: int, node: Node) -> Path:
        key = content_key(
            {
                "version": VERSION, "from": _described(self.world, sample),
                "to": _described(changed, sample), "nm": self.wavelength_nm,
                "paths": self.paths, "seed": self.seed, "node": list(node), "step": STEP,
            }
        )  # fmt: skip
        return (self.folder or cache_folder("effects")) / f"{key}.npz"

    def _job(self, changed: World, sample: int, node: Node) -> Callable[[], NodeResponse]:
        def run() -> NodeResponse:
            return self._traced(changed, sample, node)

        return run

    def _traced(self, changed: World, sample: int, node: Node) -> NodeResponse:
        at = np.array([self.wavelength_nm])
        sigma_t, g, albedo = material_at(node)
        medium = OpticalProperties(at, np.array([albedo]), np.array([sigma_t]), np.array([g]), None)
        worlds = (_alike(self.world, changed), changed)
        stages = [staged(w, w.bench, w.samples[sample], medium) for w in worlds]
        turned = all(four_fold(bench) for bench, _, _ in stages)
        free = node[2] < 0
        thick = sigma_t * self.world.samples[sample].thickness_mm
        share = float(np.clip(1.5 / max(thick, 1e-9), 0.0625, 1.0))
        log2_paths = max(4, round(np.log2(self.paths * share / BLOCKS)))
        effort = Effort(BLOCKS, log2_paths, lattice=False, common=True)
        scenes = []
        for bench, own, inside in stages:
            stack = flat_stacks(bench, own, at, inside)[0]
            fixed = None if free else float(inside.albedo[0])
            scenes.append(
                _Scene(
                    stack, panels_setup(bench, stack.height, turned), beam_setup(bench),
                    collected_share(bench, stack.height), fixed,
                )
            )  # fmt: skip
        change = self._change(scenes, effort, (sample, node, turned))
        rho = _reflectances(self.world.bench, at)
        exponent = bounce_bins()[1]
        powers = [np.ones(1)]
        if free:
            powers = [a ** order_bins()[1] for a in ERRORS_AT]
        errors = [
            [
                mean_and_error(np.einsum("kbo,o,b->k", change[0], p, rho[0] ** exponent))[1],
                mean_and_error(np.einsum("kbo,o,b->k", change[1], p, rho[1] ** exponent))[1],
                mean_and_error(change[2] @ p)[1],
            ]
            for p in powers
        ]
        black, white, collimated = (each.mean(axis=0) for each in change)
        return NodeResponse(black.T, white.T, collimated, np.array(errors, dtype=np.float64))

    def _change(
        self, scenes: list[_Scene], effort: Effort, place: tuple[object, ...]
    ) -> list[FloatArray]:
        """Change of black and white (blocks, B, O) and of collimated (blocks, O).

        What an effect leaves as it is, panels or beam, is not traced: its change is 0 exactly.
        """
        before, after = scenes
        same = _same_stack(before.stack, after.stack) and before.albedo == after.albedo
        orders = len(order_bins()[1]) if before.albedo is None else 1
        change = [np.zeros((BLOCKS, len(bounce_bins()[1]), orders)) for _ in range(2)]
        change.append(np.zeros((BLOCKS, orders)))
        if not (same and before.panels == after.panels):
            old, new = (self._panels(scene, effort, place) for scene in scenes)
            for row, other in enumerate(("white", "black")):
                # a background that nobody put there does not matter
                names = (other, f"{other}_gloss")
                its = {name: getattr(before.panels, name) for name in names}
                if not (same and replace(after.panels, **its) == before.panels):
                    change[row] = new[row] - old[row]
        if not (same and (before.beam, before.share) == (after.beam, after.share)):
            first, second = (self._beam(scene, effort, place) for scene in scenes)
            change[2] = second - first
        return change

    def _panels(
        self, scene: _Scene, effort: Effort, place: tuple[object, ...]
    ) -> tuple[FloatArray, FloatArray]:
        value = self._value(scene.stack, scene.panels, effort, PANELS_STREAM, place)
        black, white = value[:, BLACK], value[:, WHITE]
        if scene.albedo is not None:
            powers = scene.albedo ** order_bins()[1]
            return (black @ powers)[..., None], (white @ powers)[..., None]
        return black, white

    def _beam(self, scene: _Scene, effort: Effort, place: tuple[object, ...]) -> FloatArray:
        # the cone of the detector is narrow: most paths of the beam miss it
        more = replace(effort, log2_paths=effort.log2_paths + 2)
        value = self._value(scene.stack, scene.beam, more, BEAM_STREAM, place)
        through = value[:, BLACK].sum(axis=1) / scene.share
        if scene.albedo is not None:
            return np.asarray((through @ scene.albedo ** order_bins()[1])[..., None])
        return np.asarray(through)

    def _value(
        self, stack: FlatStack, setup: Setup, effort: Effort, stream: int,
        place: tuple[object, ...],
    ) -> FloatArray:  # fmt: skip
        """Block means of one trace; those of the world before are wanted by every effect."""
        kept = self._kept.get((place, stream))
        if kept is not None and kept[0] == setup and _same_stack(kept[1], stack):
            return kept[2]
        value = trace(stack, setup, effort, seed=self.seed, stream=stream).value
        if len(self._kept) >= MOST_KEPT:
            self._kept.clear()
        self._kept.setdefault((place, stream), (setup, stack, value))
        return value


@dataclass(frozen=True, eq=False)
class _Scene:
    """What is traced: a stack under the panels and in the beam, at any albedo or at one."""

    stack: FlatStack
    panels: Setup
    beam: Setup
    share: float
    albedo: float | None


def _alike(world: World, changed: World) -> World:
    """The world before, cut into the layers of the one after: the same light, and the same events.

    A path takes new random numbers at every boundary; only where both worlds have the same
    boundaries do their paths stay together, and their noise cancels.
    """
    layers = tuple(Sublayer(layer.share) for layer in changed.sublayers)
    return world.changed(sublayers=world.sublayers or layers)


def _same_stack(one: FlatStack, other: FlatStack) -> bool:
    return vars(one).keys() == vars(other).keys() and all(
        np.array_equal(value, vars(other)[name]) for name, value in vars(one).items()
    )


def material_at(node: Node) -> tuple[float, float, float]:
    """Extinction [1/mm], g and albedo of a node."""
    albedo = 0.9 if node[2] < 0 else 1.0 - float(np.exp(-DARK_STEP * node[2]))
    return float(np.exp(STEP * node[0])), 1.0 - float(np.exp(-STEP * node[1])), albedo


def corners(material: FloatArray, free: bool) -> list[tuple[list[Node], FloatArray]]:
    """Nodes around W materials (W, 3) and their weights (W,), corner by corner."""
    albedo, sigma_t, g = np.asarray(material, dtype=np.float64).T
    axes = [np.log(np.maximum(sigma_t, 1e-3)) / STEP, -np.log1p(-g) / STEP]
    if not free:
        axes.append(-np.log1p(-np.minimum(albedo, 1.0 - 1e-4)) / DARK_STEP)
    low = [np.floor(axis).astype(int) for axis in axes]
    part = [axis - base for axis, base in zip(axes, low, strict=True)]
    found = []
    for bits in np.ndindex(*(2,) * len(axes)):
        weight = np.ones(len(albedo))
        for bit, own in zip(bits, part, strict=True):
            weight = weight * (own if bit else 1.0 - own)
        index = [base + bit for base, bit in zip(low, bits, strict=True)]
        if free:
            index.append(np.full(len(albedo), -1))
        found.append(([tuple(int(v) for v in row) for row in zip(*index, strict=True)], weight))
    return found  # type: ignore[return-value]


def _reflectances(bench: Bench, at: FloatArray) -> tuple[float, float]:
    black, white = bench.background.black, bench.background.white
    return (
        float(reflectance(black.reflectance, at)[0]), float(reflectance(white.reflectance, at)[0])
    )  # fmt: skip


def _described(world: World, sample: int) -> dict[str, object]:
    """What of a world the light of one sample depends on, reflectances apart."""
    bench = world.bench.model_dump(mode="json", exclude={"instrument", "panel_spectrum", "effects"})
    bench["beam"].pop("spectrum", None)
    for name in ("black", "white"):
        bench["background"][name]["reflectance"] = None
    own = world.samples[sample].model_dump(mode="json", exclude={"name", "material"})
    layers = [[each.share, each.scattering, each.absorption] for each in world.sublayers]
    return {"bench": bench, "sample": own, "layers": layers, "lobe": list(world.second_lobe)}
