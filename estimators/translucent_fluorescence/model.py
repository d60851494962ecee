"""The forward model: elastic captures and depth profiles, with exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from estimators.forward import Forward
from estimators.protocol import BenchModel
from estimators.translucent_fluorescence.correction import Correction
from estimators.translucent_fluorescence.spectra import SplineBasis, log_spline_basis
from twin.bench import Bench, Sample
from twin.bispectral import bin_widths, emission_table
from twin.spectra import FloatArray

NAMES = ("albedo", "sigma_t_per_mm", "g")
HOST = 3


@lru_cache(maxsize=1)
def _program() -> Any:
    """Compiled: lit and seen profiles over black and white, (4, W, S, Z), with slopes (.., 3)."""
    import jax
    import jax.numpy as jnp

    from twin.adding_doubling import value_and_slopes
    from twin.bispectral.fields import fields_of

    def run(parameters: Any, constants: Any, form: Any) -> Any:
        def profiles(moved: Any) -> Any:
            fields = fields_of(moved, constants, form)
            rho = (moved.rho_black[:, None], moved.rho_white[:, None])
            return jnp.stack(
                [fields.lit(rho[0]), fields.lit(rho[1]), fields.seen(rho[0]), fields.seen(rho[1])]
            )

        return value_and_slopes(profiles, parameters, NAMES)

    return jax.jit(run, static_argnames=("form",))


@dataclass(frozen=True)
class State:
    """The unknowns, in coordinates without bounds.

    Attributes:
        host: (W, 3): log sigma_a, log sigma_s', artanh g; sigma_a with the fluorophore.
        excitation: coefficients of log (quantum yield times fluorophore's absorption), (X,).
        emission: coefficients of log emission, (E,); its sum does not matter.
    """

    host: FloatArray
    excitation: FloatArray
    emission: FloatArray

    @property
    def vector(self) -> FloatArray:
        """All unknowns, (3 W + X + E,)."""
        return np.concatenate([self.host.ravel(), self.excitation, self.emission])

    def moved(self, vector: FloatArray) -> State:
        """A state of the same shape from a vector."""
        host, excites = self.host.size, len(self.excitation)
        return State(
            vector[:host].reshape(self.host.shape),
            vector[host : host + excites],
            vector[host + excites :],
        )

    @property
    def material(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Albedo, sigma_t [1/mm], g, (W,) each."""
        absorption, g = np.exp(self.host[:, 0]), np.tanh(self.host[:, 2])
        scattering = np.exp(self.host[:, 1]) / (1.0 - g)
        total = absorption + scattering
        return scattering / total, total, g


def _chain(state: State) -> FloatArray:
    """Slopes of albedo, sigma_t and g by the host's coordinates, (W, 3 of material, 3)."""
    albedo, total, g = state.material
    found = np.zeros((len(albedo), HOST, HOST))
    absorption, scattering = (1.0 - albedo) * total, albedo * total
    # g raises sigma_s at constant sigma_s'
    d_g = 1.0 - g**2
    d_scattering = scattering / (1.0 - g) * d_g
    found[:, 0, 0] = -albedo * (1.0 - albedo)
    found[:, 0, 1] = albedo * (1.0 - albedo)
    found[:, 0, 2] = d_scattering * (1.0 - albedo) / total
    found[:, 1, 0], found[:, 1, 1], found[:, 1, 2] = absorption, scattering, d_scattering
    found[:, 2, 2] = d_g
    return found


@dataclass(frozen=True, eq=False)
class FluorescentForward:
    """Signals of a visit as a function of the unknowns.

    Attributes:
        forward: elastic captures; bases: of excitation and emission; step_nm: (W,);
        correction: what the finite bench and further re-emissions change.
    """

    forward: Forward
    wavelength_nm: FloatArray
    step_nm: FloatArray
    excitation: SplineBasis
    emission: SplineBasis
    correction: Correction | None = None

    @classmethod
    def of(
        cls,
        bench: Bench,
        samples: Sequence[Sample],
        wavelength_nm: FloatArray,
        *,
        excitation_nm: tuple[float, float] | None = None,
        emission_nm: tuple[float, float] | None = None,
        knot_nm: float = 20.0,
        correction: Correction | None = None,
    ) -> FluorescentForward:
        """The model of a bench.

        Args:
            bench: covers must not scatter.
            samples: S samples of one material and index.
            wavelength_nm: increasing [nm], (W,).
            excitation_nm: range outside which nothing is excited; None: all but the last
                wavelength.
            emission_nm: range outside which nothing is emitted; None: all but the first.
            knot_nm: distance of the splines' knots [nm].
            correction: of `correction_of`.

        Raises:
            InputError: see `Forward.of`.
        """
        wave = np.asarray(wavelength_nm, dtype=np.float64)
        model = BenchModel.of(bench, samples, wave)
        excites = excitation_nm or (wave[0], wave[-2])
        emits = emission_nm or (wave[1], wave[-1])
        return cls(
            Forward.of(model),
            wave,
            bin_widths(wave),
            log_spline_basis(wave, excites[0], excites[1], knot_nm),
            log_spline_basis(wave, emits[0], emits[1], knot_nm),
            correction,
        )

    def corrected(self, correction: Correction) -> FluorescentForward:
        """The same with what the finite bench changes."""
        return FluorescentForward(
            self.forward, self.wavelength_nm, self.step_nm, self.excitation, self.emission,
            correction,
        )  # fmt: skip

    @property
    def coordinates(self) -> int:
        """Number of unknowns."""
        waves = len(self.wavelength_nm)
        return HOST * waves + self.excitation.size + self.emission.size

    def excites(self, state: State) -> FloatArray:
        """Quantum yield times the fluorophore's absorption [1/mm], (W,)."""
        return self.excitation.values(state.excitation)

    def emits(self, state: State) -> FloatArray:
        """Emission in photons per nm, normalised over the wavelengths, (W,)."""
        shape = self.emission.values(state.emission)
        return np.asarray(shape / (self.step_nm @ shape))

    def source(self, state: State) -> FloatArray:
        """Energy emitted at o per nm, per length and fluence at i [1/mm/nm], (W out, W in)."""
        table = emission_table(self.wavelength_nm, self.emits(state))
        return np.asarray(table * self.excites(state)[None, :])

    def elastic(self, state: State) -> FloatArray:
        """Relative intensities black, white, collimated without fluorescence, (S, 3, W)."""
        captures = self.forward.captures
        value = self.forward.forward(captures.parameters(*state.material))
        found = np.asarray(value).transpose(1, 2, 0)
        return found if self.correction is None else found * self.correction.elastic

    def fluorescent(self, state: State) -> FloatArray:
        """Bispectral radiance factor over black and white [1/nm], (S, 2, W out, W in)."""
        profiles, _ = self._profiles(state)
        return self._kernel(profiles) * self.source(state)

    def _profiles(self, state: State) -> tuple[FloatArray, FloatArray]:
        captures = self.forward.captures
        found = _program()(captures.parameters(*state.material), captures.constants, captures.form)
        return np.asarray(found[0]), np.asarray(found[1])

    def _scale(self) -> FloatArray:
        """Thickness over 4 n^2 with the correction, (S, 2, W out, W in)."""
        nominal = self.forward.captures.nominal
        thickness, n = np.asarray(nominal.thickness_mm), np.asarray(nominal.n)
        scale = thickness[:, None, None, None] / (4.0 * n[:, None] ** 2)
        waves = len(self.wavelength_nm)
        whole = np.broadcast_to(scale, (len(thickness), 2, waves, waves))
        return whole if self.correction is None else whole * self.correction.fluorescent

    def _kernel(self, profiles: FloatArray) -> FloatArray:
        """Fluorescence per source, (S, 2, W out, W in)."""
        from twin.bispectral.fields import depth_nodes

        lit, seen = profiles[:2], profiles[2:]
        return np.asarray(
            np.einsum("bosz,z,bisz->sboi", seen, depth_nodes()[1], lit) * self._scale()
        )

    def emitted(self, state: State, lights: FloatArray) -> FloatArray:
        """The fluorescent part of the signal, (L, S, 2, W)."""
        power = lights * self.step_nm
        return np.asarray(np.einsum("sboi,li->lsbo", self.fluorescent(state), power))

    def predict(self, state: State, lights: FloatArray) -> FloatArray:
        """Expected data, (N,), in the order of `LedMeasurement.values`.

        Args:
            state: the unknowns.
            lights: (L, W).
        """
        elastic = self.elastic(state)
        signal = lights[:, None, None] * elastic[None, :, :2] + self.emitted(state, lights)
        return np.concatenate([signal.ravel(), elastic[:, 2].ravel()])

    def jacobian(self, state: State, lights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`predict`, (N,), and its derivatives by `State.vector`, (N, P)."""
        from twin.bispectral.fields import depth_nodes

        captures = self.forward.captures
        value, slope = self.forward.forward_and_jacobian(captures.parameters(*state.material))
        chain = _chain(state)
        elastic = np.asarray(value).transpose(1, 2, 0)
        d_elastic = np.einsum("oscm,omp->scop", np.asarray(slope), chain)
        if self.correction is not None:
            elastic = elastic * self.correction.elastic
            d_elastic = d_elastic * self.correction.elastic[..., None]
        profiles, d_profiles = self._profiles(state)
        d_profiles = np.einsum("kwszm,wmp->kwszp", d_profiles, chain)
        weight, scale = depth_nodes()[1], self._scale()
        kernel = self._kernel(profiles)
        lit, seen, d_lit, d_seen = profiles[:2], profiles[2:], d_profiles[:2], d_profiles[2:]
        by_out = np.einsum("boszp,z,bisz->sboip", d_seen, weight, lit) * scale[..., None]
        by_in = np.einsum("bosz,z,biszp->sboip", seen, weight, d_lit) * scale[..., None]
        source = self.source(state)
        power = lights * self.step_nm
        emitted = np.einsum("sboi,oi,li->lsbo", kernel, source, power)
        signal = lights[:, None, None] * elastic[None, :, :2] + emitted
        samples, waves = elastic.shape[0], len(self.wavelength_nm)
        host = np.einsum("sboip,oi,li->lsboip", by_in, source, power)
        own = lights[:, None, None, :, None] * d_elastic[None, :, :2]
        own = own + np.einsum("sboip,oi,li->lsbop", by_out, source, power)
        diagonal = np.arange(waves)
        host[:, :, :, diagonal, diagonal] += own
        excites = np.einsum("sboi,oi,li,ix->lsbox", kernel, source, power, self.excitation.matrix)
        share = self.step_nm * self.emits(state)
        turned = self.emission.matrix - share @ self.emission.matrix
        emits = emitted[..., None] * turned
        columns = [part.reshape(signal.size, -1) for part in (host, excites, emits)]
        beam = np.zeros((samples, waves, waves, HOST))
        beam[:, diagonal, diagonal] = d_elastic[:, 2]
        rest = np.zeros((samples * waves, excites.shape[-1] + emits.shape[-1]))
        below = np.concatenate([beam.reshape(samples * waves, -1), rest], axis=1)
        found = np.concatenate([np.concatenate(columns, axis=1), below])
        return np.concatenate([signal.ravel(), elastic[:, 2].ravel()]), found
