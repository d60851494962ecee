"""The verdict in plain words: what was measured, what came out, how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenarios.report.content import Content, Verdict, sample_label
from twin.spectra import FloatArray

LEAST_COVERAGE = 70.0
"""Share [%] of true values in the 90 % intervals below which the intervals are called too narrow;
far below 90 because the errors of neighbouring wavelengths go together."""
_NAMES = ("Albedo", "Extinction σt", "Anisotropy g")


@dataclass(frozen=True)
class Tile:
    """One number with its name and a line of explanation."""

    name: str
    number: str
    note: str


@dataclass(frozen=True)
class Headline:
    """The top of the page."""

    tone: str
    """"good", "mixed" or "poor": colours the left edge; the words say it too."""
    verdict: str
    sentences: tuple[str, ...]
    tiles: tuple[Tile, ...]
    bar: tuple[tuple[Verdict, int, float], ...]
    """What became of the wavelengths: name, count, share [%]; only what occurs."""


def headline(content: Content) -> Headline:
    """Judge a result.

    Returns:
        "good" when at least 90 % of the wavelengths have an estimate without warning, the residuals
        are as large as the noise says and the intervals hold the truth (if known) often enough;
        "poor" when fewer than half have one (warnings included); else "mixed".
    """
    total = content.wavelength_nm.size
    counts = {verdict: int(content.where(verdict).sum()) for verdict in Verdict}
    usable = counts[Verdict.GOOD] / total
    spread = residual_spread(content)
    fits = spread is None or spread < 2.0
    coverage = truth_coverage(content)
    if usable >= 0.5 and coverage is not None and coverage < LEAST_COVERAGE:
        tone, verdict = "mixed", "The estimate is further from the truth than it says"
    elif usable >= 0.9 and fits:
        tone, verdict = "good", "The estimate can be used"
    elif usable + counts[Verdict.DOUBTFUL] / total < 0.5:
        tone, verdict = "poor", "Most wavelengths have no estimate to rely on"
    elif not fits:
        tone, verdict = "mixed", "The estimate does not reproduce the measurement"
    elif usable + counts[Verdict.DOUBTFUL] / total >= 0.9:
        tone, verdict = "mixed", "There is an estimate, with warnings"
    else:
        tone, verdict = "mixed", "Part of the spectrum can be used"
    verdict += f" ({counts[Verdict.GOOD]} of {total} wavelengths without any warning)."
    bar = tuple(
        (kind, counts[kind], 100 * counts[kind] / total) for kind in Verdict if counts[kind]
    )
    return Headline(tone, verdict, tuple(_sentences(content, counts, spread)), _tiles(content), bar)


def residual_spread(content: Content) -> float | None:
    """Root mean square of the whitened residuals (1 when the noise is as said), or None."""
    if content.residual is None:
        return None
    seen = content.residual[np.isfinite(content.residual)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else None


def _sentences(content: Content, counts: dict[Verdict, int], spread: float | None) -> list[str]:
    wavelength = content.wavelength_nm
    names = [sample_label(sample) for sample in content.samples]
    listed = "; ".join(names)
    kind = "broad channels of a multispectral chip" if content.broad else "wavelengths"
    said = [
        f"Measured: {listed}, {wavelength.size} {kind} from {wavelength[0]:g} to"
        f" {wavelength[-1]:g} nm."
    ]
    lost = [
        f"{counts[kind]} {words}"
        for kind, words in (
            (Verdict.DOUBTFUL, "with a warning"),
            (Verdict.MASKED, "masked (no usable data)"),
            (Verdict.OUTSIDE, "outside the appearance map, not extrapolated"),
            (Verdict.FAILED, "without a solution"),
        )
        if counts[kind]
    ]
    said.append("Not good: " + "; ".join(lost) + "." if lost else "No wavelength was lost.")
    if not content.has_g:
        said.append(
            "g was not estimated: without the collimated beam the map has two dimensions, and"
            " albedo and extinction hold for the assumed g only."
        )
    if spread is not None:
        said.append(
            "What the estimate predicts differs from the measured intensities by"
            f" {spread:.1f} times their uncertainty (root mean square; 1 is as expected)."
        )
    said.append(_truth_sentence(content))
    return said


def _truth_sentence(content: Content) -> str:
    if content.truth is None:
        return "The truth is not known: this report can show precision, not accuracy."
    error, inside = truth_error(content), truth_coverage(content)
    parts = [
        f"albedo {error[0]:.2g}" if np.isfinite(error[0]) else "",
        f"σt {error[1]:.2g} %" if np.isfinite(error[1]) else "",
        f"g {error[2]:.2g}" if np.isfinite(error[2]) else "",
    ]
    text = "Median distance to the truth: " + ", ".join(part for part in parts if part)
    if inside is not None:
        text += f"; the 90 % intervals hold the truth in {inside:.0f} % of the cases"
    return text + "."


def _determined(content: Content, row: int, values: FloatArray) -> FloatArray:
    """Values at the wavelengths where the captures determine this parameter."""
    chosen = values[content.identifiable[row]]
    return np.asarray(chosen[np.isfinite(chosen)])


def _median(content: Content, row: int, values: FloatArray) -> float:
    chosen = _determined(content, row, values)
    return float(np.median(chosen)) if chosen.size else float("nan")


def truth_error(content: Content) -> tuple[float, float, float]:
    """Median absolute error where determined: albedo, sigma_t [%], g; NaN where none."""
    if content.truth is None:
        return (float("nan"),) * 3
    error = np.abs(content.estimate.value - content.truth.value)
    share = np.full(error[1].shape, np.nan)
    np.divide(100 * error[1], content.truth.value[1], out=share, where=content.truth.value[1] > 0)
    return _median(content, 0, error[0]), _median(content, 1, share), _median(content, 2, error[2])


def truth_coverage(content: Content) -> float | None:
    """Share [%] of true values inside the 90 % intervals, all parameters where determined."""
    low, high, truth = content.estimate.low, content.estimate.high, content.truth
    if low is None or high is None or truth is None:
        return None
    known = np.isfinite(low) & np.isfinite(high) & np.isfinite(truth.value) & content.identifiable
    inside = (truth.value >= low) & (truth.value <= high)
    return float(100 * inside[known].mean()) if known.any() else None


def _tiles(content: Content) -> tuple[Tile, ...]:
    sd = content.estimate.sd
    error = truth_error(content)
    units = ("", " %", "")
    tiles = []
    for row, name in enumerate(_NAMES):
        value = _determined(content, row, content.estimate.value[row])
        if value.size == 0:
            tiles.append(Tile(name, "–", "not determined by these captures"))
            continue
        low, high = float(value.min()), float(value.max())
        unit = " /mm" if row == 1 else ""
        span = f"{low:.3g} to {high:.3g}{unit}" if row else f"{low:.4g} to {high:.4g}"
        notes = []
        if sd is not None:
            spread = sd[row]
            if row == 1:
                sigma = content.estimate.value[1]
                spread = 100 * spread / np.where(sigma > 0, sigma, np.nan)
            notes.append(f"median 1σ ±{_median(content, row, spread):.2g}{units[row]}")
        if np.isfinite(error[row]):
            notes.append(f"median error {error[row]:.2g}{units[row]}")
        if value.size < content.wavelength_nm.size:
            notes.append(f"at {value.size} of {content.wavelength_nm.size} wavelengths")
        tiles.append(Tile(name, span, "; ".join(notes)))
    return tuple(tiles)
