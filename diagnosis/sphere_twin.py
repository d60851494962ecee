"""What a set-up with integrating spheres reads, with and without effects at work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from diagnosis.problem import EffectValues
from diagnosis.sphere_effects import CATALOGUE, SphereChange, SphereEffect, change_of
from diagnosis.sphere_slab import slab_light
from twin.errors import InputError
from twin.spectra import FloatArray
from twin.spheres import LossTable, SphereModel
from twin.spheres.lost import G_NODES, LossGeometry
from twin.spheres.readings import Lost, Method, SampleLight, Surfaces, sphere_readings
from twin.spheres.sphere import IntegratingSphere

READINGS = ("M_R", "M_T", "M_U")
STEP = 1e-4
"""Of the differences by which the material's slopes are taken, in coordinates of the fit."""
G_LIMIT = 0.975
ADDED_SLIDE = (1.5, 1.0)
"""Refractive index and thickness [mm] of slides that nobody described."""
THICKER = 0.05
"""Relative thickness at which lost light is found once more; between, and beyond, a line."""
INDEX_NODES = 0.08
"""Distance of the refractive indices between which lost light is interpolated."""


@dataclass(frozen=True, eq=False)
class SphereTwin:
    """Readings of W wavelengths of S samples of one material.

    Coordinates of the material, P in all: logit albedo; artanh g unless g is held; ln of the
    absorption [1/mm] that all dilutions share, where it is searched; ln sigma_t [1/mm] at
    concentration 1, or of every sample where concentrations are not known.

    Attributes:
        models: of the visits.
        visit, row: which visit and row each wavelength of each sample is, (W, S).
        samples: names, S.
        captures: which of `READINGS` were measured.
        concentration: of the samples, (S,), or None where every sample has its own sigma_t.
        held_g: (W,), or None where g is searched.
        diluent: whether the absorption that all dilutions share is searched.
        effects: the catalogue.
        log2_paths: walks per node of the lost light, as a power of two.
        seed: of those walks.
    """

    models: tuple[SphereModel, ...]
    visit: np.ndarray
    row: np.ndarray
    samples: tuple[str, ...]
    captures: tuple[str, ...]
    concentration: FloatArray | None
    held_g: FloatArray | None
    diluent: bool = False
    effects: Sequence[SphereEffect] = CATALOGUE
    log2_paths: int = 14
    seed: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the P coordinates."""
        own = ["logit albedo"]
        own += [] if self.held_g is not None else ["artanh g"]
        own += ["ln mu_a of the diluent"] if self.diluent else []
        if self.concentration is not None:
            return (*own, "ln sigma_t")
        return (*own, *(f"ln sigma_t of {name}" for name in self.samples))

    def forward(self, material: FloatArray, values: EffectValues) -> FloatArray:
        """Expected readings, (W, S C); NaN for a set-up that cannot be."""
        shape = (len(material), len(self.samples) * len(self.captures))
        try:
            change = change_of(values, self.effects)
            return np.asarray(self._readings(self.local(material), change, 1)[0])
        except InputError:
            return np.full(shape, np.nan)

    def jacobian(self, material: FloatArray, values: EffectValues) -> FloatArray:
        """Derivatives by the coordinates, (W, S C, P)."""
        local = self.local(material)
        trials = []
        for index in range(4):
            for side in (STEP, -STEP):
                moved = local.copy()
                moved[..., index] += side
                trials.append(moved)
        found = self._readings(
            np.concatenate(trials, axis=1), change_of(values, self.effects), len(trials)
        )
        slope = (found[0::2] - found[1::2]) / (2.0 * STEP)
        columns = [slope[0]]
        columns += [] if self.held_g is not None else [slope[1]]
        columns += [slope[2]] if self.diluent else []
        if self.concentration is not None:
            columns.append(slope[3])
        else:
            owner = np.repeat(np.arange(len(self.samples)), len(self.captures))
            columns += [slope[3] * (owner == s) for s in range(len(self.samples))]
        return np.stack(columns, axis=-1)

    def local(self, material: FloatArray) -> FloatArray:
        """(logit albedo, artanh g, ln diluent, ln sigma_t) of every sample, (W, S, 4)."""
        shape = (len(material), len(self.samples))
        columns = iter(np.moveaxis(material, 1, 0))
        own = np.empty((*shape, 4))
        own[..., 0] = next(columns)[:, None]
        g = np.arctanh(self.held_g) if self.held_g is not None else next(columns)
        own[..., 1] = g[:, None]
        own[..., 2] = next(columns)[:, None] if self.diluent else -np.inf
        if self.concentration is not None:
            own[..., 3] = next(columns)[:, None] + np.log(self.concentration)
        else:
            own[..., 3] = np.stack(list(columns), axis=1)
        return own

    def parameters(self, local: FloatArray, change: SphereChange) -> FloatArray:
        """Albedo, sigma_t [1/mm] and g of every sample, (W, K S, 3), of local coordinates."""
        several = local.shape[1] // len(self.samples)
        bound = np.clip(local, -16.0, 16.0)
        added = np.exp(bound[..., 3])
        more = np.array([change.concentration.get(name, 0.0) for name in self.samples])
        added = added * np.tile(1.0 + more, several)
        diluent = np.where(np.isfinite(local[..., 2]), np.exp(bound[..., 2]), 0.0) + change.diluent
        albedo = added / (1.0 + np.exp(-bound[..., 0])) / (added + diluent)
        g = np.clip(np.tanh(bound[..., 1]), -G_LIMIT, G_LIMIT)
        return np.stack([np.clip(albedo, 1e-7, 1.0 - 1e-7), added + diluent, g], axis=-1)

    def lost_error(self, material: FloatArray) -> FloatArray:
        """Standard errors of the lost light's Monte Carlo in the readings, (W, S C)."""
        found = np.zeros((len(material), len(self.samples), len(self.captures)))
        parameters = self.parameters(self.local(material), SphereChange())
        for number, model in enumerate(self.models):
            if model.loss_geometry is None:
                continue
            inside = self.visit == number
            table = self._table(number, model.loss_geometry)
            lost = table.at(parameters[inside], model.n[self.row[inside]])
            for column, capture in enumerate(self.captures):
                if capture != "M_U":
                    found[inside, column] = lost.standard_error[:, READINGS.index(capture)]
        return found.reshape(len(material), -1)

    def _readings(self, local: FloatArray, change: SphereChange, several: int) -> FloatArray:
        """Readings of `several` sets of samples beside each other, (several, W, S C)."""
        parameters = self.parameters(local, change)
        visit, row = np.tile(self.visit, several), np.tile(self.row, several)
        found = np.empty((*visit.shape, 3))
        for number in range(len(self.models)):
            inside = visit == number
            found[inside] = self._visit(number, row[inside], parameters[inside], change)
        for capture, offset in change.offset.items():
            found[..., READINGS.index(capture)] += offset
        kept = found[..., [READINGS.index(capture) for capture in self.captures]]
        apart = kept.reshape(len(local), several, len(self.samples) * len(self.captures))
        return np.moveaxis(apart, 1, 0)

    def _visit(
        self, number: int, rows: np.ndarray, parameters: FloatArray, change: SphereChange
    ) -> FloatArray:
        """M_R, M_T and M_U of some rows of a visit, (N, 3)."""
        model = self.models[number]
        described = self._method(number, model, rows, parameters, change)
        if not change.slides:
            return described
        bare = np.all(model.slide_n[rows] <= 1.0)
        n, thick = ADDED_SLIDE if bare else (1.0, 0.0)
        geometry = model.loss_geometry
        if geometry is not None:
            geometry = replace(geometry, slide_n=n, slide_thickness_mm=thick)
        swapped = replace(
            model, slide_n=np.full(model.rows, n), slide_depth=np.zeros(model.rows),
            loss_geometry=geometry,
        )  # fmt: skip
        opposite = self._method(number, swapped, rows, parameters, replace(change, slide_index=0.0))
        return (1.0 - change.slides) * described + change.slides * opposite

    def _method(
        self, number: int, model: SphereModel, rows: np.ndarray, parameters: FloatArray,
        change: SphereChange,
    ) -> FloatArray:  # fmt: skip
        """Readings with the slides as they are, mixed of both methods."""
        setup = model.setup
        if change.port and setup.spheres:
            setup = replace(
                setup,
                reflection=_port(setup.reflection, change.port),
                transmission=_port(setup.transmission, change.port),
            )
        setup = replace(
            setup,
            unscattered_in_r=setup.unscattered_in_r * (1.0 - change.specular),
            unscattered_in_t=setup.unscattered_in_t * (1.0 - change.ballistic),
        )
        slide_n = model.slide_n[rows]
        light = slab_light(
            float(np.cos(np.radians(model.incidence_deg))),
            parameters,
            model.thickness_mm[rows] * (1.0 + change.thickness),
            model.n[rows] + change.index,
            np.where(slide_n > 1.0, np.maximum(slide_n + change.slide_index, 1.0), slide_n),
            model.slide_depth[rows],
        )
        lost = self._lost(number, model, rows, parameters, change, light)
        surfaces = Surfaces(
            model.wall_r[rows] + change.wall,
            model.wall_t[rows] + change.wall,
            model.standard_r[rows] * (1.0 + change.standard),
            model.standard_t[rows],
        )
        read_r, read_t = sphere_readings(setup, light, lost, surfaces)
        if change.correction and setup.spheres == 1:
            twin: Method = "comparison" if setup.method == "substitution" else "substitution"
            other_r, other_t = sphere_readings(replace(setup, method=twin), light, lost, surfaces)
            read_r = read_r + change.correction * (other_r - read_r)
            read_t = read_t + change.correction * (other_t - read_t)
        if setup.spheres:
            # M_R is read in units of the described standard
            read_r = read_r / (1.0 + change.standard)
        scattered = light.transmittance - light.unscattered_transmittance
        unscattered = light.unscattered_transmittance + change.acceptance * scattered
        return np.stack([read_r, read_t, unscattered], axis=-1)

    def _lost(
        self, number: int, model: SphereModel, rows: np.ndarray, parameters: FloatArray,
        change: SphereChange, light: SampleLight,
    ) -> Lost:  # fmt: skip
        """Light beside the ports; thickness enters along a line between two tables."""
        if model.loss_geometry is None:
            return Lost()
        n = model.n[rows] + change.index
        share = self._table(number, model.loss_geometry).at(parameters, n).share
        if change.thickness:
            thicker = replace(
                model.loss_geometry,
                thickness_mm=model.loss_geometry.thickness_mm * (1.0 + THICKER),
            )
            more = self._table(number, thicker).at(parameters, n).share
            share = share + (more - share) * (change.thickness / THICKER)
        share = share * (1.0 + change.lost)
        scattered = np.stack(
            [
                light.reflectance - light.unscattered_reflectance,
                light.transmittance - light.unscattered_transmittance,
                light.diffuse_reflectance,
                light.diffuse_transmittance,
            ],
            axis=-1,
        )
        return Lost(*np.clip(share, 0.0, scattered).T)

    def _table(self, number: int, geometry: LossGeometry) -> LossTable:
        n = self.models[number].n
        middle = np.unique([n.min(), n.max()]) if np.ptp(n) > 2e-3 else np.array([n.mean()])
        nodes = np.unique([middle[0] - INDEX_NODES, *middle, middle[-1] + INDEX_NODES])
        g_nodes = G_NODES
        if self.held_g is not None and np.ptp(self.held_g) == 0.0:
            g_nodes = self.held_g[:1]
        return _loss_table(
            geometry, tuple(g_nodes.tolist()), tuple(np.maximum(nodes, 1.0).tolist()),
            self.log2_paths, self.seed,
        )  # fmt: skip


@lru_cache(maxsize=64)
def _loss_table(
    geometry: LossGeometry,
    g_nodes: tuple[float, ...],
    n_nodes: tuple[float, ...],
    log2_paths: int,
    seed: int,
) -> LossTable:
    """One table for all twins of a geometry: what it holds does not depend on who asks."""
    return LossTable(geometry, np.array(g_nodes), np.array(n_nodes), log2_paths, seed)


def _port(sphere: IntegratingSphere | None, change: float) -> IntegratingSphere | None:
    if sphere is None:
        return None
    return replace(sphere, sample_port_mm=sphere.sample_port_mm * np.sqrt(max(1.0 + change, 0.0)))
