"""All repeats of a visit as one vector of data with its whole covariance.

What `relative_intensities` averages is kept apart here: a repeat that differs from the others, and
noise that all wavelengths share, tell where a gap between model and measurement lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.errors import InputError
from twin.measurement.model import (
    SAMPLE_CAPTURES,
    BoolArray,
    Measurement,
    RelativeRow,
    RelativeSpectra,
    label,
)
from twin.measurement.relative import (
    Visit,
    certified_white,
    pooled_scatter,
    values_no_sample_has,
)
from twin.spectra import FloatArray


@dataclass(frozen=True, eq=False)
class Observations:
    """Relative intensities of every repeat of every capture of every sample.

    The covariance of the flattened values is blockdiag(independent) + sum_k c_k c_k' with
    c_k = common[k].ravel().

    Attributes:
        wavelength_nm: [nm], shape (W,).
        rows: sample, capture and repeat of the M spectra: by repeat, then sample, then capture.
        value: relative intensities, shape (W, M); NaN where not valid.
        valid: False where masked, shape (W, M).
        independent: covariance of what is independent between wavelengths, shape (W, M, M); rows
            and columns that are not valid are 0 but for a variance of 1.
        common: modes that all wavelengths share (level and tilt of the lamps), shape (K, W, M).
        reasons: what was masked, how much, and what was assumed.
    """

    wavelength_nm: FloatArray
    rows: tuple[RelativeRow, ...]
    value: FloatArray
    valid: BoolArray
    independent: FloatArray
    common: FloatArray
    reasons: tuple[str, ...]


def observations(measurement: Measurement, *, linearise: bool | None = None) -> Observations:
    """The repeats of a visit, each divided by the mean of its references.

    Args:
        measurement: the visit.
        linearise: as for `relative_intensities`.

    Raises:
        InputError: as `relative_intensities`.
    """
    if measurement.relative is not None:
        return _ready_made(measurement, measurement.relative)
    visit = Visit(measurement, linearise, apart=True)
    white = certified_white(measurement)
    rows, pairs, scales = [], [], []
    for repeat in range(visit.most_repeats):
        for sample in measurement.samples:
            for capture in SAMPLE_CAPTURES:
                signal = visit.repeat_of(capture, sample.name, repeat)
                if signal is None:
                    continue
                kind = "beam_reference" if capture == "collimated" else "white_reference"
                rows.append(RelativeRow(sample.name, capture, repeat))
                pairs.append((signal, visit.reference(kind, signal, sample.name)))
                scales.append(np.ones_like(white) if capture == "collimated" else white)
    value, covariance, valid, reasons, common = visit.ratios(pairs, np.stack(scales))
    spread = covariance - np.einsum("kwm,kwn->wmn", common, common)
    light_se = measurement.captures.light_se if measurement.captures is not None else None
    if light_se is not None:
        spread = spread + _of_the_light(measurement, tuple(rows), light_se)
    wrong, sentences = values_no_sample_has(_names(rows), value, covariance)
    valid = valid & ~wrong
    return Observations(
        wavelength_nm=measurement.wavelength_nm,
        rows=tuple(rows),
        value=np.where(valid, value, np.nan).T,
        valid=valid.T,
        independent=_masked(spread, valid.T),
        common=np.where(valid.T, common, 0.0),
        reasons=(*measurement.provenance.notes, *reasons, *sentences),
    )


def _names(rows: Sequence[RelativeRow]) -> list[str]:
    return [f"{label(row.capture, row.sample)}, repeat {row.repeat}" for row in rows]


def _of_the_light(
    measurement: Measurement, rows: tuple[RelativeRow, ...], light_se: FloatArray
) -> FloatArray:
    """Covariance (W, M, M) of the simulated light's own error, the same in every repeat."""
    names = [sample.name for sample in measurement.samples]
    place = np.array([3 * names.index(r.sample) + SAMPLE_CAPTURES.index(r.capture) for r in rows])
    error = light_se.reshape(3 * len(names), -1)[place].T
    same = place[:, None] == place[None, :]
    return np.where(same, error[:, :, None] * error[:, None, :], 0.0)


def _masked(covariance: FloatArray, valid: BoolArray) -> FloatArray:
    """Covariance (W, M, M) in which what is not valid stands alone with a variance of 1."""
    hidden = ~valid
    clean = np.where(hidden[:, :, None] | hidden[:, None, :], 0.0, covariance)
    clean = 0.5 * (clean + clean.transpose(0, 2, 1))
    index = np.arange(valid.shape[1])
    clean[:, index, index] += hidden
    return np.asarray(clean)


def _ready_made(measurement: Measurement, relative: RelativeSpectra) -> Observations:
    order = {sample.name: number for number, sample in enumerate(measurement.samples)}

    def place(index: int) -> tuple[int, int, int]:
        row = relative.rows[index]
        return row.repeat, order[row.sample], SAMPLE_CAPTURES.index(row.capture)

    chosen = sorted(range(len(relative.rows)), key=place)
    rows = tuple(relative.rows[index] for index in chosen)
    for sample in measurement.samples:
        for capture in SAMPLE_CAPTURES:
            if not any((row.sample, row.capture) == (sample.name, capture) for row in rows):
                raise InputError(
                    f"no capture {capture!r}",
                    f"{', '.join(SAMPLE_CAPTURES)} of every sample",
                    place=f"sample {sample.name!r}",
                )
    value, variance = relative.value[chosen], relative.sigma[chosen] ** 2
    reasons = []
    for kind in dict.fromkeys((row.sample, row.capture) for row in rows):
        own = [index for index, row in enumerate(rows) if (row.sample, row.capture) == kind]
        unknown = np.isnan(variance[own]) & ~np.isnan(value[own])
        if unknown.any():
            name = f"{kind[1]} of {kind[0]!r}"
            variance[own] = np.where(unknown, pooled_scatter(value[own], name), variance[own])
            reasons.append(f"sigma of {name} from the scatter of {len(own)} repeats")
    known = np.isfinite(value) & np.isfinite(variance)
    spread = np.zeros((value.shape[1], len(rows), len(rows)))
    index = np.arange(len(rows))
    spread[:, index, index] = np.where(known, variance, 0.0).T
    wrong, sentences = values_no_sample_has(_names(rows), value, spread)
    valid = known & ~wrong
    return Observations(
        wavelength_nm=measurement.wavelength_nm,
        rows=rows,
        value=np.where(valid, value, np.nan).T,
        valid=valid.T,
        independent=_masked(spread, valid.T),
        common=np.zeros((0, value.shape[1], len(rows))),
        reasons=(*measurement.provenance.notes, *reasons, *sentences),
    )
