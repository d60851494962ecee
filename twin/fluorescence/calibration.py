"""What the white says: the light of every illuminant, the gains of channels, and mistakes.

A detector with one channel per bin measures each illuminant itself. A chip with a few channels
cannot: there the shape of each spectrum is the nominal one, and the white gives its level and the
gains of the channels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import InputError
from twin.fluorescence.readings import Signals
from twin.fluorescence.setup import FluorescenceSetup, nominal_system
from twin.fluorescence.system import FluorescenceSystem
from twin.materials import reflectance
from twin.spectra import FloatArray

SMALLEST_WHITE = 5.0
"""A white counts as seen when its brightest channel is so many standard errors above the dark."""
WHITE_FLUORESCENCE = 0.01
"""Share of the white's light at wavelengths where the illuminant has none: more is fluorescence."""
FOREIGN = 1e-3
"""An illuminant below this share of its peak has no light there."""
LIKELY_GAIN = (0.2, 5.0)
"""Gains of channels that a white can say; outside them the description is wrong."""
SWAPPED_GAIN = 0.05
"""How much better (mean cosine of what moves) another order has to fit to be called right."""


@dataclass(frozen=True)
class Calibration:
    """The calibrated system and how well it is known.

    Attributes:
        system: illuminants with a common peak of 1, sensitivities.
        scale: signal [electrons/s] that the value 1 of a capture stands for.
        modes: relative errors of the captures that white and drifting lamps cause through levels
            and gains, one standard deviation each, (C, J, K).
        resolved: whether each illuminant's spectrum was measured, not only its level.
        reasons: what was assumed.
    """

    system: FluorescenceSystem
    scale: float
    modes: FloatArray
    resolved: bool
    reasons: tuple[str, ...]


def calibrate(setup: FluorescenceSetup, found: Signals) -> Calibration:
    """Illuminants and sensitivities from the white.

    Raises:
        InputError: an illuminant that no channel sees on the white, channels or illuminants in
            another order than described, a white that fluoresces.
    """
    nominal = nominal_system(setup)
    rho = reflectance(setup.white, setup.emission_nm)
    expected = nominal.white(rho)
    _check_overlap(setup, nominal, expected)
    noise = np.sqrt(found.white_variance)
    seen = np.where(found.valid, found.white - SMALLEST_WHITE * noise, -np.inf).max(axis=1) > 0.0
    if not seen.all():
        which = setup.illuminant_names[int(np.argmin(seen))]
        raise InputError(
            f"a white that no channel sees under {which!r}",
            "a white clearly above the dark under every illuminant",
            place="white", remedy="Is the light on, and do its wavelengths meet the detector's?",
        )  # fmt: skip
    check_order(setup, np.where(found.valid, found.white, 0.0), expected)
    response = nominal.sensitivities
    resolved = response.shape[0] == response.shape[1] and np.allclose(
        response, np.diag(np.diag(response))
    )
    level, gain = _levels(found, expected, () if resolved else setup.channel_names)
    check_white(setup, nominal, found, level[:, None] * gain[None, :] * expected)
    reasons: list[str] = []
    if resolved:
        light, reason = _measured_light(setup, nominal, found, rho, level)
        reasons += reason
        modes = found.drift[:, 0] - found.drift[:, 1]
    else:
        light = level[:, None] * nominal.illuminants
        modes = _error_modes(found, level[:, None] * gain * expected)
        response = response * gain[:, None]
        reasons.append(
            "the spectra of the illuminants are the nominal ones: the white gave their levels and"
            f" the gains of the channels ({gain.min():.3f} to {gain.max():.3f})"
        )
    scale = float(light.max())
    system = FluorescenceSystem(
        light / scale, response, setup.emission_nm, setup.excitation_nm,
        setup.illuminant_names, setup.channel_names,
    )  # fmt: skip
    return Calibration(system, scale, modes, resolved, tuple(reasons))


def _check_overlap(
    setup: FluorescenceSetup, nominal: FluorescenceSystem, expected: FloatArray
) -> None:
    dark = expected.max(axis=1) <= 1e-6 * expected.max()
    if dark.any():
        which = int(np.argmax(dark))
        light = nominal.illuminants[which]
        peak = setup.excitation_nm[int(np.argmax(light))]
        raise InputError(
            f"the illuminant {setup.illuminant_names[which]!r} (peak at {peak:g} nm) that no"
            " channel of the detector sees", "illuminants and a detector that overlap",
            place="lights", remedy="Its level cannot be calibrated on a white: leave it out.",
        )  # fmt: skip


def check_order(setup: FluorescenceSetup, white: FloatArray, expected: FloatArray) -> None:
    """Compare what the white shows with what the description expects, (J, K) each.

    Each channel's pattern over the illuminants, and each illuminant's over the channels, is
    compared by its cosine with every expected one. An assignment that fits much better than the
    given order is a mistake in the order.

    Raises:
        InputError: the order of channels or illuminants is wrong.
    """
    from scipy.optimize import linear_sum_assignment

    for what, names, seen, wanted in (
        ("channel", setup.channel_names, white.T, expected.T),
        ("illuminant", setup.illuminant_names, white, expected),
    ):
        if len(names) < 2 or seen.shape[1] < 2:
            continue
        likeness = _unit(seen) @ _unit(wanted).T
        _, best = linear_sum_assignment(-likeness)
        order = np.arange(len(names))
        changed = best != order
        if not changed.any():
            continue
        own = float(np.diag(likeness)[changed].mean())
        other = float(likeness[order, best][changed].mean())
        if other - own > SWAPPED_GAIN:
            moved = [f"{names[a]} looks like {names[b]}" for a, b in enumerate(best) if a != b]
            raise InputError(
                f"{what}s in another order than described ({'; '.join(moved[:3])})",
                f"the {what}s in the order {', '.join(names[:3])} ...", place=f"{what}s",
                remedy=f"On the white their order given fits with {own:.2f}, another with"
                f" {other:.2f} (cosine).",
            )  # fmt: skip


def check_white(
    setup: FluorescenceSetup, nominal: FluorescenceSystem, found: Signals, model: FloatArray
) -> None:
    """Look for light of the white where its illuminant has none: fluorescence of the white.

    Only channels well towards long wavelengths, of illuminants that have no light in what the
    channel sees directly; what is in excess of the modelled cross-talk counts.

    Raises:
        InputError: more than 1 % of the white's light, clearly above the noise.
    """
    # Where each channel mainly looks: at bins above a tenth of its peak.
    sight = nominal.sensitivities
    looks = sight > 0.1 * sight.max(axis=1, keepdims=True) + np.median(sight, axis=1, keepdims=True)
    common = [int(np.argmin(np.abs(setup.excitation_nm - w))) for w in setup.emission_nm]
    light = nominal.illuminants[:, common]
    lit = light > FOREIGN * light.max(axis=1, keepdims=True)
    for row, name in enumerate(setup.illuminant_names):
        direct = (looks & lit[row]).any(axis=1)
        last = int(np.flatnonzero(lit[row]).max()) if lit[row].any() else 0
        centre = (looks * setup.emission_nm).sum(axis=1) / np.maximum(looks.sum(axis=1), 1)
        foreign = ~direct & (centre > setup.emission_nm[last]) & found.valid[row]
        if not foreign.any():
            continue
        excess = (found.white[row] - model[row])[foreign]
        noise = float(np.sqrt(found.white_variance[row][foreign].sum()))
        total = float(np.nansum(found.white[row]))
        if excess.sum() > WHITE_FLUORESCENCE * total and excess.sum() > 5.0 * noise:
            raise InputError(
                f"a white that gives {100 * excess.sum() / total:.1f} % of its light under"
                f" {name!r} at longer wavelengths than the illuminant has",
                "a white without fluorescence", place="white",
                remedy="Use sintered PTFE or barium sulphate; paper and paint are often"
                " brightened.",
            )  # fmt: skip


def _levels(
    found: Signals, expected: FloatArray, names: tuple[str, ...]
) -> tuple[FloatArray, FloatArray]:
    """Levels (J,) and gains (K,), mean 1, of white_jk = level_j gain_k expected_jk.

    Alternating weighted least squares; each channel is weighed by its noise plus 1 % of the
    expected light, so that small errors of nominal spectra do not decide.

    Args:
        found: signals of the white.
        expected: those of the nominal system, (J, K).
        names: names of the channels, or () to leave their gains at 1.

    Raises:
        InputError: a gain outside 0.2 to 5.
    """
    white = np.where(found.valid, found.white, 0.0)
    variance = np.where(found.valid, found.white_variance, 0.0)
    level = white.sum(axis=1) / np.maximum((expected * found.valid).sum(axis=1), 1e-300)
    gain = np.ones(white.shape[1])
    for _ in range(20):
        model = level[:, None] * expected
        weight = np.where(found.valid, _weight(variance, model), 0.0)
        below = (weight * model**2).sum(axis=0)
        above = (weight * model * white).sum(axis=0)
        if names:
            gain = np.where(below > 0.0, above / np.where(below > 0.0, below, 1.0), 1.0)
            gain /= gain.mean()
        shaped = gain * expected
        level = (weight * shaped * white).sum(axis=1) / (weight * shaped**2).sum(axis=1)
    low, high = LIKELY_GAIN
    odd = ~((gain > low) & (gain < high))
    if odd.any():
        which = int(np.argmax(odd))
        raise InputError(
            f"a white that says channel {names[which]} is {gain[which]:.2g} times as sensitive as"
            " described", f"{low:g} to {high:g} times", place="detector",
            remedy="Is it this detector, are these the illuminants, is the order right?",
        )  # fmt: skip
    return level, gain


def _weight(variance: FloatArray, model: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (variance + (0.01 * model) ** 2 + (1e-3 * model.max()) ** 2))


def _error_modes(found: Signals, model: FloatArray) -> FloatArray:
    """Relative errors of captures through lamps, levels and gains, as modes, (C, J, K).

    The noise of the white, and the lamps' drift while it was captured, go through the weighted fit
    of `_levels`; the mean of the gains is fixed. A drift that white and sample share cancels.
    """
    rows, columns = model.shape
    variance = np.where(found.valid, found.white_variance, 0.0).reshape(-1)
    weight = np.where(found.valid, _weight(variance.reshape(model.shape), model), 0.0).reshape(-1)
    design = np.zeros((rows, columns, rows + columns))
    design[np.arange(rows), :, np.arange(rows)] = 1.0
    design[:, np.arange(columns), rows + np.arange(columns)] = 1.0
    basis = design.reshape(-1, rows + columns)
    scaled = basis * model.reshape(-1, 1)
    solve = np.linalg.pinv(scaled.T @ (weight[:, None] * scaled)) @ (weight[:, None] * scaled).T
    size, vectors = np.linalg.eigh((solve * variance) @ solve.T)
    good = size > 1e-6 * size.max()
    by_noise = (basis @ (vectors[:, good] * np.sqrt(size[good]))).T
    white_drift = found.drift[:, 1].reshape(len(found.drift), -1) * model.reshape(-1)
    by_drift = found.drift[:, 0].reshape(len(found.drift), -1) - white_drift @ (basis @ solve).T
    return np.concatenate([by_noise, by_drift]).reshape(-1, rows, columns)


def _measured_light(
    setup: FluorescenceSetup,
    nominal: FluorescenceSystem,
    found: Signals,
    rho: FloatArray,
    level: FloatArray,
) -> tuple[FloatArray, list[str]]:
    """Energy of every illuminant in every excitation bin, (J, Wi), in signal of the detector."""
    response = np.diag(nominal.sensitivities)
    seen = found.white / (rho * response)
    light = level[:, None] * nominal.illuminants
    position = {round(float(w), 6): k for k, w in enumerate(setup.emission_nm)}
    inside = 0
    assumed = 0
    for column, wavelength in enumerate(setup.excitation_nm):
        channel = position.get(round(float(wavelength), 6))
        if channel is None:
            continue
        inside += 1
        good = np.isfinite(seen[:, channel])
        assumed += int((~good).sum())
        light[good, column] = seen[good, channel]
    reasons = []
    negative = int((light < 0.0).sum())
    if negative:
        reasons.append(
            f"{negative} bins of the measured illuminants are below 0 by noise"
            f" (least {light.min() / light.max():.1e} of the peak) and left so"
        )
    if assumed:
        reasons.append(f"{assumed} masked bins of the illuminants have their nominal light")
    if inside < setup.excitation_nm.size:
        reasons.append(
            f"{setup.excitation_nm.size - inside} excitation bins that the detector does not see"
            " have the nominal light of each illuminant"
        )
    return light, reasons


def _unit(rows: FloatArray) -> FloatArray:
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300))
