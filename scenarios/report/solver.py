"""What the solver says of itself: its statistics as a table, its draws as corner plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.budget_page import budget_part
from scenarios.report.content import Content, Verdict
from scenarios.report.corner_plot import LEAST_DRAWS, draw_corner
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators import EstimateResult, UncertaintyBudget

NOTHING_SAID: Mapping[str, Any] = {"sentence": "", "rows": (), "corners": (), "budget": None}
CORNERS = 2
"""Corner plots in a report: the least and the most certain wavelength."""

_MEANINGS = {
    "chi_square": "sum of the squared residuals; about the degrees of freedom when the bench is as"
    " described",
    "degrees_of_freedom": "captures that were used minus the unknowns: three, or what a smooth"
    " spectrum really spends of them",
    "steps": "evaluations of the engine until the fit had settled",
    "starts": "starting points that were tried",
    "starts_agreeing": "starting points that ended at the same material",
    "evaluations": "looks at the sum of squares",
    "chi_square_still_promised": "what another step was still expected to gain",
    "autocorrelation_time": "steps of the ensemble until it has forgotten where it was",
    "effective_sample_size": "independent draws that the chain is worth",
    "acceptance_fraction": "proposals that were accepted; near 0 the chain hardly moves",
    "emulator_error": "largest error of the emulated captures, in standard deviations",
    "converged": "1 where the chain was long enough",
    "kubelka_munk_k_per_mm": "Kubelka-Munk absorption K [1/mm]",
    "kubelka_munk_s_per_mm": "Kubelka-Munk scattering S [1/mm]",
    "reflectance_infinite": "reflectance of an infinitely thick layer",
    "disagreement_sigma": "how far the samples disagree, in standard errors",
}


@dataclass(frozen=True)
class StatisticRow:
    """One statistic over the wavelengths."""

    name: str
    median: str
    low: str
    high: str
    meaning: str


def solver_parts(
    result: EstimateResult, content: Content, budget: UncertaintyBudget | None
) -> dict[str, Any]:
    """What the template shows of the solver: sentence, statistics, corner plots and budget."""
    from markupsafe import Markup

    return {
        "sentence": statistic_sentence(result),
        "rows": statistic_rows(result),
        "corners": tuple(Markup(svg) for svg in corner_drawings(result, content)),
        "budget": Markup(budget_part(budget)) if budget is not None else None,
    }


def statistic_rows(result: EstimateResult) -> tuple[StatisticRow, ...]:
    """The statistics of a result: median, smallest and largest value over the wavelengths."""
    rows = []
    for name, values in result.statistics.items():
        seen = np.asarray(values)[np.isfinite(values)]
        median, low, high = (
            (f"{float(of(seen)):.4g}" if seen.size else "–") for of in (np.median, np.min, np.max)
        )
        rows.append(
            StatisticRow(name.replace("_", " "), median, low, high, _MEANINGS.get(name, ""))
        )
    return tuple(rows)


def statistic_sentence(result: EstimateResult) -> str:
    """In words: how the sum of squares compares with what noise alone explains, and convergence."""
    said = []
    chi, freedom = (result.statistics.get(k) for k in ("chi_square", "degrees_of_freedom"))
    if chi is not None and freedom is not None:
        known = np.isfinite(chi) & np.isfinite(freedom) & (freedom > 0)
        if known.any():
            ratio = float(np.median(chi[known] / freedom[known]))
            said.append(
                f"Chi-square is {ratio:.2f} times its degrees of freedom (median; 1 is what noise"
                " alone gives)."
            )
        elif np.isfinite(freedom).any():
            said.append(
                "There are as many captures as unknowns, so chi-square cannot tell whether the"
                " bench is as described."
            )
    converged = result.statistics.get("converged")
    if converged is not None:
        ran = np.isfinite(converged)
        said.append(
            f"The chain converged at {int((converged[ran] > 0).sum())} of {int(ran.sum())}"
            " wavelengths that were sampled."
        )
    return " ".join(said)


def corner_drawings(result: EstimateResult, content: Content) -> tuple[str, ...]:
    """Corner plots of the least and the most certain wavelength, in the order of wavelength.

    Certain: the smallest relative standard error of sigma_t. None without draws.
    """
    truth = content.truth.value.T if content.truth is not None else None
    return tuple(
        draw_corner(result, index, _point(truth, index)) for index in corner_places(result, content)
    )


def corner_places(result: EstimateResult, content: Content) -> tuple[int, ...]:
    """Indices of the wavelengths that corner plots are drawn at, increasing."""
    if result.draws is None or len(result.draws) < LEAST_DRAWS:
        return ()
    shown = content.where(Verdict.GOOD) | content.where(Verdict.DOUBTFUL)
    spread = np.std(result.draws, axis=0)
    usable = shown & np.isfinite(spread).all(axis=1) & (spread > 0.0).all(axis=1)
    places = np.flatnonzero(usable)
    if not places.size:
        return ()
    relative = spread[places, 1] / np.abs(result.sigma_t_per_mm[places])
    ordered = places[np.argsort(relative, kind="stable")]
    chosen = ordered[np.linspace(0, ordered.size - 1, min(CORNERS, ordered.size)).astype(int)]
    return tuple(int(index) for index in np.unique(chosen))


def _point(truth: FloatArray | None, index: int) -> Sequence[float] | None:
    if truth is None or not np.isfinite(truth[index]).all():
        return None
    return [float(value) for value in truth[index]]
