"""What the counts of a visit scatter by: from the described instrument, or from repeats."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.bench import Bench
from twin.errors import InputError
from twin.instrument import MultispectralChip, Spectrometer, count_variance, electrons_of_counts
from twin.measurement.model import (
    SAMPLE_CAPTURES,
    BoolArray,
    Captures,
    Measurement,
    Shot,
    label,
)
from twin.spectra import FloatArray

PANEL_CAPTURES = ("white_reference", "black_reference", "black", "white")
BEAM_CAPTURES = ("beam_reference", "collimated")

FIT_STEPS = 300
"""Steps of the photon-transfer fit; it settles to three digits within a hundred."""


@dataclass(frozen=True, eq=False)
class Group:
    """The repeats of one capture of one sample at one exposure, averaged.

    Attributes:
        shots: their settings, R of them.
        indices: their positions in the visit's table.
        mean: mean counts, shape (W,).
        saturated: True where any repeat is saturated, shape (W,).
        finite: True where every repeat has a number, shape (W,).
        scatter: variance between the repeats [counts^2], shape (W,); None for a single shot.
    """

    shots: tuple[Shot, ...]
    indices: tuple[int, ...]
    mean: FloatArray
    saturated: BoolArray
    finite: BoolArray
    scatter: FloatArray | None

    @property
    def capture(self) -> str:
        """What was captured."""
        return self.shots[0].capture

    @property
    def sample(self) -> str:
        """Name of the sample, or ""."""
        return self.shots[0].sample

    @property
    def integration_s(self) -> float:
        """Integration time [s]."""
        return self.shots[0].integration_s

    @property
    def gain(self) -> float:
        """Amplification."""
        return self.shots[0].gain

    @property
    def valid(self) -> BoolArray:
        """Usable pixels: masked as soon as one repeat is, else the mean of the rest is biased."""
        return self.finite & ~self.saturated

    def __str__(self) -> str:
        return label(self.capture, self.sample)


def groups_of(captures: Captures, *, apart: bool = False) -> tuple[Group, ...]:
    """The shots by capture, sample and exposure, in the order of their first shot.

    Args:
        captures: raw counts.
        apart: keep the repeats of a sample's captures apart; those of references and darks are
            one group all the same.
    """
    members: dict[tuple[str, str, float, float, int], list[int]] = {}
    for index, shot in enumerate(captures.shots):
        repeat = shot.repeat if apart and shot.capture in SAMPLE_CAPTURES else -1
        key = (shot.capture, shot.sample, shot.integration_s, shot.gain, repeat)
        members.setdefault(key, []).append(index)
    groups = []
    for indices in members.values():
        counts = captures.counts[indices]
        finite = np.asarray(np.isfinite(counts).all(axis=0))
        known = np.where(finite, counts, 0.0)
        groups.append(
            Group(
                shots=tuple(captures.shots[index] for index in indices),
                indices=tuple(indices),
                mean=known.mean(axis=0),
                saturated=np.asarray(captures.saturated[indices].any(axis=0)),
                finite=finite,
                scatter=known.var(axis=0, ddof=1) if len(indices) > 1 else None,
            )
        )
    return tuple(groups)


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance of the means of G groups.

    Attributes:
        variance: independent noise [counts^2] of every mean, shape (G, W).
        lamp_level: relative covariance of the lamps' level between groups, shape (G, G).
        lamp_tilt: the same for the tilt, shape (G, G).
        tilt: shape of the tilt over wavelength, -1 to 1, shape (W,).
        reasons: where it comes from.
    """

    variance: FloatArray
    lamp_level: FloatArray
    lamp_tilt: FloatArray
    tilt: FloatArray
    reasons: tuple[str, ...]


def noise_of(measurement: Measurement, groups: tuple[Group, ...], darks: FloatArray) -> Noise:
    """Noise of the means of all groups.

    Args:
        measurement: with captures; its provenance says what to take the noise from.
        groups: G of them, from `groups_of`.
        darks: the dark counts that belong to each group, shape (G, W).

    Raises:
        InputError: repeats that are all identical while nobody described the instrument.
    """
    repeated = any(group.scatter is not None for group in groups)
    if measurement.provenance.noise == "repeats" and repeated:
        return _from_repeats(measurement, groups, darks)
    return _from_instrument(measurement, groups, darks)


def linearised(
    measurement: Measurement, groups: tuple[Group, ...], noise: Noise
) -> tuple[tuple[Group, ...], Noise]:
    """Groups and noise in counts that are proportional to the charge.

    The described curve is inverted (`twin.instrument.electrons_of_counts`) and the variance
    follows its slope; a reading that no charge gives becomes no number.
    """
    bench = measurement.bench
    curve = bench.instrument.nonlinearity if bench.instrument.has("nonlinearity") else 0.0
    variance = noise.variance.copy()
    straight = []
    for index, group in enumerate(groups):
        instrument = instrument_at(bench, group.gain)
        charge = electrons_of_counts(instrument, group.mean)
        slope = 1.0 + 2.0 * curve * charge / instrument.full_well_electrons
        possible = np.isfinite(charge) & (slope > 0)
        counts = instrument.dark_level_counts + charge / instrument.electrons_per_count
        variance[index] /= np.where(possible, slope, 1.0) ** 2
        straight.append(
            replace(group, mean=np.where(possible, counts, 0.0), finite=group.finite & possible)
        )
    reason = f"counts linearised with the described nonlinearity of {curve:g} at full well"
    return tuple(straight), replace(noise, variance=variance, reasons=(*noise.reasons, reason))


def without_stray_light(
    measurement: Measurement, groups: tuple[Group, ...], dark: list[int]
) -> tuple[tuple[Group, ...], str]:
    """Groups without the stray light that the bench's instrument describes, and what was done.

    The sensor adds a share f of the mean light to every pixel and takes it from the pixel's own:
    the mean itself is unchanged, so f times it is subtracted. The common factor 1 - f is left,
    as it cancels from every ratio.

    Args:
        measurement: says f.
        groups: G of them, in counts proportional to the light.
        dark: index of the dark of each.
    """
    instrument = measurement.bench.instrument
    share = instrument.stray_light_fraction if instrument.has("stray_light") else 0.0
    clean = []
    for group, own in zip(groups, dark, strict=True):
        lit = group.finite & groups[own].finite
        light = np.mean((group.mean - groups[own].mean)[lit]) if lit.any() else 0.0
        clean.append(replace(group, mean=group.mean - share * light))
    return tuple(clean), f"described stray light of {share:g} of the mean light subtracted"


def _from_instrument(
    measurement: Measurement, groups: tuple[Group, ...], darks: FloatArray
) -> Noise:
    bench = measurement.bench
    variance = np.empty_like(darks)
    for index, group in enumerate(groups):
        parts = [
            count_variance(instrument_at(bench, s.gain), group.mean, darks[index], s.averages)
            for s in group.shots
        ]
        variance[index] = np.sum(parts, axis=0) / len(parts) ** 2
    level, tilt = _lamp(measurement, groups)
    reasons = [f"noise of counts from the description of the {bench.instrument.kind}"]
    if measurement.provenance.noise == "repeats":
        reasons = [
            f"noise of counts from the default {bench.instrument.kind}: the bench describes no"
            " instrument and nothing was repeated"
        ]
    elif ratio := _excess(groups, darks, bench):
        reasons.append(ratio)
    return Noise(variance, level, tilt, _tilt(measurement.wavelength_nm), tuple(reasons))


def instrument_at(bench: Bench, gain: float) -> Spectrometer | MultispectralChip:
    """The instrument as it was set for a shot: a chip's conversion follows the gain."""
    instrument = bench.instrument
    if isinstance(instrument, MultispectralChip) and gain != instrument.gain:
        return instrument.model_copy(update={"gain": gain})
    return instrument


def _excess(groups: tuple[Group, ...], darks: FloatArray, bench: Bench) -> str:
    """A warning when repeats scatter more than the description says, or ""."""
    ratios: list[FloatArray] = []
    for group, dark in zip(groups, darks, strict=True):
        if group.scatter is None or not group.valid.any():
            continue
        expected = count_variance(
            instrument_at(bench, group.gain), group.mean, dark, group.shots[0].averages
        )
        expected = expected + _flicker(bench, len(group.shots)) * (group.mean - dark) ** 2
        use = group.valid & (expected > 0)
        ratios.append(group.scatter[use] / expected[use])
    together = np.concatenate(ratios) if ratios else np.empty(0)
    if not together.size:
        return ""
    ratio = float(np.sqrt(np.mean(together)))
    if ratio < 2.0:
        return ""
    return f"repeats scatter {ratio:.1f} times as much as the described instrument should"


def _flicker(bench: Bench, repeats: int) -> float:
    """Relative variance between consecutive shots that the lamp's description allows for."""
    instrument = bench.instrument
    if not instrument.has("lamp_drift"):
        return 0.0
    return instrument.lamp_flicker**2 + repeats * instrument.lamp_walk**2


def _lamp(measurement: Measurement, groups: tuple[Group, ...]) -> tuple[FloatArray, FloatArray]:
    """Relative covariance of level and tilt between groups; see `twin.instrument.lamp_covariance`.

    Panels and beam are two lamps. The walk goes on during darks, so every shot counts.
    """
    instrument = measurement.bench.instrument
    size = len(groups)
    captures = measurement.captures
    if captures is None or not instrument.has("lamp_drift"):
        return np.zeros((size, size)), np.zeros((size, size))
    times = [shot.time_s for shot in captures.shots]
    order = np.empty(len(times))
    order[np.argsort(times, kind="stable")] = np.arange(len(times))
    mean = np.zeros((size, len(times)))
    for index, group in enumerate(groups):
        mean[index, list(group.indices)] = 1.0 / len(group.indices)
    walk = mean @ np.minimum(order[:, None], order[None, :]) @ mean.T
    lamps = np.array([_lamp_number(group.capture) for group in groups])
    same = (lamps[:, None] == lamps[None, :]) & (lamps[:, None] >= 0)
    level = instrument.lamp_walk**2 * walk + instrument.lamp_flicker**2 * (mean @ mean.T)
    return np.where(same, level, 0.0), np.where(same, instrument.lamp_tilt_walk**2 * walk, 0.0)


def _lamp_number(capture: str) -> int:
    return 0 if capture in PANEL_CAPTURES else 1 if capture in BEAM_CAPTURES else -1


def _tilt(wavelength_nm: FloatArray) -> FloatArray:
    if wavelength_nm.size == 1:
        return np.zeros(1)
    span = wavelength_nm[-1] - wavelength_nm[0]
    return np.asarray(2.0 * (wavelength_nm - wavelength_nm[0]) / span - 1.0)


def _from_repeats(measurement: Measurement, groups: tuple[Group, ...], darks: FloatArray) -> Noise:
    """Photon transfer fitted to the scatter of repeats: (a + b signal) / averages + c signal^2.

    Read noise, shot noise and flicker (Janesick 2007, "Photon Transfer", chapter 3), with three
    coefficients of at least 0 for the whole visit: a pixel's own scatter over a few repeats is
    far too uncertain to weigh its data with.
    """
    rows, scatter = [], []
    for group, dark in zip(groups, darks, strict=True):
        if group.scatter is not None:
            use = group.valid
            rows.append(_terms(group, dark)[use])
            scatter.append(np.stack([group.scatter[use], np.full(use.sum(), len(group.shots) - 1)]))
    design = np.concatenate(rows)
    found, freedom = np.concatenate(scatter, axis=1)
    if not np.any(found > 0):
        raise InputError(
            "repeats that are all identical",
            "readings with noise",
            place="captures",
            remedy="Describe the instrument in bench.toml ([instrument]), or repeat the captures.",
        )
    # Maximum likelihood for variances estimated with few degrees of freedom (they are gamma
    # distributed) by multiplicative updates, which keep coefficients positive and never lower the
    # likelihood (Fevotte and Idier 2011, "Algorithms for nonnegative matrix factorization with
    # the beta-divergence", beta = 0). Least squares would need weights it does not know yet.
    coefficients = found.mean() / np.maximum(design.mean(axis=0), 1e-300) / design.shape[1]
    for _ in range(FIT_STEPS):
        # readings of exactly 0 counts let a coefficient die; their variance stays above 0
        expected = np.maximum(design @ coefficients, 1e-9 * found.mean())
        up = design.T @ (freedom * found / expected**2)
        down = design.T @ (freedom / expected)
        coefficients = coefficients * np.sqrt(up / np.maximum(down, 1e-300))
    variance = np.stack(
        [
            _terms(group, dark) @ coefficients / len(group.shots)
            for group, dark in zip(groups, darks, strict=True)
        ]
    )
    zero = np.zeros((len(groups), len(groups)))
    reason = (
        "noise of counts from the scatter of repeats (the bench describes no instrument):"
        f" {coefficients[0]:.3g} + {coefficients[1]:.3g} signal per exposure,"
        f" + {coefficients[2]:.3g} signal^2"
    )
    return Noise(variance, zero, zero, _tilt(measurement.wavelength_nm), (reason,))


def _terms(group: Group, dark: FloatArray) -> FloatArray:
    signal = np.maximum(group.mean - dark, 0.0)
    averages = float(np.mean([shot.averages for shot in group.shots]))
    return np.stack(
        [np.full_like(signal, 1.0 / averages), group.gain * signal / averages, signal**2], axis=1
    )
