"""Figure 6: transmittance through the aperture, with in-scattering, against Beer's law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures.points import (
    Blocks,
    Point,
    jackknife,
    leave_one_out,
)
from scenarios.report.figure import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    new_figure,
    plain_ticks,
)
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

THICKNESS_MM, G = 1.8, 0.8
ALBEDO = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
DRAWN = (0.0, 0.5, 0.8, 0.95, 1.0)
COLOURS = (BLUE, GREEN, PURPLE, ORANGE, VERMILION)
STYLES = ("-", (0, (6, 1.5)), (0, (3, 1.5)), (0, (5, 1.5, 1, 1.5)), "-")
ACCEPTANCE_DEG = (1.0, 5.0, None)
"""Half-angles; None: every direction that leaves through the aperture."""
FLOOR = 1.0 / 65535.0
"""One count of an ideal 16-bit sensor that the bare beam fills."""


@dataclass(frozen=True)
class Curve:
    """Transmittance over sigma_t.

    Attributes:
        sigma_t_per_mm: (S,) [1/mm].
        value, error: transmittance and standard error, (A, S).
        excess, excess_error: ratio to the unscattered transmittance minus 1, (A, S).
    """

    sigma_t_per_mm: FloatArray
    value: FloatArray
    error: FloatArray
    excess: FloatArray
    excess_error: FloatArray

    @property
    def tau(self) -> FloatArray:
        """Optical thickness, (S,)."""
        return self.sigma_t_per_mm * THICKNESS_MM


def curve_points(
    quick: bool, acceptance_deg: float | None, n: float = 1.0, g: float = G
) -> tuple[Point, ...]:
    """The points of one curve."""
    even = np.arange(1, 5) * 2.0 if quick else np.arange(1, 33) * 0.25
    sigma = [0.002, 0.005, 0.01, 0.02, 0.05, 0.1, *even.tolist()]
    return tuple(
        Point(
            s, g=g, n=n, thickness_mm=THICKNESS_MM, lit="beam",
            acceptance_deg=acceptance_deg, albedo=ALBEDO, log2_paths=6 if quick else 11,
        )
        for s in sigma
    )  # fmt: skip


def points(quick: bool) -> tuple[Point, ...]:
    """Everything that the figure needs."""
    drawn = [point for angle in ACCEPTANCE_DEG for point in curve_points(quick, angle)]
    index = [point for angle in ACCEPTANCE_DEG[:2] for point in curve_points(quick, angle, n=1.5)]
    lower = curve_points(quick, 1.0, g=0.4)
    return (*drawn, *index, *lower)


def curve_of(points: tuple[Point, ...], results: Mapping[Point, Blocks]) -> Curve:
    """Put the results of `curve_points` together."""
    left = np.stack([leave_one_out(results[point].value[:, 0]) for point in points], axis=-1)
    value, error = jackknife(left)
    # without scattering (albedo 0) what arrives is unscattered, refraction included
    excess, excess_error = jackknife(left / left[:, :1] - 1.0)
    sigma = np.array([point.sigma_t_per_mm for point in points])
    return Curve(sigma, value, error, excess, excess_error)


def draw(results: Mapping[Point, Blocks], quick: bool) -> tuple[Figure, dict[str, Any]]:
    """The figure and its checks."""
    curves = {angle: curve_of(curve_points(quick, angle), results) for angle in ACCEPTANCE_DEG}
    figure = new_figure(11.6, 4.6)
    panels = figure.subplots(1, 3, sharex=True)
    for axes, angle, name in zip(panels[:2], ACCEPTANCE_DEG[:2], "ab", strict=True):
        _transmittance(axes, curves[angle])
        axes.set_title(f"({name})  Detector's cone: {angle:g}°")
    panels[0].legend(loc="upper right", fontsize=8)
    panels[0].set_ylabel("Transmittance $I_c$ through the 4 mm aperture [–]")
    _excess(panels[2], curves)
    for axes in panels:
        axes.set_xlim(0, 8)
        axes.set_xlabel("Extinction coefficient $\\sigma_t$ [1/mm]")
    return figure, {
        "floor_16_bit": FLOOR,
        "optical_thickness_of_floor": -float(np.log(FLOOR)),
        "n_1": {_angle(angle): of_curve(curve) for angle, curve in curves.items()},
        "n_1.5": {
            _angle(angle): of_curve(curve_of(curve_points(quick, angle, n=1.5), results))
            for angle in ACCEPTANCE_DEG[:2]
        },
        "g_0.4": {"1 deg": of_curve(curve_of(curve_points(quick, 1.0, g=0.4), results))},
        "beer_largest_deviation_at_albedo_0": float(
            max(np.abs(c.value[0] / np.exp(-c.tau) - 1.0).max() for c in curves.values())
        ),
    }


def _angle(angle: float | None) -> str:
    return "all directions" if angle is None else f"{angle:g} deg"


def _transmittance(axes: Axes, curve: Curve) -> None:
    for albedo, colour, dashes in zip(DRAWN, COLOURS, STYLES, strict=True):
        axes.plot(
            curve.sigma_t_per_mm, curve.value[ALBEDO.index(albedo)], color=colour, ls=dashes,
            label=f"albedo {albedo:g}",
        )  # fmt: skip
    marked = curve.sigma_t_per_mm % 0.5 == 0.0
    axes.plot(
        curve.sigma_t_per_mm[marked], np.exp(-curve.tau[marked]), "o", ms=3.2, mfc="none",
        color=INK, mew=0.8, label="Beer's law",
    )  # fmt: skip
    axes.axhline(FLOOR, color=INK, lw=0.9, ls=(0, (1, 1.5)))
    axes.text(0.15, FLOOR * 0.85, "16-bit floor, 1/65535", va="top", fontsize=8)
    axes.set_yscale("log")
    axes.set_ylim(5e-7, 1.0)


def _excess(axes: Axes, curves: Mapping[float | None, Curve]) -> None:
    from matplotlib.lines import Line2D

    shades = {1.0: BLUE, 5.0: ORANGE, None: VERMILION}
    for angle, curve in curves.items():
        for albedo, dashes in ((1.0, "-"), (0.5, (0, (4, 2)))):
            excess = curve.excess[ALBEDO.index(albedo)]
            axes.plot(curve.sigma_t_per_mm, excess, color=shades[angle], ls=dashes)
    dotted: dict[str, Any] = {"color": INK, "lw": 0.9, "ls": (0, (1, 1.5))}
    axes.axhline(0.01, **dotted)
    axes.axvline(-np.log(FLOOR) / THICKNESS_MM, **dotted)
    handles = [Line2D([], [], color=shades[angle]) for angle in (None, 5.0, 1.0)]
    handles += [Line2D([], [], color=INK), Line2D([], [], color=INK, ls=(0, (4, 2)))]
    handles.append(Line2D([], [], **dotted))
    names = ["all directions", "cone 5°", "cone 1°", "albedo 1", "albedo 0.5"]
    axes.legend(
        handles, [*names, "excess 1 %; Beer 1/65535"], loc="lower right", fontsize=7.5, ncols=2,
        columnspacing=1.0, handlelength=1.6, frameon=True, framealpha=1.0, edgecolor="none",
        facecolor="white",
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(1e-4, 1e4)
    plain_ticks(axes)
    axes.set_ylabel("Excess $I_c$ / Beer − 1 [–]")
    axes.set_title("(c)  Excess over Beer's law")


def crossing(x: FloatArray, y: FloatArray, level: float) -> float | None:
    """Where a rising curve first reaches a level, on straight lines in (log x, log y); None: never.

    x and y have shape (S,); before the first node the curve is taken as proportional to x.
    """
    above = np.flatnonzero(y >= level)
    if above.size == 0:
        return None
    first = int(above[0])
    if first == 0:
        return float(x[0] * level / y[0])
    x0, y0 = float(x[first - 1]), max(float(y[first - 1]), 1e-300)
    share = np.log(level / y0) / np.log(float(y[first]) / y0)
    return float(x0 * (float(x[first]) / x0) ** share)


def of_curve(curve: Curve) -> dict[str, Any]:
    """Where in-scattering matters, for some albedos."""
    found = {}
    for albedo in DRAWN[1:]:
        row = ALBEDO.index(albedo)
        counts = (curve.value[row] - curve.value[0]) / FLOOR
        at_floor = np.interp(-np.log(FLOOR), curve.tau, np.log1p(curve.excess[row]))
        found[f"albedo_{albedo:g}"] = {
            "excess_1_percent": passes(curve, row, 0.01),
            "excess_10_percent": passes(curve, row, 0.1),
            "twice_beer": passes(curve, row, 1.0),
            "ratio_to_beer_where_beer_is_1_count": float(np.exp(at_floor)),
            "largest_excess_in_counts": float(counts.max()),
            "excess_of_1_count_from_optical_thickness": crossing(curve.tau, counts, 1.0),
            "excess_of_1_count_to_optical_thickness": _last(curve.tau, counts),
            "largest_relative_standard_error": float((curve.error[row] / curve.value[row]).max()),
        }
    return found


def passes(curve: Curve, row: int, level: float) -> dict[str, float] | None:
    """Where the excess over the unscattered transmittance passes a level, and that there."""
    tau = crossing(curve.tau, curve.excess[row], level)
    if tau is None:
        return None
    unscattered = float(np.exp(np.interp(tau, curve.tau, np.log(curve.value[0]))))
    return {
        "optical_thickness": tau,
        "unscattered": unscattered,
        "unscattered_in_counts": unscattered / FLOOR,
    }


def _last(tau: FloatArray, counts: FloatArray) -> float | None:
    seen = np.flatnonzero(counts >= 1.0)
    return float(tau[seen[-1]]) if seen.size else None
