"""Which fluorescence set-ups are worth their price: choices of lights, and what a light buys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from scenarios.design.fluorescent import (
    FluorescentPrediction,
    predict_fluorescence,
    predict_light_subsets,
)
from scenarios.design.fluorescent_parts import SEED_LIGHTS, assembled, price_of
from scenarios.design.fluorescent_prior import Population
from twin.errors import InputError
from twin.fluorescence import FluorescenceProtocol, FluorescenceSetup
from twin.spectra import FloatArray


@dataclass(frozen=True)
class FluorescentDesign:
    """Lights by name, a detector ("S1" or "S2") and shots of the sample under each light."""

    lights: tuple[str, ...]
    detector: str
    repeats: int = 3

    @property
    def price_usd(self) -> float:
        """Price [USD]."""
        return price_of(self.lights, self.detector)

    @property
    def protocol(self) -> FluorescenceProtocol:
        """The protocol: white and sample alike."""
        return FluorescenceProtocol(repeats=self.repeats, white_repeats=self.repeats)

    @property
    def setup(self) -> FluorescenceSetup:
        """The set-up."""
        return assembled(self.lights, self.detector)

    @property
    def text(self) -> str:
        """In one line."""
        return f"{' '.join(self.lights)}; {self.detector}; {self.repeats} shots"


SEED_DESIGNS: dict[str, FluorescentDesign] = {
    f"{lights}-{detector}": FluorescentDesign(SEED_LIGHTS[lights], detector)
    for lights in ("L1", "L2")
    for detector in ("S1", "S2")
}
"""The seed's four cheap set-ups (its table 1)."""


def predict_designs(
    designs: Sequence[FluorescentDesign], population: Population, *, draws: int = 2, steps: int = 0
) -> FluorescentPrediction:
    """Predict the accuracy of N designs; `steps` as in `predict_fluorescence`."""
    return predict_fluorescence(
        [each.setup for each in designs], population, [each.protocol for each in designs],
        draws=draws, steps=steps,
    )  # fmt: skip


def varied_designs(count: int, *, seed: int = 1) -> tuple[FluorescentDesign, ...]:
    """Designs for comparing prediction and simulation: chosen at random, not by their results.

    Three to eight lights of L1 or of L2, either detector in turn, 1, 3 or 10 shots; all distinct,
    none of them one of `SEED_DESIGNS`.

    Raises:
        InputError: a count below 1.
    """
    if count < 1:
        raise InputError(f"{count} designs", "1 or more", place="count")
    random = np.random.Generator(np.random.Philox(key=[seed, 7]))
    found: list[FluorescentDesign] = []
    while len(found) < count:
        pool = SEED_LIGHTS["L1" if random.random() < 0.7 else "L2"]
        size = int(random.integers(3, 9))
        chosen = sorted(random.choice(len(pool), size=size, replace=False))
        detector = "S1" if len(found) % 2 else "S2"
        repeats = int(random.choice([1, 3, 10]))
        one = FluorescentDesign(tuple(pool[n] for n in chosen), detector, repeats)
        if one not in found and one not in SEED_DESIGNS.values():
            found.append(one)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Exhaustive:
    """Every design of a list of lights, detectors and shots, with what it is predicted to reach.

    Attributes:
        designs: N of them.
        price_usd: (N,).
        rmse_lower, rmse_diagonal, de2000: predicted, typical of the population, (N,).
    """

    designs: tuple[FluorescentDesign, ...]
    price_usd: FloatArray
    rmse_lower: FloatArray
    rmse_diagonal: FloatArray
    de2000: FloatArray

    def as_good_as(self, number: int, slack: float = 0.0) -> list[int]:
        """Cheaper designs that are predicted to be as good as one of them in all three figures.

        Args:
            number: of the design to beat.
            slack: relative excess of a figure that is accepted.

        Returns:
            Numbers, cheapest first, the more accurate of equal prices first.
        """
        good = self.price_usd < self.price_usd[number] - 1e-9
        for figure in (self.rmse_lower, self.rmse_diagonal, self.de2000):
            good &= figure <= (1.0 + slack) * figure[number]
        found = np.flatnonzero(good)
        order = np.lexsort((self.rmse_lower[found], self.price_usd[found]))
        return [int(n) for n in found[order]]

    def front(self) -> list[int]:
        """Designs that no cheaper or equally cheap one surpasses in `rmse_lower`, by price."""
        order = np.lexsort((self.rmse_lower, self.price_usd))
        best, found = np.inf, []
        for number in order:
            if self.rmse_lower[number] < best:
                best = self.rmse_lower[number]
                found.append(int(number))
        return found

    def number_of(self, design: FluorescentDesign) -> int:
        """Which of them a design is.

        Raises:
            InputError: none of them.
        """
        wanted = (set(design.lights), design.detector, design.repeats)
        for number, each in enumerate(self.designs):
            if (set(each.lights), each.detector, each.repeats) == wanted:
                return number
        raise InputError(design.text, "one of the designs of the list", place="design")


def exhaustive(
    lights: Sequence[str],
    population: Population,
    *,
    detectors: Sequence[str] = ("S1", "S2"),
    repeats: Sequence[int] = (3,),
    most_lights: int | None = None,
) -> Exhaustive:
    """Predict every choice of lights with every detector and number of shots.

    Args:
        lights: names of `priced_lights`.
        population: materials.
        detectors: "S1", "S2".
        repeats: shots of the sample and of the white under each light.
        most_lights: largest choice; None: all of them.

    Raises:
        InputError: an unknown light or detector, no light.
    """
    most = len(lights) if most_lights is None else most_lights
    subsets = [s for k in range(1, most + 1) for s in combinations(range(len(lights)), k)]
    designs, figures = [], []
    for detector in detectors:
        setup = assembled(lights, detector)
        for shots in repeats:
            own = [
                FluorescentDesign(tuple(lights[n] for n in each), detector, shots)
                for each in subsets
            ]
            found = predict_light_subsets(setup, subsets, population, own[0].protocol)
            designs += own
            figures.append([found.rmse_lower, found.rmse_diagonal, found.de2000])
    lower, diagonal, colour = np.concatenate(figures, axis=1)
    price = np.array([each.price_usd for each in designs])
    return Exhaustive(tuple(designs), price, lower, diagonal, colour)


def best_of_size(found: Exhaustive, detector: str, repeats: int = 3) -> dict[int, int]:
    """The best design with each number of lights, by `rmse_lower`: what each further light buys."""
    best: dict[int, int] = {}
    for number, each in enumerate(found.designs):
        if (each.detector, each.repeats) != (detector, repeats):
            continue
        size = len(each.lights)
        if size not in best or found.rmse_lower[number] < found.rmse_lower[best[size]]:
            best[size] = number
    return dict(sorted(best.items()))


def without_each(found: Exhaustive, design: FluorescentDesign) -> dict[str, float]:
    """How many times larger `rmse_lower` is without each of a design's lights."""
    whole = found.rmse_lower[found.number_of(design)]
    loss = {}
    for name in design.lights:
        rest = tuple(each for each in design.lights if each != name)
        one = FluorescentDesign(rest, design.detector, design.repeats)
        loss[name] = float(found.rmse_lower[found.number_of(one)] / whole)
    return loss
