"""What a gap does to colour: CIEDE2000 under D65 before and after the effects are added.

Two questions. How far are the captures from what the twin predicts, as colours? And how much does
the predicted appearance of the material change, 5 mm thick over black, when its estimate moves?
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.colour import (
    NEEDED_NM,
    VISIBLE_NM,
    WIDEST_HOLE_NM,
    Observer,
    Swatch,
    ciede2000,
)
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from diagnosis import Fit, Problem
    from diagnosis.rounds import Rounds
    from twin.measurement import Measurement

THICKNESS_MM = 5.0
"""Of the slab whose appearance is predicted."""


@dataclass(frozen=True)
class ColourChange:
    """Colours before and after the leading effects.

    Attributes:
        rows: sample, background, CIEDE2000 measured to predicted before and after.
        before, after: swatches of the slab by the estimate without and with the effects.
        truth: of a simulated visit.
        range_nm: wavelengths used [nm].
    """

    rows: tuple[tuple[str, str, float, float], ...]
    before: Swatch
    after: Swatch
    truth: Swatch | None
    range_nm: tuple[float, float]

    @property
    def moved(self) -> float:
        """CIEDE2000 between the slab before and after."""
        return ciede2000(self.before, self.after) or 0.0

    @property
    def to_truth(self) -> tuple[float, float] | None:
        """CIEDE2000 of the slab to the truth, before and after."""
        if self.truth is None:
            return None
        return (
            ciede2000(self.before, self.truth) or 0.0, ciede2000(self.after, self.truth) or 0.0
        )  # fmt: skip

    def worst(self) -> tuple[float, float]:
        """Largest CIEDE2000 of a capture, measured to predicted, before and after."""
        return max(row[2] for row in self.rows), max(row[3] for row in self.rows)

    def sentences(self) -> list[str]:
        """In words."""
        said = []
        if self.rows:
            before, after = self.worst()
            said.append(
                f"colour of the captures (D65, CIEDE2000 to the prediction, largest): {before:.2f}"
                f" before, {after:.2f} after"
            )
        text = (
            f"predicted appearance of the material at {THICKNESS_MM:g} mm over black moves by"
            f" {self.moved:.2f} CIEDE2000"
        )
        if self.to_truth is not None:
            before, after = self.to_truth
            text += f" (from the truth of the simulation: {before:.2f} before, {after:.2f} after)"
        return [*said, text]

    def as_json(self) -> dict[str, Any]:
        """For the JSON file."""
        return {
            "illuminant": "D65",
            "range_nm": list(self.range_nm),
            "thickness_mm": THICKNESS_MM,
            "appearance_moved": self.moved,
            "appearance_to_truth": None if self.to_truth is None else list(self.to_truth),
            "captures": [
                {"sample": s, "background": b, "before": x, "after": y} for s, b, x, y in self.rows
            ],
        }


def colour_change(
    measurement: Measurement, rounds: Rounds, material_of: Any
) -> ColourChange | None:
    """Colours before and after all accepted effects; None without any, or with too few data.

    Args:
        measurement: the visit, for the truth of a simulated one and the refractive index.
        rounds: the diagnosis.
        material_of: coordinates of the fit (W, 3) to albedo, sigma_t [1/mm] and g (W, 3).
    """
    null = rounds.first.diagnosis.null
    last = rounds.last.diagnosis
    best = last.best if rounds.last.accepted else last.null
    if null is None or best is None or not rounds.accepted:
        return None
    problem = rounds.first.case.problem
    wavelength = problem.wavelength_nm
    if not _enough(wavelength):
        return None
    spectra = [material_of(null.material), material_of(best.material)]
    truth = measurement.truth
    if truth is not None:
        columns = (truth.albedo, truth.sigma_t_per_mm, truth.g)
        own = [np.interp(wavelength, truth.wavelength_nm, column[0]) for column in columns]
        spectra.append(np.stack(own, axis=-1))
    try:
        swatches = _slab(measurement, wavelength, np.array(spectra))
    except InputError:
        return None
    true = swatches[2] if truth is not None else None
    rows = capture_rows(problem, null, best)
    return ColourChange(rows, swatches[0], swatches[1], true, _ends(wavelength))


def _enough(wavelength: FloatArray) -> bool:
    """Whether a colour can be computed from these wavelengths [nm]."""
    if wavelength.size < 4 or np.diff(wavelength).max() > WIDEST_HOLE_NM:
        return False
    return bool(wavelength[0] <= NEEDED_NM[0] and wavelength[-1] >= NEEDED_NM[1])


def _ends(wavelength: FloatArray) -> tuple[float, float]:
    """Part of the visible range that is known [nm]."""
    low, high = VISIBLE_NM
    return max(low, float(wavelength[0])), min(high, float(wavelength[-1]))


def capture_rows(
    problem: Problem, null: Fit, best: Fit
) -> tuple[tuple[str, str, float, float], ...]:
    """Sample, background, and CIEDE2000 measured to predicted without and with the effects.

    Every capture over the wavelengths where it is known; one with too few of them is left out.

    Args:
        problem: the data.
        null: fit without effects.
        best: fit with them.
    """
    rows = []
    for capture, sample in problem.blocks:
        if capture not in ("black", "white"):
            continue
        own = [
            i for i, c in enumerate(problem.channels) if (c.capture, c.sample) == (capture, sample)
        ]
        seen = problem.valid[:, own]
        good = seen.any(axis=1)
        place = problem.wavelength_nm[good]
        if not _enough(place):
            continue
        observer = Observer(*_ends(place))
        value = np.where(seen, problem.value[:, own], 0.0).sum(axis=1)
        value = value[good] / seen[good].sum(axis=1)

        measured, *pair = (
            observer.swatch(np.interp(observer.wavelength_nm, place, curve))
            for curve in (value, *(f.predicted[good, own[0]] for f in (null, best)))
        )
        before, after = (ciede2000(measured, each) or 0.0 for each in pair)
        rows.append((sample, capture, before, after))
    return tuple(rows)


def _slab(measurement: Measurement, wavelength: FloatArray, spectra: FloatArray) -> list[Swatch]:
    from scenarios.predict.appearance import reflectance_45_0
    from twin.materials import refractive_index

    n = refractive_index(measurement.samples[0].n, wavelength)
    factor = reflectance_45_0(spectra, THICKNESS_MM, n, 0.0)
    known = np.isfinite(factor).all(axis=0)
    if not _enough(wavelength[known]):
        raise InputError("no appearance at most wavelengths", "one", place="colour")
    observer = Observer(*_ends(wavelength[known]))
    return [
        observer.swatch(np.interp(observer.wavelength_nm, wavelength[known], row[known]))
        for row in factor
    ]
