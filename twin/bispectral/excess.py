"""What a fluorescent sample adds to the captures of the translucent bench under its own lamp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.materials import OpticalProperties


def fluorescence_excess(
    bench: Bench,
    samples: Sequence[Sample],
    properties: OpticalProperties,
    wavelength_nm: ArrayLike,
    lamp: ArrayLike,
    excitation: ArrayLike,
    emission: ArrayLike,
    strength: float = 1.0,
    *,
    units: Literal["photons", "energy"] = "photons",
    beam_lamp: ArrayLike | None = None,
    self_absorption: bool = False,
) -> FloatArray:
    """Relative intensity that fluorescence of the sample adds, by the fast plane-parallel route.

    A spectrometer behind the sample cannot tell emission at a wavelength from light reflected
    there, so what the lamp excites at shorter wavelengths i adds to the relative intensity at o

        dI(o) = sum over i < o of lamp(i) step(i) B(o, i) / lamp(o),

    B the bispectral radiance factor per nm of `twin.bispectral.donaldson`, one re-emission. It
    is linear in the strength unless `self_absorption` is on.

    Args:
        bench: the bench.
        samples: S samples of one material and index.
        properties: the non-fluorescent host at the wavelengths, (W,) each; a second lobe of
            its phase function is not seen: fluorescence is nearly blind to all but g.
        wavelength_nm: increasing [nm], (W,); it should reach down to where the lamp begins:
            light outside it excites nothing here.
        lamp: relative spectral power per nm of the panels, (W,), above 0.
        excitation: shape of the fluorophore's absorption, (W,), at least 0 (1 at its peak when
            `strength` is to be the peak).
        emission: shape of its emission per nm, (W,), at least 0; normalised here to 1 over the
            wavelengths.
        strength: absorption coefficient [1/mm] at excitation 1 times quantum yield.
        units: what `emission` counts; the quantum yield always counts photons.
        beam_lamp: the same of the beam, (W,); None: the panels' lamp.
        self_absorption: the fluorophore also takes light away (quantum yield 1): the excess then
            has what is reabsorbed taken off and is not linear in the strength.

    Returns:
        Added relative intensity, shape (S, 3, W): black, white, collimated.

    Raises:
        InputError: shapes that differ, a lamp without light at a wavelength, values below 0, or
            a bench that plane-parallel layers cannot show.
    """
    from twin.bispectral.medium import bin_widths, emission_table, photon_density
    from twin.bispectral.profiles import fast_model, fluorescence_of

    wave = np.asarray(wavelength_nm, dtype=np.float64)
    step = bin_widths(wave)
    spectra = {"lamp": lamp, "beam_lamp": lamp if beam_lamp is None else beam_lamp}
    light = {name: _checked(name, values, wave) for name, values in spectra.items()}
    for name, values in light.items():
        if values.min() <= 0.0:
            raise InputError(
                f"no light at {wave[int(np.argmin(values))]:g} nm",
                "a lamp with light at every wavelength: an intensity is relative to it",
                place=name,
            )
    shape = _checked("excitation", excitation, wave)
    if not np.isfinite(strength) or strength < 0.0:
        raise InputError(f"{strength:g}", "a strength of at least 0 [1/mm]", place="strength")
    table = emission_table(wave, photon_density(wave, np.asarray(emission, dtype=float), units))
    scattering = properties.albedo * properties.sigma_t_per_mm
    total = properties.sigma_t_per_mm + (strength * shape if self_absorption else 0.0)
    albedo = np.where(total > 0.0, scattering / np.where(total > 0.0, total, 1.0), 0.0)
    model = fast_model(bench, samples, wave, properties.g)
    source = strength * table * shape[None, :]
    factors = fluorescence_of(model, albedo, total, properties.g, source)
    lamps = np.stack([light["lamp"], light["lamp"], light["beam_lamp"]])
    excess = np.einsum("scoi,ci,i->sco", factors, lamps, step) / lamps
    return np.asarray(excess)


def _checked(name: str, values: ArrayLike, wave: FloatArray) -> FloatArray:
    found = np.asarray(values, dtype=np.float64)
    if found.shape != wave.shape or not np.isfinite(found).all() or np.any(found < 0.0):
        raise InputError(
            f"shape {found.shape} with values from {np.min(found, initial=np.inf):g}",
            f"{len(wave)} finite values of at least 0",
            place=name,
        )
    return found
