"""What cheap parts do to captures: spectra that have moved, channels that are not as stated.

Effects of the catalogue (`twin.effects`, bench "fluorescence") at their prior scales, in the
captures of every material, as the estimator sees them: after the white has set levels and gains
once more. The estimator does not know of them, so they only add to the error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects.catalogue.fluorescence_bench import EFFECTS, FluorescenceWorld
from twin.errors import InputError
from twin.fluorescence import FluorescenceSetup, nominal_system
from twin.instrument import MultispectralChip
from twin.materials import reflectance
from twin.spectra import FloatArray
from twin.toml import near_misses

FINE = 20
"""Parts of a bin in which effects act."""
ROUNDS = 20


@dataclass(frozen=True, eq=False)
class CaptureErrors:
    """Errors of the captures of B materials at one prior scale each.

    Attributes:
        names: E effects, such as "illuminant_shift[violet]".
        value: in the flattened captures, (E, B, J K).
        positive: which of them have a sign, (E,).
    """

    names: tuple[str, ...]
    value: FloatArray
    positive: tuple[bool, ...]

    def drawn(self, draws: int, seed: int) -> FloatArray:
        """Errors drawn from the prior scales, (B, S, J K)."""
        count = len(self.names)
        random = np.random.Generator(np.random.Philox(key=[seed, 11]))
        size = random.standard_normal((self.value.shape[1], draws, count))
        size = np.where(np.array(self.positive, dtype=bool), np.abs(size), size)
        return np.asarray(np.einsum("bse,ebm->bsm", size, self.value))


def effect_names() -> tuple[str, ...]:
    """Effects of the fluorescence bench."""
    return tuple(each.name for each in EFFECTS)


def capture_errors(
    setup: FluorescenceSetup, matrices: FloatArray, scales: Mapping[str, float]
) -> CaptureErrors:
    """Signatures of the effects in the corrected captures.

    With one channel per bin the spectra of the lights are measured on the white: what is wrong with
    lights is harmless there and left out.

    Args:
        setup: the bench; emission and excitation on the same wavelengths.
        matrices: (B, W, W).
        scales: by effect, how many times its prior scale in the catalogue.

    Raises:
        InputError: an unknown effect, a negative scale, near-ultraviolet excitation.
    """
    known = {each.name: each for each in EFFECTS}
    for name, scale in scales.items():
        if name not in known:
            raise InputError(
                f"the effect {name!r}", f"one of {', '.join(known)}", place="errors",
                remedy=near_misses(name, list(known)),
            )  # fmt: skip
        if not scale >= 0.0:
            raise InputError(f"{scale:g} times its scale", "0 or more", place=f"errors.{name}")
    if not np.array_equal(setup.emission_nm, setup.excitation_nm):
        raise InputError(
            f"excitation from {setup.excitation_nm[0]:g} nm, emission from"
            f" {setup.emission_nm[0]:g} nm",
            "the same wavelengths where effects of parts are asked for", place="setup",
        )  # fmt: skip
    chip = isinstance(setup.detector, MultispectralChip)
    world, names, values, positive = _fine_world(setup), [], [], []
    nominal = nominal_system(setup)
    before = _binned(world)
    rho = reflectance(setup.white, setup.emission_nm)
    for name, scale in scales.items():
        effect = known[name]
        of_lights = name in ("illuminant_shift", "ultraviolet_leak", "filter_leak")
        if scale == 0.0 or (of_lights and not chip):
            continue
        owners = setup.illuminant_names if of_lights else setup.channel_names
        instances = [f"x {n + 1}" for n in range(len(owners))] if name != "cross_talk" else [""]
        parameter = effect.parameters[0]
        change = {each.name: each.nominal for each in effect.parameters}
        change[parameter.name] = parameter.nominal + scale * parameter.prior_scale
        for instance in instances:
            after = _binned(effect.change(world, change, instance))
            light = nominal.illuminants + after[0] - before[0]
            sight = nominal.sensitivities + after[1] - before[1]
            white = (light * rho) @ sight.T
            factor = _levels_and_gains(white, nominal.white(rho), chip)
            seen = np.einsum("ko,boi,ji->bjk", sight, matrices, light) / factor
            values.append((seen - nominal.captures(matrices)).reshape(len(matrices), -1))
            names.append(f"{name}[{owners[int(instance[2:]) - 1]}]" if instance else name)
            positive.append(parameter.sign == "positive")
    shape = (len(names), len(matrices), len(setup.lights) * len(setup.channel_names))
    return CaptureErrors(tuple(names), np.array(values).reshape(shape), tuple(positive))


def _fine_world(setup: FluorescenceSetup) -> FluorescenceWorld:
    grid = setup.emission_nm
    inside = (np.arange(FINE) + 0.5) / FINE - 0.5
    fine = (grid[:, None] + (grid[1] - grid[0]) * inside).reshape(-1)
    nominal = nominal_system(setup)
    light = np.array([each.spectrum(fine) for each in setup.lights])
    light *= nominal.illuminants.max() / light.reshape(len(light), -1, FINE).mean(axis=2).max()
    sight = np.array([np.interp(fine, grid, row) for row in nominal.sensitivities])
    return FluorescenceWorld(fine, light, sight)


def _binned(world: FluorescenceWorld) -> tuple[FloatArray, FloatArray]:
    """Illuminants (J, W) and sensitivities (K, W) in bins."""
    return tuple(
        np.asarray(rows.reshape(len(rows), -1, FINE).mean(axis=2))
        for rows in (world.illuminants, world.sensitivities)
    )  # type: ignore[return-value]


def _levels_and_gains(white: FloatArray, expected: FloatArray, gains: bool) -> FloatArray:
    """Factors (J, K) that calibration on the white finds: level of a light times gain of a channel.

    Alternating least squares with the weights of `twin.fluorescence.calibration`.
    """
    level, gain = np.ones(len(white)), np.ones(white.shape[1])
    weight = 1.0 / ((0.01 * expected) ** 2 + (1e-3 * expected.max()) ** 2)
    for _ in range(ROUNDS):
        shaped = gain * expected
        level = (weight * shaped * white).sum(axis=1) / (weight * shaped**2).sum(axis=1)
        if gains:
            model = level[:, None] * expected
            gain = (weight * model * white).sum(axis=0) / (weight * model**2).sum(axis=0)
            gain = gain / gain.mean()
    return level[:, None] * gain
