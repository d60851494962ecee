"""The fast engine with a memory: a diagnosis asks for the same light again and again.

Effects of the signal leave the light as it is, slopes start from worlds that were seen before,
and the fit without effects is made twice.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from twin.effects import EffectEngine, World
from twin.effects.fast import FastLight
from twin.effects.lattice import Lattice, Node, NodeResponse
from twin.spectra import FloatArray

MOST = 4096
"""Lights kept: 2 kB each for 31 wavelengths and three samples."""


@dataclass(frozen=True, eq=False)
class KeptLight(FastLight):
    """`FastLight` that keeps what it found."""

    _kept: dict[Hashable, FloatArray] = field(default_factory=dict, repr=False)

    def captures(self, world: World, material: FloatArray) -> FloatArray:
        """Relative intensities of the plane-parallel engine, shape (W, S, 3); read-only."""
        given = np.asarray(material, dtype=np.float64)
        # All of a world that this engine looks at: `FastLight.captures`.
        key = (
            world.views(),
            tuple(sample.thickness_mm for sample in world.described_samples),
            world.second_lobe,
            world.sublayers,
            given.tobytes(),
        )
        found = self._kept.get(key)
        if found is None:
            found = super().captures(world, material)
            found.flags.writeable = False
            if len(self._kept) >= MOST:
                self._kept.clear()
            self._kept[key] = found
        return found


@dataclass(frozen=True, eq=False)
class KeptLattice(Lattice):
    """`Lattice` that reads no file twice."""

    _nodes: dict[Hashable, dict[Node, NodeResponse]] = field(default_factory=dict, repr=False)

    def nodes(self, changed: World, sample: int, nodes: set[Node]) -> dict[Node, NodeResponse]:
        """Responses of a sample from `world` to `changed` at nodes."""
        own = changed.samples[sample]
        key = (changed.bench, own, changed.sublayers, changed.second_lobe, sample)
        kept = self._nodes.setdefault(key, {})
        if missing := nodes - kept.keys():
            kept.update(super().nodes(changed, sample, missing))
        return {node: kept[node] for node in nodes}


@dataclass(frozen=True, eq=False)
class KeptEngine(EffectEngine):
    """`EffectEngine` whose plane-parallel light and Monte Carlo responses are kept."""

    def _new_lattice(self, paths: int) -> Lattice:
        """The Monte Carlo's responses, with a memory."""
        plain = super()._new_lattice(paths)
        return KeptLattice(**{each.name: getattr(plain, each.name) for each in fields(Lattice)})

    @cached_property
    def fast(self) -> FastLight:
        """The plane-parallel engine with the nominal factors and a memory."""
        return KeptLight(np.asarray(self.wavelength_nm, dtype=np.float64), self.factors)
