"""Predicted against simulated accuracy: the seed's four set-ups, and lists of candidates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.design.fluorescent import FluorescentPrediction, typical
from scenarios.design.fluorescent_fitted import STEPS
from scenarios.design.fluorescent_population import fluorescent_population
from scenarios.design.fluorescent_prior import linearised_population
from scenarios.design.fluorescent_search import SEED_DESIGNS, FluorescentDesign, predict_designs
from scenarios.design.fluorescent_verify import errors_of_visits
from twin.errors import InputError
from twin.spectra import FloatArray

WITHIN = (0.85, 1.15)
FIGURES = ("lower", "diagonal", "colour")
DRAWS = 2


@dataclass(frozen=True, eq=False)
class Comparison:
    """N designs, predicted and simulated for the same B materials.

    Attributes:
        designs: N of them.
        predicted: errors of every material.
        simulated: the same from whole simulations.
    """

    designs: tuple[FluorescentDesign, ...]
    predicted: FluorescentPrediction
    simulated: FluorescentPrediction

    def ratio(self, figure: str = "lower") -> FloatArray:
        """Predicted over simulated, typical of the materials, (N,)."""
        return np.asarray(
            typical(getattr(self.predicted, figure)) / typical(getattr(self.simulated, figure))
        )

    def ratio_error(self, figure: str = "lower") -> FloatArray:
        """Standard error of `ratio` over the materials, (N,)."""
        one = np.log(getattr(self.predicted, figure) / getattr(self.simulated, figure))
        spread = one.std(axis=1, ddof=1) / np.sqrt(one.shape[1])
        return np.asarray(spread * self.ratio(figure))

    def within(self, figure: str = "lower") -> float:
        """Share of designs whose ratio is 0.85 to 1.15."""
        found = self.ratio(figure)
        return float(np.mean((found >= WITHIN[0]) & (found <= WITHIN[1])))

    def rank_correlation(self, figure: str = "lower") -> float:
        """Spearman's correlation between the predicted and the simulated order."""
        from scipy.stats import spearmanr

        one, other = (typical(getattr(each, figure)) for each in (self.predicted, self.simulated))
        return float(spearmanr(one, other).statistic)

    def simulated_against(
        self, number: int, figure: str = "lower", *, predicted: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Simulated error over that of one design, and its standard error, material by material.

        Args:
            number: of that design.
            figure: "lower", "diagonal" or "colour".
            predicted: the predicted errors instead.

        Returns:
            Geometric mean over the materials, and its standard error, (N,) each.
        """
        value = getattr(self.predicted if predicted else self.simulated, figure)
        one = np.log(value / value[number])
        found = np.exp(one.mean(axis=1))
        return found, found * one.std(axis=1, ddof=1) / np.sqrt(one.shape[1])


def compared(
    designs: Sequence[FluorescentDesign],
    *,
    materials: int = 36,
    population_seed: int = 2,
    seeds: Sequence[int] = (1,),
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Predict and simulate some designs for one generated population.

    Args:
        designs: N of them.
        materials: size of the population, B.
        population_seed: of the population.
        seeds: visits to each material; their errors are averaged.
        progress: is told how many designs of how many are simulated.

    Raises:
        InputError: no design, or no seed.
    """
    if not designs or not seeds:
        raise InputError("no design or no seed", "one of each or more", place="designs")
    population = fluorescent_population(materials, seed=population_seed)
    predicted = predict_designs(
        designs, linearised_population(population), draws=DRAWS, steps=STEPS
    )
    found: dict[str, list[FloatArray]] = {name: [] for name in FIGURES}
    for number, design in enumerate(designs):
        visits = [
            errors_of_visits(design.setup, population, design.protocol, seed) for seed in seeds
        ]
        for name in FIGURES:
            found[name].append(np.mean([each[name] for each in visits], axis=0))
        if progress is not None:
            progress(number + 1, len(designs))
    simulated = FluorescentPrediction(*(np.array(found[name]) for name in FIGURES))
    return Comparison(tuple(designs), predicted, simulated)


def table1(comparison: Comparison) -> dict[str, dict[str, float]]:
    """The seed's four set-ups: price, predicted and simulated figures, ranks by the cells' RMSE.

    Raises:
        InputError: one of them is not in the comparison.
    """
    numbers = {}
    for name, design in SEED_DESIGNS.items():
        if design not in comparison.designs:
            raise InputError(f"a comparison without {name}", "the seed's four", place="designs")
        numbers[name] = comparison.designs.index(design)
    chosen = list(numbers.values())
    rows: dict[str, dict[str, float]] = {}
    kinds = (("predicted", comparison.predicted), ("simulated", comparison.simulated))
    for name, number in numbers.items():
        row = {"price_usd": comparison.designs[number].price_usd}
        for kind, values in kinds:
            row[f"{kind}_rmse"] = float(values.rmse_lower[number])
            row[f"{kind}_rmse_diagonal"] = float(values.rmse_diagonal[number])
            row[f"{kind}_de2000"] = float(values.de2000[number])
            order = np.argsort(values.rmse_lower[chosen])
            row[f"{kind}_rank"] = float(np.flatnonzero(np.array(chosen)[order] == number)[0] + 1)
        row["ratio"] = row["predicted_rmse"] / row["simulated_rmse"]
        rows[name] = row
    return rows
