"""Noise to expect of relative intensities: light, instrument, lamps, protocol.

To first order, from the described instrument (`twin.instrument.count_variance`), with exposures as
a simulated visit sets them. References are shared by the captures of a sample, and so is their
noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenarios.explore.source import Source
from twin.errors import InputError
from twin.instrument import (
    Exposure,
    Instrument,
    Spectrometer,
    auto_exposure,
    count_variance,
    counts_of_electrons,
    electron_rates,
    expected_electrons,
    fine_grid_nm,
)
from twin.materials import lamp, reflectance
from twin.spectra import FloatArray

CAPTURES = ("black", "white", "collimated")


@dataclass(frozen=True, eq=False)
class Light:
    """Signals of the references, at the wavelengths of a picture.

    Attributes:
        instrument: with these wavelengths as pixels.
        white, beam: signal of the white and the beam reference [electrons/s], shape (W,).
        rho_white: the certified reflectance under which the white's signal was computed, (W,).
        notes: what was assumed.
    """

    instrument: Instrument
    white: FloatArray
    beam: FloatArray
    rho_white: FloatArray
    notes: tuple[str, ...] = ()


def light_of(source: Source) -> Light:
    """The references' signals of a source's bench.

    Raises:
        InputError: an instrument without light.
    """
    described, wavelength = source.bench.instrument, source.wavelength_nm
    pixels = np.asarray(described.wavelength_nm)
    if np.isin(wavelength, pixels).all():
        instrument = described
    else:  # a visit that was made with an instrument nobody described
        instrument = Spectrometer(pixels_nm=tuple(wavelength.tolist()))
    notes: tuple[str, ...] = ()
    try:
        white, beam = _rates(source, instrument)
    except InputError as error:
        level = np.ones(len(instrument.wavelength_nm))
        white = instrument.white_rate_electrons_per_s * level
        beam = instrument.beam_rate_electrons_per_s * level
        notes = (f"noise assumes as much light at every wavelength ({error.found})",)
    at = np.searchsorted(instrument.wavelength_nm, wavelength)
    if isinstance(instrument, Spectrometer):
        instrument = instrument.model_copy(update={"pixels_nm": tuple(wavelength.tolist())})
    return Light(instrument, white[at], beam[at], source.rho_white, notes)


def _rates(source: Source, instrument: Instrument) -> tuple[FloatArray, FloatArray]:
    fine, bench = fine_grid_nm(instrument), source.bench
    panels, beam = lamp(bench.panel_spectrum, fine), lamp(bench.beam.spectrum, fine)
    white = panels * reflectance(bench.background.white.reflectance, fine)
    return (
        electron_rates(instrument, fine, white, reference=white,
                       peak_rate_electrons_per_s=instrument.white_rate_electrons_per_s),
        electron_rates(instrument, fine, beam, reference=beam,
                       peak_rate_electrons_per_s=instrument.beam_rate_electrons_per_s),
    )  # fmt: skip


def covariance_of(
    captures: FloatArray, light: Light, source: Source, averages: int, *, drift: bool = True
) -> FloatArray:
    """Covariance of the relative intensities of each sample, shape (W, S, 3, 3).

    Args:
        captures: expected relative intensities, shape (W, S, 3).
        light: signals of the references.
        source: its protocol says how often what is captured.
        averages: frames of one capture.
        drift: whether lamps drift and flicker.

    Raises:
        InputError: an instrument that saturates at its shortest exposure.
    """
    protocol, instrument = source.protocol, light.instrument
    references = protocol.reference_repeats * (1 + (protocol.references == "first_and_last"))
    panels = auto_exposure(instrument, light.white, fraction=protocol.fill)
    beam = auto_exposure(instrument, light.beam, fraction=protocol.fill)
    rho = light.rho_white
    white, white_noise, panels_dark = _reading(panels, light.white, averages)
    beamed, beam_noise, beam_dark = _reading(beam, light.beam, averages)
    found = np.zeros((*captures.shape, 3))
    seen = np.maximum(captures, 0.0)
    for number in range(captures.shape[1]):
        over = seen[:, number, :2]
        # d I / d reference and d I / d dark of black and white; the two share both
        by_reference = -over / white[:, None]
        by_dark = (over - rho[:, None]) / white[:, None]
        block = found[:, number]
        block[:, :2, :2] += _outer(by_reference) * (white_noise / references)[:, None, None]
        block[:, :2, :2] += (
            _outer(by_dark) * (panels_dark / protocol.reference_repeats)[:, None, None]
        )
        for capture in (0, 1):
            noise = _reading(panels, light.white * over[:, capture] / rho, averages)[1]
            block[:, capture, capture] += (rho / white) ** 2 * noise / protocol.repeats
        through = seen[:, number, 2]
        own = _collimated(source, beam, light.beam * through)
        _, noise, dark = _reading(own, light.beam * through, averages)
        gained = own.integration_s * _gain(own) / (beam.integration_s * _gain(beam))
        block[:, 2, 2] += (noise / protocol.repeats + dark / protocol.reference_repeats) / (
            beamed * gained
        ) ** 2
        block[:, 2, 2] += (
            (through / beamed) ** 2
            * (beam_noise / references + beam_dark / protocol.reference_repeats)
        )  # fmt: skip
    if drift and instrument.has("lamp_drift"):
        found += lamps(source, instrument) * seen[..., :, None] * seen[..., None, :]
    return found


def _reading(
    exposure: Exposure, rate: FloatArray, averages: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signal above dark [counts], variances of reading and dark [counts^2], shape (W,) each."""
    instrument, time = exposure.instrument, exposure.integration_s
    reading, dark = (
        counts_of_electrons(instrument, expected_electrons(instrument, light, time))
        for light in (rate, np.zeros_like(rate))
    )
    return (
        reading - dark,
        count_variance(instrument, reading, dark, averages),
        count_variance(instrument, dark, dark, averages),
    )


def _collimated(source: Source, beam: Exposure, rate: FloatArray) -> Exposure:
    """The collimated capture's exposure: longer than the reference's where little light is left."""
    if not np.any(rate > 0):
        return beam
    own = auto_exposure(beam.instrument, rate, fraction=source.protocol.fill)
    longest = source.protocol.collimated_longest_s
    own = replace(own, integration_s=max(min(own.integration_s, longest), beam.integration_s))
    more = own.integration_s * _gain(own) > beam.integration_s * _gain(beam)
    return own if more else beam


def _gain(exposure: Exposure) -> float:
    return float(getattr(exposure.instrument, "gain", 1.0))


def lamps(source: Source, instrument: Instrument) -> FloatArray:
    """Relative covariance of a sample's captures by the lamps' flicker and walk, shape (3, 3).

    The walk goes on from shot to shot; what references before and after share with a capture
    cancels (as `twin.measurement` propagates it). Two lamps: panels and beam.
    """
    protocol = source.protocol
    again, repeats = protocol.reference_repeats, protocol.repeats
    shots = ["dark"] * (3 * again)
    references = [
        name for name in ("white_reference", "black_reference", "beam_reference")
        for _ in range(again)
    ]  # fmt: skip
    shots += references + [name for name in protocol.order for _ in range(repeats)]
    shots += references if protocol.references == "first_and_last" else []
    names = np.array(shots)

    def mean(name: str) -> FloatArray:
        own = (names == name).astype(np.float64)
        return np.asarray(own / own.sum())

    order = np.arange(len(shots), dtype=np.float64)
    both = instrument.lamp_walk**2 * np.minimum(order[:, None], order[None, :])
    both = both + instrument.lamp_flicker**2 * np.eye(len(shots))
    against = {"black": "white_reference", "white": "white_reference"}
    rows = np.stack([mean(c) - mean(against.get(c, "beam_reference")) for c in CAPTURES])
    found = rows @ both @ rows.T
    found[2, :2] = found[:2, 2] = 0.0
    return np.asarray(found)


def _outer(vector: FloatArray) -> FloatArray:
    return np.asarray(vector[..., :, None] * vector[..., None, :])
