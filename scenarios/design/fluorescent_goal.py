"""Fluorescent materials behind the protocol of the search: parts and protocol in, figures out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from scenarios.design.candidate import Candidate
from scenarios.design.fluorescent import FluorescentPrediction, predict_fluorescence
from scenarios.design.fluorescent_parts import SEED_LIGHTS, assembled
from scenarios.design.goal import Goal
from scenarios.design.parts import Parts
from twin.errors import InputError
from twin.fluorescence import FluorescenceProtocol, FluorescenceSetup, named_setup
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from scenarios.design.fluorescent_prior import Population

FEWEST = 2
QUIET = 0.01
"""Factor on the noise of the captures at which nothing is left of it."""


class FluorescentPredictor:
    """Accuracy of Donaldson matrices (`scenarios.design.fluorescent`).

    The materials are generated (`fluorescent_population`): as many as the goal's `count` together.

    Args:
        goal: targets, number of materials, seed.
        parts: illuminants and detectors.
    """

    def __init__(self, goal: Goal, parts: Parts) -> None:
        self.goal, self.parts = goal, parts
        self.targets = goal.targets.names

    @cached_property
    def population(self) -> Population:
        """The materials, linearised."""
        from scenarios.design.fluorescent_population import fluorescent_population
        from scenarios.design.fluorescent_prior import linearised_population

        count = max(FEWEST, sum(each.count for each in self.goal.materials))
        return linearised_population(fluorescent_population(count, seed=self.goal.seed))

    def predict(self, candidates: Sequence[Candidate]) -> FloatArray:
        """Figures of N candidates, shape (N, T).

        Raises:
            InputError: lights or a detector that nothing is known of.
        """
        found = self._predicted(candidates)
        columns = {"fluorescence_rmse": found.rmse_lower, "fluorescence_de2000": found.de2000}
        return np.stack([columns[name] for name in self.targets], axis=-1)

    def _predicted(
        self, candidates: Sequence[Candidate], noise: float = 1.0
    ) -> FluorescentPrediction:
        setups = [self.setup(each) for each in candidates]
        protocols = [
            FluorescenceProtocol(repeats=each.repeats, white_repeats=each.repeats)
            for each in candidates
        ]
        return predict_fluorescence(setups, self.population, protocols, noise=noise)

    def setup(self, candidate: Candidate) -> FluorescenceSetup:
        """The set-up of a candidate; of fewer lights than the set has, those spread over it.

        Raises:
            InputError: lights or a detector that nothing is known of.
        """
        fields: dict[str, str] = {}
        for part in candidate.chosen(self.parts):
            fields |= {key: str(value) for key, value in part.fluorescence.items()}
        lights, detector = fields.get("lights", ""), fields.get("detector", "")
        if lights == "monochromator":
            return named_setup("reference")
        if lights not in SEED_LIGHTS:
            raise InputError(
                f"the lights {lights!r}", f"one of {', '.join(SEED_LIGHTS)}", place="fluorescence"
            )
        every = SEED_LIGHTS[lights]
        count = min(candidate.leds or len(every), len(every))
        places = np.linspace(0, len(every) - 1, count).round().astype(int)
        made = assembled([every[place] for place in places], detector)
        instrument = made.detector.model_copy(update={"averages": candidate.averages})
        return made.model_copy(update={"detector": instrument})

    def limits(self, candidate: Candidate) -> dict[str, dict[str, float]]:
        """Share of the noise in the square of every figure; the rest is the set-up's."""
        own, quiet = (self._predicted([candidate], each) for each in (1.0, QUIET))
        shares = {}
        for name, field in (("fluorescence_rmse", "rmse_lower"), ("fluorescence_de2000", "de2000")):
            if name in self.targets:
                rest = min(float(getattr(quiet, field)[0] / getattr(own, field)[0]) ** 2, 1.0)
                shares[name] = {
                    "too few lights and channels": rest,
                    "counts, references and lamps": 1.0 - rest,
                }
        return shares
