"""The fast engine on a world: adding-doubling times the nominal factors of the finite bench."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bench import Background, Bench, Sample
from twin.effects.world import World
from twin.instrument import Spectrometer
from twin.materials import reflectance
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.adding_doubling import CapturesModel, Constants, Form, Parameters
    from twin.appearance import FiniteFactors


@dataclass(frozen=True, eq=False)
class FastLight:
    """Noiseless light of worlds near one bench, in milliseconds each.

    What an effect changes goes into the constants of the compiled program and not into its form,
    so that nothing is compiled again, but for a number of covers, a second lobe of the phase
    function or layers inside the samples that no world had before.

    Attributes:
        wavelength_nm: [nm], shape (W,).
        factors: `twin.appearance.FiniteFactors` of the nominal bench, one for each sample, or ().
    """

    wavelength_nm: FloatArray
    factors: tuple[FiniteFactors, ...] = ()
    _models: dict[Any, CapturesModel] = field(default_factory=dict, repr=False)

    def captures(self, world: World, material: FloatArray) -> FloatArray:
        """Relative intensities as the plane-parallel engine sees the world, shape (W, S, 3).

        Effects of the engine "monte_carlo" are left out: see `EffectEngine`.

        Args:
            world: the world.
            material: albedo, sigma_t [1/mm] and g, shape (W, 3).

        Raises:
            InputError: a world that a plane-parallel stack cannot show.
        """
        total: FloatArray | float = 0.0
        known = [sample.thickness_mm for sample in world.described_samples]
        given = np.asarray(material, dtype=np.float64)
        for view in world.views():
            samples = tuple(
                sample.model_copy(update={"thickness_mm": stated, "name": "any", "material": None})
                for sample, stated in zip(view.samples, known, strict=True)
            )
            background = view.bench.background
            model = self._model(view.bench, samples, world)
            parameters = model.parameters(
                *given.T,
                thickness_mm=[sample.thickness_mm for sample in view.samples],
                rho_black=reflectance(background.black.reflectance, self.wavelength_nm),
                rho_white=reflectance(background.white.reflectance, self.wavelength_nm),
            )
            found = _program()(parameters, model.constants, self.factors, model.form)
            total = total + np.asarray(found) * np.array(view.weight)
        return np.asarray(total)

    def _model(self, bench: Bench, samples: tuple[Sample, ...], world: World) -> CapturesModel:
        """The model of a bench: reflectances and thicknesses are parameters and make no other."""
        from twin.adding_doubling import ObliqueBeam, captures_model

        background = bench.background
        grey = {"black": NOTHING, "white": NOTHING, "gap_mm": background.gap_mm}
        fields = {"background": background.model_copy(update=grey), "instrument": Spectrometer()}
        plain = bench.model_copy(update=fields)
        lobe = world.second_lobe
        layers = tuple((own.share, own.scattering, own.absorption) for own in world.sublayers)
        said = world.described_bench
        moved = (plain.beam.divergence_deg, plain.beam.tilt_deg) != (
            said.beam.divergence_deg, said.beam.tilt_deg,
        )  # fmt: skip
        oblique = moved or not (self.factors or plain.beam.straight)
        key = (plain, samples, lobe, layers, said if oblique else None)
        if key not in self._models:
            if len(self._models) >= MOST_MODELS:
                self._models.clear()
            own = (plain.beam.divergence_deg, plain.beam.tilt_deg)
            beam = ObliqueBeam(*self._beam(plain, said, samples), *own) if oblique else None
            self._models[key] = captures_model(
                plain, samples, self.wavelength_nm, second=lobe if lobe[0] else None,
                sublayers=layers, beam=beam,
            )  # fmt: skip
        return self._models[key]

    def _beam(
        self, bench: Bench, said: Bench, samples: tuple[Sample, ...]
    ) -> tuple[float, FloatArray]:
        """Cosine of a beam, and shares of it that the empty bench collects, (S,).

        The factors of the nominal bench have the share of the described beam in them.
        """
        from twin.transport.bench_captures import collected_share
        from twin.transport.geometry import accepted_cosine, height_of_stack

        heights = [height_of_stack(bench, sample) for sample in samples]
        share = np.array([collected_share(bench, height) for height in heights])
        if self.factors:
            share = share / np.array([collected_share(said, height) for height in heights])
        return accepted_cosine(bench), share


NOTHING = Background(reflectance=0.0)
MOST_MODELS = 256
"""Benches kept; a fit visits each of its own once."""


def _captures_of(
    parameters: Parameters, constants: Constants, factors: tuple[FiniteFactors, ...], form: Form
) -> Any:
    from twin.adding_doubling import parts_of
    from twin.appearance import finite_captures

    parts = parts_of(parameters, constants, form)
    if not factors:
        return parts.captures(parameters.rho_black[:, None], parameters.rho_white[:, None])
    return finite_captures(parts, factors, parameters)


@lru_cache(maxsize=1)
def _program() -> Any:
    import jax

    return jax.jit(_captures_of, static_argnames=("form",))
