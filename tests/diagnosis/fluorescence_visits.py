"""Simulated fluorescence visits with something wrong that the visit's description does not say.

Lights and channels are disturbed on 0.5 nm, LEDs and bands by their own formulas: not by the code
that the catalogue's effects have.
"""

from __future__ import annotations

from collections.abc import Sequence
from unittest import mock

import numpy as np

from twin.fluorescence import (
    DonaldsonMatrix,
    FluorescenceProtocol,
    FluorescenceSetup,
    FluorescenceVisit,
    binned_light,
    detector_response,
    simulate_fluorescence,
    simulation,
)
from twin.fluorescence.illuminants import Led
from twin.instrument import MultispectralChip
from twin.materials import reflectance
from twin.spectra import FloatArray

Disturbance = tuple[str, int, float]
"""Effect, number of light or channel from 0 (-1: all), value."""


def visit(
    setup: FluorescenceSetup,
    material: DonaldsonMatrix,
    seed: int,
    disturbances: Sequence[Disturbance] = (),
    protocol: FluorescenceProtocol | None = None,
) -> FluorescenceVisit:
    """A visit on a disturbed bench that is described as if nothing were wrong.

    A chip's lights are wrong all through the visit, a spectrometer's only at the sample: it
    measures them on the white.
    """

    def rates(
        own: FluorescenceSetup, truth: DonaldsonMatrix, used: FluorescenceProtocol
    ) -> dict[str, FloatArray]:
        light = binned_light(own.lights, own.excitation_nm)
        response = detector_response(own.detector, own.emission_nm)
        moved, seen = light.copy(), response.copy()
        for effect, number, value in disturbances:
            moved = _lights(own, moved, light, effect, number, value)
            seen = _channels(own, seen, effect, number, value)
        white_light = moved if isinstance(own.detector, MultispectralChip) else light
        same = np.abs(own.emission_nm[:, None] - own.excitation_nm) < 1e-6
        white = white_light @ (same * reflectance(own.white, own.emission_nm)[:, None]).T
        scale = own.detector.white_rate_electrons_per_s / (white @ response.T).max()
        sample = truth.reflected(moved)
        return {"white": scale * white @ seen.T, "sample": scale * sample @ seen.T}

    with mock.patch.object(simulation, "_rates", rates):
        return simulate_fluorescence(setup, material, protocol=protocol, seed=seed)


def _lights(
    setup: FluorescenceSetup, now: FloatArray, light: FloatArray, effect: str, number: int,
    value: float,
) -> FloatArray:  # fmt: skip
    out = now.copy()
    rows = range(len(out)) if number < 0 else [number]
    for row in rows:
        if effect == "illuminant_shift":
            out[row] += _shifted(setup, row, value) - light[row]
        elif effect == "ultraviolet_leak":
            out[row, 0] += value * light[row].sum()
        elif effect == "filter_leak":
            others = light.sum(axis=0)
            out[row] += value * light[row].sum() * others / others.sum()
    return out


def _shifted(setup: FluorescenceSetup, row: int, shift_nm: float) -> FloatArray:
    own, grid = setup.lights[row], setup.excitation_nm
    if isinstance(own, Led):
        return np.asarray(
            binned_light((own.model_copy(update={"peak_nm": own.peak_nm + shift_nm}),), grid)[0]
        )
    step = float(grid[1] - grid[0])
    fine = (grid[:, None] + step * ((np.arange(20) + 0.5) / 20 - 0.5)).reshape(-1)
    return np.asarray(own.spectrum(fine - shift_nm).reshape(-1, 20).mean(axis=1) * step)


def _channels(
    setup: FluorescenceSetup, now: FloatArray, effect: str, number: int, value: float
) -> FloatArray:
    out = now.copy()
    if effect == "cross_talk":
        beside = 0.5 * (np.vstack([now[:1], now[:-1]]) + np.vstack([now[1:], now[-1:]]))
        out = (1.0 - value) * now + value * beside
    elif effect == "sensitivity_error":
        detector = setup.detector
        assert isinstance(detector, MultispectralChip)
        channels = list(detector.channels)
        own = channels[number]
        channels[number] = own.model_copy(update={"centre_nm": own.centre_nm + value})
        changed = detector.model_copy(update={"channels": tuple(channels)})
        response = detector_response(changed, setup.emission_nm)[number]
        plain = detector_response(detector, setup.emission_nm)[number]
        out[number] *= response / np.maximum(plain, 1e-300)
    return out
