"""What remains, and what the noise was made of."""

from __future__ import annotations

import numpy as np

from diagnosis import Fit, Problem
from diagnosis.calibration import generator_of
from scenarios.report.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    figure_style,
    literal,
    new_figure,
    svg_of,
    wavelength_axis,
)
from twin.spectra import FloatArray

DRAWS = 400
LAGS = 12
PARTS = (
    ("counts: shot and read noise, references", BLUE),
    ("lamps: level and tilt", ORANGE),
    ("the engine's own error", GREEN),
)


def draw_rest(problem: Problem, fit: Fit, name: str) -> str:
    """Quantiles and autocorrelation of what is left, against simulated noise.

    The material's fit takes directions out of every residual, so that they are neither of unit
    size nor independent: the same is done to simulated noise.
    """
    shape = problem.value.shape
    noise = fit.reduction.simulate(generator_of(0, 11), DRAWS)
    spread = noise.std(axis=1)
    known = problem.valid.ravel() & (spread > 1e-3)
    seen = np.sort(fit.residual[known] / spread[known])
    drawn = np.sort(noise[known] / spread[known][:, None], axis=0)
    low, middle, high = np.percentile(drawn, [2.5, 50.0, 97.5], axis=1)
    with figure_style():
        figure = new_figure(11.0, 3.5)
        left, right = figure.subplots(1, 2)
        left.fill_between(middle, low, high, color=PALE, lw=0.0, label="95 % of simulated noise")
        left.plot(middle, middle, color=GREY, lw=0.8)
        left.plot(middle, seen, ls="", marker=".", ms=3.0, color=BLUE, label=literal(name))
        left.set_xlabel("Quantile of noise [sd]")
        left.set_ylabel("Quantile of what is left [sd]")
        left.set_title("Quantiles")
        left.legend(loc="upper left")
        lags = np.arange(1, min(LAGS, shape[0] - 1) + 1)
        own = _autocorrelation(fit.residual.reshape(shape), problem, lags)
        null = np.array(
            [_autocorrelation(row.reshape(shape), problem, lags) for row in noise.T[:200]]
        )
        step = float(np.median(np.diff(problem.wavelength_nm))) if shape[0] > 1 else 1.0
        band = np.percentile(null, [2.5, 97.5], axis=0)
        right.fill_between(
            lags * step, band[0], band[1], color=PALE, lw=0.0, label="95 % of simulated noise"
        )
        right.axhline(0.0, color=GREY, lw=0.8)
        right.plot(lags * step, own, color=BLUE, marker="o", ms=3.5, lw=1.0, label=literal(name))
        most = max(0.12, 1.2 * float(np.max(np.abs(np.concatenate([own, band.ravel()])))))
        right.set_ylim(-most, most)
        right.set_xlabel("Distance in wavelength [nm]")
        right.set_ylabel("Autocorrelation [–]")
        right.set_title("Autocorrelation over wavelength")
        right.legend(loc="upper right")
        return svg_of(figure, "rest", "Quantiles and autocorrelation of what is left.")


def _autocorrelation(residual: FloatArray, problem: Problem, lags: np.ndarray) -> FloatArray:
    """Mean over channels, without the channels' means, (L,)."""
    seen = np.where(problem.valid, residual, 0.0)
    count = np.maximum(problem.valid.sum(axis=0), 1)
    away = np.where(problem.valid, seen - seen.sum(axis=0) / count, 0.0)
    total = max(float(np.sum(away**2)), 1e-300)
    return np.array([float(np.sum(away[lag:] * away[:-lag])) / total for lag in lags])


def variance_parts(problem: Problem, engine_modes: int) -> FloatArray:
    """Variance of counts, lamps and engine, (3, W, M); the engine's modes are the last ones."""
    split = len(problem.common) - engine_modes
    counts = np.diagonal(problem.independent, axis1=1, axis2=2)
    lamps = np.sum(problem.common[:split] ** 2, axis=0)
    engine = np.sum(problem.common[split:] ** 2, axis=0)
    return np.where(problem.valid, np.stack([counts, lamps, engine]), np.nan)


def draw_covariance(problem: Problem, engine_modes: int) -> str:
    """Standard deviation of one repeat in per cent of the signal, and what it is made of."""
    parts = variance_parts(problem, engine_modes)
    captures = list(dict.fromkeys(c.capture for c in problem.channels))
    samples = list(dict.fromkeys(c.sample for c in problem.channels))
    wavelength = problem.wavelength_nm
    with figure_style():
        figure = new_figure(11.0, 1.0 + 1.6 * len(captures))
        axes = figure.subplots(
            len(captures), len(samples), sharex=True, sharey="row", squeeze=False
        )
        for row, capture in enumerate(captures):
            top = 0.0
            for column, sample in enumerate(samples):
                axis = axes[row, column]
                own = [
                    i for i, c in enumerate(problem.channels)
                    if (c.capture, c.sample) == (capture, sample)
                ][:1]  # fmt: skip
                if not own:
                    axis.set_axis_off()
                    continue
                variance = parts[:, :, own[0]]
                total = np.sqrt(variance.sum(axis=0))
                level = np.where(problem.valid[:, own[0]], np.abs(problem.value[:, own[0]]), np.nan)
                sd = 100.0 * total / np.maximum(level, 1e-6)
                bottom = np.zeros(len(wavelength))
                for (label, colour), part in zip(PARTS, variance, strict=True):
                    ahead = bottom + sd * part / np.maximum(variance.sum(axis=0), 1e-300)
                    axis.fill_between(
                        wavelength, bottom, ahead, color=colour, alpha=0.85, lw=0.0, label=label
                    )
                    bottom = ahead
                axis.plot(wavelength, sd, color=INK, lw=1.0)
                # One dark wavelength must not flatten all the others.
                top = max(top, 1.2 * float(np.nanpercentile(sd, 92)))
                if row == 0:
                    axis.set_title(literal(sample))
                if column == 0:
                    axis.set_ylabel(f"{capture}\nsd [% of signal]")
            axes[row, 0].set_ylim(0.0, top or 1.0)
        for axis in axes[-1]:
            wavelength_axis(axis, wavelength)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        return svg_of(figure, "covariance", "What the noise is made of.")
