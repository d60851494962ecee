"""From a visit's raw counts to relative intensities with their covariance: pure functions.

The formulas are those of the bench (Iser et al. 2022, section 4.1):

    I_black = rho_w (S_black - D) / (W - D)        I_white likewise
    I_collimated = (S_collimated - D') / (B - D')

with every dark taken at the exposure of the reading it is subtracted from; readings at different
exposures are divided by integration time times gain first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.errors import InputError
from twin.measurement.model import (
    SAMPLE_CAPTURES,
    BoolArray,
    Measurement,
    RelativeSpectra,
    label,
)
from twin.measurement.noise import Group, groups_of, linearised, noise_of, without_stray_light
from twin.spectra import FloatArray, Spectral

SMALLEST_REFERENCE = 5.0
"""Standard errors by which a reference must exceed its dark: below, a ratio has no variance."""
POSSIBLE = (-0.2, 1.5)
"""Relative intensities outside of which a unit or a reference has been mistaken."""
BEYOND = 5.0
"""Standard errors by which they must be outside."""
REPEAT_WINDOW = 11
"""Neighbouring wavelengths whose scatter is pooled when repeats stand in for a sigma."""


@dataclass(frozen=True, eq=False)
class RelativeIntensities:
    """What estimators see.

    Attributes:
        sample_names: S names.
        thickness_mm: thickness [mm] of every sample, shape (S,).
        wavelength_nm: wavelengths [nm], shape (W,).
        value: relative intensities in the order black, white, collimated, shape (S, 3, W); NaN
            where not valid.
        covariance: between all samples and captures of one wavelength, shape (W, 3S, 3S), index
            3 * sample + capture; rows and columns that are not valid are NaN.
        valid: False where masked, shape (S, 3, W).
        reasons: what was masked, how much, and what was assumed.
        repeats: the smallest number of repeats of a capture.
        common: the part of the covariance that all wavelengths share, as modes: what one standard
            deviation of each (the lamps' level and tilt) does to the values, shape (K, W, 3S), 0
            where not valid. None: not known; `covariance` holds it all the same.
    """

    sample_names: tuple[str, ...]
    thickness_mm: FloatArray
    wavelength_nm: FloatArray
    value: FloatArray
    covariance: FloatArray
    valid: BoolArray
    reasons: tuple[str, ...]
    repeats: int
    common: FloatArray | None = None

    @property
    def sigma(self) -> FloatArray:
        """Standard errors, shape (S, 3, W)."""
        diagonal = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.sqrt(diagonal).T.reshape(self.value.shape)


@dataclass(frozen=True, eq=False)
class BlackReflectance:
    """The reflectance of the black background as the visit measured it.

    Attributes:
        wavelength_nm: wavelengths [nm], shape (W,).
        value: reflectance, mean over the black references, shape (W,); NaN where not valid.
        sigma: its standard error, shape (W,).
        valid: False where masked, shape (W,).
        reasons: what was masked and assumed.
    """

    wavelength_nm: FloatArray
    value: FloatArray
    sigma: FloatArray
    valid: BoolArray
    reasons: tuple[str, ...]


def relative_intensities(
    measurement: Measurement, *, linearise: bool | None = None
) -> RelativeIntensities:
    """Relative intensities of all samples with propagated covariance.

    Shot and read noise, rounding and lamp drift are propagated to first order; a reference or
    dark that several values share makes them covary. A pixel that is saturated or no number in
    any repeat, whose reference is not clearly above the dark, or whose value no sample can have, is
    masked, flagged and counted.
    The light of a simulated visit has a standard error of its own, which is added.

    Args:
        measurement: the visit.
        linearise: undo the sensor's nonlinearity, as the bench's instrument describes it, before
            the dark is subtracted. None does so where the instrument is described; False takes
            counts as proportional to the light.

    Raises:
        InputError: a capture, reference or dark is missing; a white reference without light; a
            capture without a single usable pixel; relative intensities without uncertainty.
    """
    if measurement.relative is not None:
        value, covariance, reasons, repeats = _ready_made(measurement, measurement.relative)
        valid, common = np.isfinite(value), None
    else:
        visit = Visit(measurement, linearise)
        white = certified_white(measurement)
        pairs, scales = [], []
        for sample in measurement.samples:
            for capture in SAMPLE_CAPTURES:
                signal = visit.capture_of(capture, sample.name)
                kind = "beam_reference" if capture == "collimated" else "white_reference"
                pairs.append((signal, visit.reference(kind, signal, sample.name)))
                scales.append(np.ones_like(white) if capture == "collimated" else white)
        value, covariance, valid, reasons, common = visit.ratios(pairs, np.stack(scales))
        light_se = measurement.captures.light_se if measurement.captures is not None else None
        if light_se is not None:
            index = np.arange(len(pairs))
            own = light_se.reshape(len(pairs), -1).T
            covariance[:, index, index] += own**2
        repeats = min(len(visit.groups[signal].shots) for signal, _ in pairs)
    captures = [label(kind, own.name) for own in measurement.samples for kind in SAMPLE_CAPTURES]
    wrong, sentences = values_no_sample_has(captures, value, covariance)
    value, valid, reasons = np.where(wrong, np.nan, value), valid & ~wrong, (*reasons, *sentences)
    covariance[wrong.T[:, :, None] | wrong.T[:, None, :]] = np.nan
    if common is not None:
        common = np.where(wrong.T, 0.0, common)
    shape = (len(measurement.samples), len(SAMPLE_CAPTURES), measurement.wavelength_nm.size)
    return RelativeIntensities(
        sample_names=tuple(sample.name for sample in measurement.samples),
        thickness_mm=np.array([sample.thickness_mm for sample in measurement.samples]),
        wavelength_nm=measurement.wavelength_nm,
        value=value.reshape(shape),
        covariance=covariance,
        valid=valid.reshape(shape),
        reasons=(*measurement.provenance.notes, *reasons),
        repeats=repeats,
        common=common,
    )


def measured_black_reflectance(
    measurement: Measurement, *, linearise: bool | None = None
) -> BlackReflectance | None:
    """The black background's reflectance rho_w (K - D) / (W - D); None without such a capture.

    Several black references (one for each sample) are averaged; `linearise` as in
    `relative_intensities`.

    Raises:
        InputError: as `relative_intensities`.
    """
    if measurement.captures is None:
        return None
    visit = Visit(measurement, linearise)
    blacks = [i for i, group in enumerate(visit.groups) if group.capture == "black_reference"]
    if not blacks:
        return None
    pairs = [
        (black, visit.reference("white_reference", black, visit.groups[black].sample))
        for black in blacks
    ]
    white = certified_white(measurement)
    value, covariance, valid, reasons, _ = visit.ratios(pairs, np.stack([white] * len(pairs)))
    every = np.asarray(valid.all(axis=0))
    return BlackReflectance(
        wavelength_nm=measurement.wavelength_nm,
        value=np.where(every, value.mean(axis=0), np.nan),
        sigma=np.sqrt(covariance.sum(axis=(1, 2))) / len(pairs),
        valid=every,
        reasons=reasons,
    )


def certified_white(measurement: Measurement) -> FloatArray:
    """What the white background shows the detector on the visit's wavelengths, shape (W,).

    Its certified reflectance less the share of a described gloss, which goes past the detector.
    NaN at wavelengths that the certificate does not cover.

    Raises:
        InputError: it is unknown, or covers none of the wavelengths.
    """
    background = measurement.bench.background.white
    certificate: Spectral = background.reflectance
    lambertian = 1.0 - background.gloss
    wavelength = measurement.wavelength_nm
    from twin.materials import reflectance

    try:
        return np.asarray(reflectance(certificate, wavelength) * lambertian, dtype=np.float64)
    except InputError as whole:
        # Nothing is extrapolated; a few pixels beyond the table do not spoil the rest.
        result = np.full(wavelength.shape, np.nan)
        for index in range(wavelength.size):
            try:
                result[index] = (
                    reflectance(certificate, wavelength[index : index + 1])[0] * lambertian
                )
            except InputError:
                continue
        if not np.isfinite(result).any():
            raise whole.at(whole.file, "background.white.reflectance") from whole
        return result


class Visit:
    """The groups of a visit with the dark of each, and the noise of their means."""

    def __init__(
        self, measurement: Measurement, linearise: bool | None, *, apart: bool = False
    ) -> None:
        captures = measurement.captures
        if captures is None:
            raise InputError("relative intensities", "counts", place="captures")
        self.wavelengths = captures.wavelength_nm.size
        self.groups = groups_of(captures, apart=apart)
        for group in self.groups:
            _usable(group)
        borrowed: set[str] = set()
        self.dark = [self._dark(index, borrowed) for index in range(len(self.groups))]
        darks = np.stack([self.groups[index].mean for index in self.dark])
        self.noise = noise_of(measurement, self.groups, darks)
        described = measurement.provenance.noise == "instrument"
        if described if linearise is None else linearise:
            self.groups, self.noise = linearised(measurement, self.groups, self.noise)
        self.reasons = [*self.noise.reasons, *sorted(borrowed)]
        if described and measurement.bench.instrument.has("stray_light"):
            self.groups, reason = without_stray_light(measurement, self.groups, self.dark)
            self.reasons.append(reason)

    def capture_of(self, capture: str, sample: str) -> int:
        """The group of a sample's capture."""
        found = [i for i, g in enumerate(self.groups) if (g.capture, g.sample) == (capture, sample)]
        if not found:
            raise InputError(
                f"no capture {capture!r}",
                f"{', '.join(SAMPLE_CAPTURES)} of every sample",
                place=f"sample {sample!r}",
            )
        if len(found) > 1:
            times = ", ".join(f"{self.groups[i].integration_s:g} s" for i in found)
            raise InputError(
                f"{label(capture, sample)} at several exposures ({times})",
                "one integration time and gain for all repeats",
            )
        return found[0]

    @property
    def most_repeats(self) -> int:
        """One more than the largest number of a repeat of a sample's capture."""
        own = (group for group in self.groups if group.capture in SAMPLE_CAPTURES)
        return 1 + max((group.shots[0].repeat for group in own), default=-1)

    def repeat_of(self, capture: str, sample: str, repeat: int) -> int | None:
        """The group of one repeat of a sample's capture, where repeats are kept apart.

        Raises:
            InputError: there is no repeat at all, or the same one at several exposures.
        """
        own = [i for i, g in enumerate(self.groups) if (g.capture, g.sample) == (capture, sample)]
        if not own:
            self.capture_of(capture, sample)
        found = [i for i in own if self.groups[i].shots[0].repeat == repeat]
        if len(found) > 1:
            times = ", ".join(f"{self.groups[i].integration_s:g} s" for i in found)
            raise InputError(
                f"{label(capture, sample)} at several exposures ({times})",
                "one integration time and gain for all repeats",
            )
        return found[0] if found else None

    def reference(self, kind: str, signal: int, sample: str) -> int:
        """The reference for a group: the sample's own, else the visit's; of the nearest exposure.

        Raises:
            InputError: there is none.
        """
        wanted = self.groups[signal].shots[0].exposure
        for owner in (sample, ""):
            found = [i for i, g in enumerate(self.groups) if (g.capture, g.sample) == (kind, owner)]
            if found:
                return min(
                    found,
                    key=lambda i: abs(math.log(self.groups[i].shots[0].exposure / wanted)),
                )
        raise InputError(
            f"no {kind} for {self.groups[signal]}",
            f"a {kind} of sample {sample!r}, or one of the visit (without a sample)",
            place=f"sample {sample!r}",
        )

    def _dark(self, index: int, borrowed: set[str]) -> int:
        group = self.groups[index]
        if group.capture == "dark":
            return index
        darks = [i for i, g in enumerate(self.groups) if g.capture == "dark"]
        fitting = [
            i
            for i in darks
            if math.isclose(self.groups[i].integration_s, group.integration_s, rel_tol=1e-6)
            and math.isclose(self.groups[i].gain, group.gain, rel_tol=1e-6)
        ]
        for owner in (group.sample, ""):
            for candidate in fitting:
                if self.groups[candidate].sample == owner:
                    return candidate
        if fitting:
            borrowed.add(f"{group} uses the {self.groups[fitting[0]]}")
            return fitting[0]
        there = ", ".join(sorted({_setting(self.groups[i]) for i in darks})) or "no dark at all"
        raise InputError(
            f"no dark for {group} ({_setting(group)}); there is {there}",
            "a dark of the same integration time and gain",
        )

    def ratios(
        self, pairs: list[tuple[int, int]], scale: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, tuple[str, ...], FloatArray]:
        """Values scale * (S - D) / (W - D) of M pairs of groups, shape (M, W).

        Returns:
            Values (M, W), covariance (W, M, M), valid (M, W), reasons, modes that all
            wavelengths share (K, W, M).
        """
        groups, noise = self.groups, self.noise
        size = len(pairs)
        value = np.full((size, self.wavelengths), np.nan)
        valid = np.zeros(value.shape, dtype=bool)
        jacobian = np.zeros((self.wavelengths, size, len(groups)))
        masked: dict[str, int] = {}
        for row, (top, bottom) in enumerate(pairs):
            parts = (top, self.dark[top], bottom, self.dark[bottom])
            good = np.isfinite(scale[row])
            if not good.all():
                key = "certified reflectance of the white not known"
                masked[key] = int((~good).sum())
            for part in dict.fromkeys(parts):
                self._count(masked, part)
                good &= groups[part].valid & np.isfinite(noise.variance[part])
            signal = groups[top].mean - groups[parts[1]].mean
            reference = groups[bottom].mean - groups[parts[3]].mean
            spread = np.sqrt(noise.variance[bottom] + noise.variance[parts[3]])
            # A dark pixel is one to mask, a reference without any light a mistake to report.
            weak = ~(reference > SMALLEST_REFERENCE * spread)
            if np.all(weak | ~groups[bottom].valid):
                _no_light(groups[bottom], reference)
            if np.any(weak & good):
                key = f"{groups[bottom]} not clearly above the dark"
                masked[key] = int((weak & good).sum())
            good &= ~weak
            exposure = groups[bottom].shots[0].exposure / groups[top].shots[0].exposure
            factor = np.where(good, scale[row], 0.0) * exposure
            safe = np.where(good, reference, 1.0)
            value[row] = np.where(good, factor * signal / safe, np.nan)
            valid[row] = good
            by_signal, by_reference = factor / safe, -factor * signal / safe**2
            derivatives = (by_signal, -by_signal, by_reference, -by_reference)
            for part, derivative in zip(parts, derivatives, strict=True):
                jacobian[:, row, part] += derivative  # a dark may serve both
        if not valid.any():
            raise InputError("no usable pixel", "one or more", place="captures")
        covariance, common = self._propagate(jacobian)
        hidden = ~valid.T
        covariance[hidden[:, :, None] | hidden[:, None, :]] = np.nan
        total = self.wavelengths
        counted = [f"{count} of {total} pixels masked: {key}" for key, count in masked.items()]
        common = np.where(hidden, 0.0, common)
        return value, covariance, valid, (*self.reasons, *counted), common

    def _propagate(self, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariance (W, M, M) and the modes of it that all wavelengths share (K, W, M)."""
        noise = self.noise
        variance = np.where(np.isfinite(noise.variance), noise.variance, 0.0).T
        covariance = (jacobian * variance[:, None, :]) @ jacobian.transpose(0, 2, 1)
        dark = np.stack([self.groups[index].mean for index in self.dark])
        light = np.stack([group.mean for group in self.groups]) - dark
        moved = jacobian * light.T[:, None, :]
        lamp = noise.lamp_level + noise.tilt[:, None, None] ** 2 * noise.lamp_tilt
        covariance += moved @ lamp @ moved.transpose(0, 2, 1)
        level = np.moveaxis(moved @ _modes(noise.lamp_level), -1, 0)
        tilt = np.moveaxis(moved @ _modes(noise.lamp_tilt), -1, 0) * noise.tilt[:, None]
        common = np.concatenate([level, tilt])
        return np.asarray(0.5 * (covariance + covariance.transpose(0, 2, 1))), common

    def _count(self, masked: dict[str, int], part: int) -> None:
        group = self.groups[part]
        for bad, why in ((group.saturated, "saturated"), (~group.finite, "not a number")):
            if bad.any():
                masked[f"{group} {why}"] = int(bad.sum())


def _modes(covariance: FloatArray) -> FloatArray:
    """Columns whose outer products add up to a covariance (G, G), shape (G, K), K up to G."""
    value, vector = np.linalg.eigh(covariance)
    kept = value > 1e-12 * max(float(value.max()), 0.0)
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]))


def _setting(group: Group) -> str:
    gain = f" at gain {group.gain:g}" if group.gain != 1 else ""
    return f"{group.integration_s:g} s{gain}"


def _usable(group: Group) -> None:
    if group.valid.any():
        return
    if group.saturated.all():
        raise InputError(
            f"{group} saturated at every wavelength",
            "counts below full scale",
            remedy="Capture it again with a shorter integration time.",
        )
    raise InputError(f"{group} without a usable pixel", "counts below full scale")


def _no_light(group: Group, reference: FloatArray) -> None:
    if not np.any(group.mean):
        raise InputError(f"{group} that is zero at every wavelength", "light in the reference")
    raise InputError(
        f"{group} not clearly above its dark at any wavelength (at most"
        f" {np.max(reference):.3g} counts)",
        "light in the reference",
    )


def _ready_made(
    measurement: Measurement, relative: RelativeSpectra
) -> tuple[FloatArray, FloatArray, tuple[str, ...], int]:
    values, variances, reasons, repeats = [], [], [], []
    for sample in measurement.samples:
        own = [i for i, row in enumerate(relative.rows) if row.sample == sample.name]
        if own and not np.any(relative.value[own]):
            raise InputError(
                f"relative intensities of {sample.name!r} that are zero at every wavelength",
                "light over the white background at least",
                place=f"sample {sample.name!r}",
                remedy="Divide the captures by the white reference, not by the dark.",
            )
        for capture in SAMPLE_CAPTURES:
            chosen = [
                i
                for i, row in enumerate(relative.rows)
                if (row.sample, row.capture) == (sample.name, capture)
            ]
            if not chosen:
                raise InputError(
                    f"no capture {capture!r}",
                    f"{', '.join(SAMPLE_CAPTURES)} of every sample",
                    place=f"sample {sample.name!r}",
                )
            name = label(capture, sample.name)
            value, sigma = relative.value[chosen], relative.sigma[chosen]
            mean = value.mean(axis=0)
            missing = int(np.isnan(mean).sum())
            if missing:
                reasons.append(f"{missing} of {mean.size} pixels masked: {name} not a number")
            if missing == mean.size:
                raise InputError(f"{name} without a usable pixel", "numbers")
            variance = np.sum(sigma**2, axis=0) / len(chosen) ** 2
            unknown = np.isnan(variance) & ~np.isnan(mean)
            if unknown.any():
                scatter = pooled_scatter(value, name)
                variance = np.where(unknown, scatter / len(chosen), variance)
                reasons.append(f"sigma of {name} from the scatter of {len(chosen)} repeats")
            values.append(mean)
            variances.append(np.where(np.isnan(mean), np.nan, variance))
            repeats.append(len(chosen))
    stacked = np.stack(variances)
    covariance = np.zeros((stacked.shape[1], len(values), len(values)))
    index = np.arange(len(values))
    covariance[:, index, index] = stacked.T
    hidden = np.isnan(stacked.T)
    covariance[hidden[:, :, None] | hidden[:, None, :]] = np.nan
    return np.stack(values), covariance, tuple(reasons), min(repeats)


def values_no_sample_has(
    captures: Sequence[str], value: FloatArray, covariance: FloatArray
) -> tuple[BoolArray, tuple[str, ...]]:
    """Values (M, W) that no sample has, whatever the noise, and a sentence for each spectrum."""
    low, high = POSSIBLE
    noise = BEYOND * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).T
    with np.errstate(invalid="ignore"):
        wrong = np.asarray((value < low - noise) | (value > high + noise))
    return wrong, tuple(
        f"{bad.sum()} of {bad.size} pixels masked: {name} outside {low:g} to {high:g}"
        f" ({row[bad].min():.3g} to {row[bad].max():.3g}), which no sample has;"
        " check the unit (0.45, not 45 %) and the reference"
        for name, row, bad in zip(captures, value, wrong, strict=True)
        if bad.any()
    )


def pooled_scatter(value: FloatArray, name: str) -> FloatArray:
    """Variance between repeats, mean over neighbouring wavelengths, shape (W,)."""
    if len(value) < 2:
        raise InputError(
            f"{name} without sigma and without repeats",
            "a sigma above 0 for every value, or two repeats or more",
            place="sigma",
        )
    scatter = value.var(axis=0, ddof=1)
    known = ~np.isnan(scatter)
    window = np.ones(REPEAT_WINDOW)
    total = np.convolve(np.where(known, scatter, 0.0), window)
    number = np.convolve(known.astype(float), window)
    # The full convolution, cut to the middle: "same" would take the longer of the two lengths.
    start = REPEAT_WINDOW // 2
    span = slice(start, start + scatter.size)
    pooled = np.asarray(total[span] / np.maximum(number[span], 1.0))
    if not np.all(pooled[known] > 0):
        raise InputError(
            f"repeats of {name} that are identical",
            "a sigma above 0 for every value, or repeats with noise",
            place="sigma",
        )
    return pooled
