"""From a fluorescence visit to what estimators get: corrected captures with their covariance."""

from __future__ import annotations

import numpy as np

from twin.errors import InputError
from twin.fluorescence.calibration import Calibration, calibrate
from twin.fluorescence.readings import Signals, signals
from twin.fluorescence.system import FluorescenceData
from twin.fluorescence.visit import FluorescenceVisit
from twin.spectra import FloatArray

BRIGHT = 0.2
"""Share of a channel's brightest direct light above which an illuminant says its reflectance."""


def corrected(visit: FluorescenceVisit) -> FluorescenceData:
    """Captures on the scale of the calibrated illuminants, with what their errors share.

    Independent errors: the counts of sample, white and dark. Common ones: the drift of each lamp
    between white and sample (level and tilt; a chip's two passes apart), the level of each
    illuminant and the gain of each channel where the white gave no more, and the fixed pattern of
    a spectrometer's pixels, which reflectance does not feel and fluorescence does.

    Raises:
        InputError: as `signals` and `calibrate`; no usable capture.
    """
    found = signals(visit)
    known = calibrate(visit.setup, found)
    value = found.sample / known.scale
    variance = found.sample_variance / known.scale**2
    fluorescent, ratio = _parts(found, known, value)
    if known.resolved:
        # value - model: the model reflects the measured white, so the white's noise comes in; the
        # dark that both had taken off cancels as far as the sample reflects like the white.
        white = ratio**2 * found.white_variance - 2.0 * ratio * found.dark_variance
        variance = variance + white / known.scale**2
    safe = np.where(found.valid, value, 0.0)
    modes: list[FloatArray] = []
    labels: list[str] = []
    modes += [mode * safe for mode in known.modes]
    labels += ["lamps and calibration on the white"] * len(known.modes)
    if known.resolved:
        relative = _relative_light(found, _pattern(visit))
        for row, name in enumerate(visit.setup.illuminant_names):
            mode = np.zeros_like(safe)
            mode[row] = relative[row] * fluorescent[row]
            modes.append(mode)
            labels.append(f"white under {name}")
        pattern = _pattern(visit)
        if pattern > 0.0:
            # The same pixels measure the exciting light under every illuminant: two bins, say.
            modes.append(pattern / np.sqrt(2.0) * fluorescent)
            labels.append("sensitivity where the light excites")
            for column, name in enumerate(visit.setup.channel_names):
                mode = np.zeros_like(safe)
                mode[:, column] = pattern * fluorescent[:, column]
                modes.append(mode)
                labels.append(f"sensitivity of {name}")
    kept = [index for index, mode in enumerate(modes) if np.any(mode != 0.0)]
    reasons = [*visit.provenance.notes, *found.reasons, *known.reasons]
    negative = int((value[found.valid] < 0.0).sum())
    if negative:
        reasons.append(f"{negative} captures are below 0 by noise and left so")
    valid = found.valid & np.isfinite(variance)
    if not valid.any():
        raise InputError("no usable capture", "one or more", place="counts")
    return FluorescenceData(
        known.system,
        np.where(valid, value, np.nan),
        np.where(valid, variance, np.nan),
        np.array([modes[index] for index in kept]).reshape(len(kept), *safe.shape),
        valid,
        tuple(reasons),
        tuple(labels[index] for index in kept),
        visit.sample,
        visit.truth,
    )


def _parts(found: Signals, known: Calibration, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A rough split of the captures, (J, K) each: what fluoresces, and reflected over white.

    The reflectance of a channel is the least that illuminants with much direct light there say:
    fluorescence only adds. Only error bars use it.
    """
    white = np.where(found.valid, found.white, 0.0) / known.scale
    sample = np.where(found.valid, value, 0.0)
    bright = white > BRIGHT * white.max(axis=0)
    factor = np.where(bright, sample / np.where(bright, white, 1.0), np.inf).min(axis=0)
    factor = np.clip(factor, 0.0, 1.5)
    ratio = np.asarray(np.broadcast_to(factor, white.shape))
    return np.maximum(sample - factor * white, 0.0), ratio


def _relative_light(found: Signals, pattern: float) -> FloatArray:
    """Relative error of the light that excites, by the white's noise and the fixed pattern, (J,).

    An excitation band covers some bins of the illuminant, not all: as if it were its three
    brightest. Bins that the detector does not see take their level from the others.
    """
    white = np.where(found.valid, found.white, 0.0)
    spread = np.where(found.valid, found.white_variance, 0.0)
    rows = []
    for light, noise in zip(white, spread, strict=True):
        brightest = np.argsort(light)[-3:]
        total = max(light[brightest].sum(), 1e-300)
        bins = total**2 / max((light[brightest] ** 2).sum(), 1e-300)
        rows.append(np.sqrt(noise[brightest].sum() / total**2 + pattern**2 / bins))
    return np.array(rows)


def _pattern(visit: FluorescenceVisit) -> float:
    """Relative spread of the pixels' sensitivity that is not calibrated away."""
    instrument = visit.setup.detector
    return instrument.photo_response_nonuniformity if instrument.has("nonuniformity") else 0.0
